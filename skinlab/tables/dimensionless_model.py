"""The dimensionless table as a forward model for one curve: fast misfits of many candidates.

At given pressures and h/R the table becomes a function of (log X1, log X2/X1, log κ/X1), which is
tabulated on a small grid. Its curves live in a space of a dozen dimensions: with orthonormal
components Q, ‖M − Ω‖² = ‖M⊥‖² + ‖c_M − c_Ω‖² exactly, so that a candidate costs one evaluation of a
tensor spline with a dozen values instead of one value per sample.

Where the thickness is uncertain, its ratio to the stated one is a fourth parameter, and the small
grid has a fourth axis. A curve of more samples than `_MOST_SAMPLES` is tabulated at that many
pressures, between which it is a cubic spline.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, NdBSpline

from skinlab.mechanics.fem.suction import MBAR, Geometry
from skinlab.mechanics.materials.compressibility import KappaConvention, kappa_ratio
from skinlab.parameters import ParameterSpace, RatioSpace, WithFactor
from skinlab.tables.misfit import Misfit, Whitening
from skinlab.tables.splines import basis, coefficients, knots
from skinlab.tables.svd_basis import components

if TYPE_CHECKING:
    from skinlab.tables.dimensionless import DimensionlessTable

Array = NDArray[np.float64]

_X1_NODES = 24  # along log X1, between the table's bounds
_MOST_SAMPLES = 110
_PRESSURE_NODES = 72
_THICKNESS_STEP = 0.07  # along log h/R; 7 nodes or more
_THICKNESS_REACH = 3.5  # standard deviations, or as far as the table goes

NU_RANGE = (0.2, 0.49)  # in either convention


@lru_cache(maxsize=4)
def _load_coefficients(table: DimensionlessTable) -> Array:
    """Return the B-spline coefficients of the table along h/R and the load."""
    values = table.log_compliance.astype(np.float64)
    return np.ascontiguousarray(coefficients(coefficients(values, 0), 3))


class DimensionlessModel:
    """The table at given pressures; parameters are (X1_MPa, X2_MPa, nu[, thickness_ratio])."""

    def __init__(
        self,
        table: DimensionlessTable,
        geometry: Geometry,
        pressure_mbar: Array,
        kappa: KappaConvention,
        thickness_sd_mm: float = 0.0,
    ) -> None:
        spec = table.spec
        self._kappa = kappa
        self._nodes: tuple[Array, ...] = (
            np.linspace(math.log(spec.X1_MPa[0]), math.log(spec.X1_MPa[1]), _X1_NODES),
            spec.X2_over_X1.log_nodes(),
            spec.kappa_over_X1.log_nodes(),
        )
        log_thickness = math.log(geometry.thickness_mm / geometry.radius_mm)
        thicknesses = np.array([log_thickness])
        self.range = RatioSpace(spec.X1_MPa, (spec.X2_over_X1.low, spec.X2_over_X1.high), NU_RANGE)
        self.space: ParameterSpace = self.range
        if thickness_sd_mm > 0.0:
            thicknesses = _around(table, log_thickness, thickness_sd_mm / geometry.thickness_mm)
            log_ratio = thicknesses - log_thickness
            self._nodes = (*self._nodes, log_ratio)
            low, high = math.exp(log_ratio[0]), math.exp(log_ratio[-1])
            self.space = WithFactor(self.range, "thickness_ratio", low, high)
        at_nodes = [_cells_hold_to(table, t) for t in thicknesses]
        self._holds_to = np.array(
            [np.minimum(a, b) for a, b in pairwise([*at_nodes, at_nodes[-1]])]
        )
        self._top_mpa = float(pressure_mbar.max(initial=0.0)) * MBAR
        at_mbar, spread = _nodes_for(table, log_thickness, pressure_mbar)
        curves = np.stack(
            [geometry.radius_mm * self._tabulate(table, t, at_mbar) for t in thicknesses], axis=1
        ).reshape(-1, len(at_mbar))
        wide = None
        if spread is not None:
            wide, turn = np.linalg.qr(spread)
            curves = curves @ turn.T
        q = components(curves)  # (nodes, k), orthonormal
        self._q = q if wide is None else wide @ q  # (u, k)
        grid = (curves @ q).reshape(*(len(n) for n in self._nodes), -1)
        for axis in range(len(self._nodes)):
            grid = coefficients(grid, axis)
        self._spline = NdBSpline(
            tuple(knots(n) for n in self._nodes), np.ascontiguousarray(grid), 3
        )

    def _tabulate(
        self, table: DimensionlessTable, log_thickness: float, pressure_mbar: Array
    ) -> Array:
        """Return w/R on the grid (X1 · X2/X1 · κ/X1, u)."""
        spec = table.spec
        stored = _load_coefficients(table)
        weights = basis(spec.thickness_over_radius.log_nodes(), np.array([log_thickness]))[0]
        at_thickness = np.tensordot(weights, stored, axes=1)  # (X2/X1, κ/X1, load)
        load = np.outer(np.exp(-self._nodes[0]), pressure_mbar * MBAR)  # (X1, u)
        axis = spec.load_coordinates()
        at = np.clip(spec.coordinate(load, math.exp(log_thickness)), axis[0], axis[-1])
        design = BSpline.design_matrix(at.ravel(), knots(axis), 3)
        flat = at_thickness.reshape(-1, len(axis))
        log_compliance = design @ np.ascontiguousarray(flat.T)  # (X1 · u, X2/X1 · κ/X1)
        curves = np.exp(log_compliance, out=log_compliance)
        curves *= load.ravel()[:, None]
        n1, u = load.shape
        return np.ascontiguousarray(curves.reshape(n1, u, -1).transpose(0, 2, 1)).reshape(-1, u)

    def _points(self, parameters: Array) -> tuple[Array, Array]:
        """Return grid coordinates (n, p) of parameters (n, p), and the MPa to which they hold."""
        points = np.empty_like(parameters)
        with np.errstate(divide="ignore", invalid="ignore"):
            points[:, 0] = np.log(parameters[:, 0])
            points[:, 1] = np.log(parameters[:, 1]) - points[:, 0]
            points[:, 3:] = np.log(parameters[:, 3:])
        nu = parameters[:, 2]
        possible = (nu >= 0.0) & (nu < 0.5)
        points[:, 2] = np.log(kappa_ratio(np.where(possible, nu, 0.3), self._kappa))
        cells = []
        inside = possible
        for d, nodes in enumerate(self._nodes):
            slack = 1e-9 * (nodes[-1] - nodes[0])
            inside &= (points[:, d] >= nodes[0] - slack) & (points[:, d] <= nodes[-1] + slack)
            place = (points[:, d] - nodes[0]) * ((len(nodes) - 1) / (nodes[-1] - nodes[0]))
            # `fmax` takes the number where the other is NaN, as outside of the logarithms' range.
            cells.append(np.fmin(np.fmax(place, 0.0), len(nodes) - 2.0).astype(np.intp))
        thickness = cells[3] if len(cells) > 3 else 0
        holds_to = self._holds_to[thickness, cells[1], cells[2]]
        holds_to_mpa = np.where(inside, holds_to * parameters[:, 0], 0.0)
        return points, holds_to_mpa

    def holds_to_mbar(self, parameters: Array) -> Array:
        """Return the suction (n,) up to which the table holds; 0 outside of it."""
        return self._points(parameters)[1] / MBAR

    def coordinates(self, parameters: Array) -> Array:
        """Return the components (n, k) of candidates (n, p); NaN where the table does not hold."""
        points, holds_to_mpa = self._points(parameters)
        inside = holds_to_mpa >= max(self._top_mpa, 1e-12)
        found = np.full((len(points), self._q.shape[1]), np.nan)
        if inside.all():
            return np.asarray(self._spline(points))
        found[inside] = self._spline(points[inside])
        return found

    def coordinate_slopes(self, parameters: Array) -> Array:
        """Return derivatives (n, k, p) of the components by the parameters."""
        points, holds_to_mpa = self._points(parameters)
        inside = holds_to_mpa >= max(self._top_mpa, 1e-12)
        dimensions = len(self._nodes)
        slopes = np.full((len(points), self._q.shape[1], dimensions), np.nan)
        x1, x2, nu, *factor = parameters[inside].T
        by = [
            self._spline(points[inside], nu=np.eye(dimensions, dtype=int)[d])
            for d in range(dimensions)
        ]
        step = 1e-6  # κ(ν) is a rational function: central differences are good to round-off
        log_ratio = [np.log(kappa_ratio(nu + s, self._kappa)) for s in (-step, step)]
        slopes[inside, :, 0] = (by[0] - by[1]) / x1[:, None]
        slopes[inside, :, 1] = by[1] / x2[:, None]
        slopes[inside, :, 2] = by[2] * ((log_ratio[1] - log_ratio[0]) / (2 * step))[:, None]
        for d, values in enumerate(factor, start=3):
            slopes[inside, :, d] = by[d] / values[:, None]
        return slopes

    @property
    def error_shapes_mm(self) -> Array:
        """Shapes (u, 0): between nodes it errs by less than the least noise there is."""
        return np.zeros((len(self._q), 0))

    def deflection_mm(self, parameters: Array) -> Array:
        """Return the curves (n, u) of candidates (n, p); NaN where the table does not hold."""
        return np.asarray(self.coordinates(parameters) @ self._q.T)

    def with_reach(self, parameters: Array) -> tuple[Array, Array]:
        """Return curves (n, u), and the suctions (n,) in mbar up to which these are answers.

        Beyond that they go on smoothly and mean nothing. NaN and 0 outside of the table.
        """
        points, holds_to_mpa = self._points(parameters)
        inside = holds_to_mpa > 0.0
        found = np.full((len(points), len(self._q)), np.nan)
        found[inside] = self._spline(points[inside]) @ self._q.T
        return found, holds_to_mpa / MBAR

    def misfit(self, measured_mm: Array, whitening: Whitening | None = None) -> Misfit:
        """Return the sum of squared differences to these deflections (u,), as a function."""
        return Misfit(self, self._q, measured_mm, whitening)


def _around(table: DimensionlessTable, log_thickness: float, relative_sd: float) -> Array:
    """Return log h/R nodes about a thickness, as far as it is likely and the table goes."""
    axis = table.spec.thickness_over_radius
    low = log_thickness + math.log(max(1.0 - _THICKNESS_REACH * relative_sd, 0.2))
    high = log_thickness + math.log(1.0 + _THICKNESS_REACH * relative_sd)
    low, high = max(low, math.log(axis.low)), min(high, math.log(axis.high))
    return np.linspace(low, high, max(7, math.ceil((high - low) / _THICKNESS_STEP) + 1))


def _nodes_for(
    table: DimensionlessTable, log_thickness: float, pressure_mbar: Array
) -> tuple[Array, Array | None]:
    """Return the pressures to tabulate, and the matrix (u, nodes) from there to the samples.

    Between the nodes curves are cubic splines in the table's own coordinate of the softest skin.
    """
    if len(pressure_mbar) <= _MOST_SAMPLES:
        return pressure_mbar, None
    x1, thickness = table.spec.X1_MPa[0], math.exp(log_thickness)
    ends = np.array([pressure_mbar.min(), max(float(pressure_mbar.max()), 1e-6)])
    low, high = table.spec.coordinate(ends * MBAR / x1, thickness)
    nodes = np.linspace(low, high, _PRESSURE_NODES)
    at = table.spec.coordinate(pressure_mbar * MBAR / x1, thickness)
    spread = basis(nodes, at) @ coefficients(np.eye(_PRESSURE_NODES), 0)
    return x1 / MBAR * table.spec.load(nodes, thickness), spread


def _cells_hold_to(table: DimensionlessTable, log_thickness: float) -> Array:
    """Return the load to which each cell (X2/X1 − 1, κ/X1 − 1) holds: the least of its corners."""
    nodes = table.spec.thickness_over_radius.log_nodes()
    i = int(np.clip(np.searchsorted(nodes, log_thickness, side="right") - 1, 0, len(nodes) - 2))
    corner = table.holds_to_load[i : i + 2].min(axis=0)
    least = np.minimum(corner[1:], corner[:-1])
    return np.asarray(np.minimum(least[:, 1:], least[:, :-1]))
