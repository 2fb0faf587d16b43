"""The grid as a forward model for one curve: fast misfits of many candidates at once.

The database's curves live in a space of a dozen dimensions: with orthonormal components Q of the
curves at the measured pressures, ‖M − Ω‖² = ‖M⊥‖² + ‖c_M − c_Ω‖² exactly, so that a candidate
costs a few multiplications instead of one per sample.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from skinlab.errors import NotTrustworthyError
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials.compressibility import KappaConvention, kappa_ratio, nu_from_ratio
from skinlab.parameters import BoxSpace
from skinlab.tables.grid import GridDatabase
from skinlab.tables.lagrange import TensorLagrange, matrix
from skinlab.tables.misfit import Misfit, Whitening
from skinlab.tables.svd_basis import cells_that_hold

Array = NDArray[np.float64]

_KEPT_MM = 1e-6  # components whose part in all curves together is below 1 nm are dropped


@lru_cache(maxsize=4)
def _components(database: GridDatabase) -> tuple[Array, Array]:
    """Return coordinates (entries, k) and basis (k, p) of all curves on the grid's pressures."""
    curves = database.deflection_mm.reshape(-1, database.spec.shape[-1])
    holds = np.isfinite(curves).all(axis=1)
    _, s, vt = np.linalg.svd(curves[holds], full_matrices=False)
    k = int((s > _KEPT_MM).sum())
    coordinates = np.full((len(curves), k), np.nan)
    coordinates[holds] = curves[holds] @ vt[:k].T
    return coordinates, vt[:k]


class GridModel:
    """The grid at given pressures; parameters are (X1_MPa, X2_MPa, nu)."""

    def __init__(
        self,
        database: GridDatabase,
        geometry: Geometry,
        pressure_mbar: Array,
        kappa: KappaConvention = "paper",
    ) -> None:
        """Prepare for these pressures (u,).

        Raises:
            NotTrustworthyError: the database does not speak of this geometry.
        """
        spec = database.spec
        stored = spec.geometry.thickness_mm / spec.geometry.radius_mm
        asked = geometry.thickness_mm / geometry.radius_mm
        if abs(asked / stored - 1) > 1e-9:
            raise NotTrustworthyError(
                f"thickness/radius is {asked:.4g}, and this database holds for {stored:.4g} only "
                f"(a {spec.geometry.aperture_mm:g} mm opening on "
                f"{spec.geometry.thickness_mm:g} mm of skin)"
            )
        self._database, self._kappa = database, kappa
        # w/R depends on p/X1, X2/X1, ν and h/R: a similar geometry only scales the deflection.
        self._scale = geometry.radius_mm / spec.geometry.radius_mm
        coordinates, basis = _components(database)
        at_points = self._scale * basis @ matrix(spec.pressure_mbar, pressure_mbar).T
        q, r = np.linalg.qr(at_points.T)
        self._q = q  # (u, k) orthonormal
        values = (coordinates @ r.T).reshape(*spec.shape[:3], -1)
        top = min(float(pressure_mbar.max(initial=0.0)), max(spec.pressure_mbar))
        self._holds = cells_that_hold(database.holds_to_mbar >= top)
        axes = (np.array(spec.X1_MPa), np.array(spec.X2_MPa), np.array(spec.nu))
        self._axes = axes
        self._tensor = TensorLagrange(axes, values)
        ratio = (kappa_ratio(axes[2][0], spec.kappa), kappa_ratio(axes[2][-1], spec.kappa))
        nu = tuple(float(nu_from_ratio(x, kappa)) for x in ratio)
        self.space = BoxSpace(
            ("X1_MPa", "X2_MPa", "nu"),
            (float(axes[0][0]), float(axes[1][0]), nu[0]),
            (float(axes[0][-1]), float(axes[1][-1]), nu[1]),
        )

    def coordinates(self, parameters: Array) -> Array:
        """Return the components (n, k) of candidates (n, 3); NaN where the grid does not hold."""
        points = parameters
        if self._kappa != self._database.spec.kappa:
            ratio = kappa_ratio(parameters[:, 2], self._kappa)
            points = parameters.copy()
            points[:, 2] = nu_from_ratio(ratio, self._database.spec.kappa)
        values = self._tensor(points)
        cell = tuple(
            np.clip(np.searchsorted(axis, points[:, d], side="right") - 1, 0, len(axis) - 2)
            for d, axis in enumerate(self._axes)
        )
        values[~self._holds[cell]] = np.nan
        return values

    def coordinate_slopes(self, parameters: Array) -> Array:
        """Return derivatives (n, k, 3) of the components, by central differences.

        Cubic Lagrange pieces meet with a kink at the nodes; next to one this is a mean.
        """
        low, high = self.space.bounds
        steps = 1e-6 * (high - low)
        shifts = np.diag(steps)
        # All in one call, which costs a single candidate hardly more than one of them.
        points = parameters[:, None] + np.concatenate([shifts, -shifts])
        values = self.coordinates(points.reshape(-1, 3)).reshape(len(parameters), 6, -1)
        rise = values[:, :3] - values[:, 3:]
        return np.asarray(np.moveaxis(rise, 1, 2) / (2 * steps))

    @property
    def error_shapes_mm(self) -> Array:
        """Shapes (u, 0): between nodes it errs by less than the least noise there is."""
        return np.zeros((len(self._q), 0))

    def deflection_mm(self, parameters: Array) -> Array:
        """Return the curves (n, u) of candidates (n, 3); NaN where the database does not hold."""
        return np.asarray(self.coordinates(parameters) @ self._q.T)

    def misfit(self, measured_mm: Array, whitening: Whitening | None = None) -> Misfit:
        """Return the sum of squared differences to these deflections (u,), as a function."""
        return Misfit(self, self._q, measured_mm, whitening)
