"""What identification asks of a database, whichever it is."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.parameters import ParameterSpace
from skinlab.tables.misfit import Misfit, Whitening

Array = NDArray[np.float64]


class CurveModel(Protocol):
    """A database at one geometry and the pressures (u,) of one curve."""

    @property
    def space(self) -> ParameterSpace:
        """Where the database holds at all."""
        ...

    @property
    def error_shapes_mm(self) -> Array:
        """Shapes (u, m), each as large as its standard deviation, in which it errs as a whole."""
        ...

    def deflection_mm(self, parameters: Array) -> Array:
        """Return the curves (n, u) of candidates (n, k); NaN where the database does not hold."""
        ...

    def misfit(self, measured_mm: Array, whitening: Whitening | None = None) -> Misfit:
        """Return the sum of squared differences to these deflections (u,), as a function."""
        ...


class Database(Protocol):
    """Precomputed curves."""

    @property
    def law(self) -> str:
        """Name of the constitutive law."""
        ...

    @property
    def mesh_name(self) -> str:
        """Name of the discretisation that computed it."""
        ...

    @property
    def content_hash(self) -> str:
        """`sha256:…` over what was computed from what, and the numbers."""
        ...

    def covers(self, curve: Curve) -> NDArray[np.bool_]:
        """Return which samples (n,) of a curve it speaks of, its small extensions included.

        Raises:
            NotTrustworthyError: it does not speak of such a curve at all; says why.
        """
        ...

    def model(
        self,
        geometry: Geometry,
        pressure_mbar: Array,
        kappa: KappaConvention = "paper",
        thickness_sd_mm: float = 0.0,
        time_s: Array | None = None,
    ) -> CurveModel:
        """Return the database at this geometry and these pressures (u,).

        `time_s` (u,) are the times since the curve began, for databases that depend on them.

        With a standard deviation of the thickness, its ratio to the stated one is one more
        parameter at the end, `thickness_ratio`.

        Raises:
            NotTrustworthyError: it does not speak of this geometry; names the axis.
        """
        ...
