"""What identification asks of a forward model for one curve, whichever it is."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.parameters import Space
from skinlab.tables.any_geometry import AnyGeometry
from skinlab.tables.misfit import Misfit, Whitening

Array = NDArray[np.float64]


class CurveModel(Protocol):
    """A forward model at one geometry and the pressures (u,) of one curve."""

    @property
    def space(self) -> Space:
        """Where the model holds at all."""
        ...

    def error_shapes_mm(self, parameters: Array) -> Array:
        """Return shapes (u, m) in which the curve of a candidate (p,) errs as a whole.

        Each is as large as its standard deviation.
        """
        ...

    def locking(self, parameters: Array) -> Array:
        """Return how much the mesh locks (n,) at candidates (n, p): a share of the deflection."""
        ...

    def creases(self, parameters: Array) -> NDArray[np.bool_]:
        """Return which candidates (n,) end before the samples do, and go on all the same."""
        ...

    def deflection_mm(self, parameters: Array) -> Array:
        """Return the curves (n, u) of candidates (n, k); NaN where the model does not hold."""
        ...

    @property
    def basis(self) -> Array:
        """Orthonormal (u, k): curves are `coordinates` times its transpose."""
        ...

    def coordinates(self, parameters: Array) -> Array:
        """Return the components (n, k) of candidates' curves; NaN where there is no model."""
        ...

    def coordinate_slopes(self, parameters: Array) -> Array:
        """Return derivatives (n, k, p) of the components by the parameters."""
        ...

    def misfit(self, measured_mm: Array, whitening: Whitening | None = None) -> Misfit:
        """Return the sum of squared differences to these deflections (u,), as a function."""
        ...


class Database(Protocol):
    """Forward models for curves of one law: what identification is given."""

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

    @property
    def fixed_geometry(self) -> Geometry | None:
        """The only opening and thickness that it speaks of; None: a range."""
        ...

    @property
    def path(self) -> Path | None:
        """The user's file that it is from; None: it ships with the package, or was computed."""
        ...

    def __hash__(self) -> int: ...

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
        """Return the forward model at this geometry and these pressures (u,).

        `time_s` (u,) are the times since the curve began, for models that depend on them. With a
        standard deviation of the thickness, its ratio to the stated one is one more parameter at
        the end, `thickness_ratio`.

        Raises:
            NotTrustworthyError: it does not speak of this geometry; names the axis.
        """
        ...

    def any_geometry(self, kappa: KappaConvention = "paper") -> AnyGeometry:
        """Return the forward model as a function of thickness and opening too, without any set-up.

        Raises:
            NotTrustworthyError: it is of one geometry only.
        """
        ...
