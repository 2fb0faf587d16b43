"""What the finite elements ask of a constitutive law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from skinlab.plugins import needs

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Potential:
    """Strain energy per reference volume and its derivatives by (I1, I2, J), in MPa.

    All arrays have the shape of the invariants that they were computed from. `I1` and `I2` are the
    first two invariants of C = FᵀF, `J` = det F; isotropy makes these three enough.
    """

    energy: Array
    d_i1: Array
    d_i2: Array
    d_j: Array
    d_i1_i1: Array
    d_i1_i2: Array
    d_i2_i2: Array
    d_i1_j: Array
    d_i2_j: Array
    d_j_j: Array


class Law(Protocol):
    """An isotropic hyperelastic law: a name, its parameters, and its potential.

    The energy is linear in the parameters, and `kappa_MPa` multiplies all that depends on J alone.
    """

    @property
    def name(self) -> str:
        """How it is called in files and options."""
        ...

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """What `potential` needs, e.g. ("X1_MPa", ..., "kappa_MPa")."""
        ...

    @property
    def source(self) -> str:
        """Where it was published."""
        ...

    def potential(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        """Return energy and derivatives.

        Parameters are floats, or arrays that broadcast against the invariants (layers).
        """
        ...


def check_law(one: object) -> None:
    """Check that an extension is a law.

    Raises:
        TypeError: it is not.
    """
    needs(one, "parameter_names", "source", "potential")
