"""A database of one's own as a forward model for one curve: fast misfits of many candidates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import NdBSpline

from skinlab.parameters import ParameterSpace
from skinlab.tables.misfit import Misfit, Whitening
from skinlab.tables.svd_basis import cells_that_hold, components

if TYPE_CHECKING:
    from skinlab.tables.model_database import ModelDatabase

Array = NDArray[np.float64]

_ALWAYS_MBAR = 0.0  # an entry that holds to no suction at all gives no answer


class TensorModel:
    """The database at given samples; parameters are those of its axes, in their order."""

    def __init__(self, database: ModelDatabase, pressure_mbar: Array, time_s: Array | None) -> None:
        """Prepare for these pressures (u,) and times (u,).

        Raises:
            NotTrustworthyError: it needs times, and there are none.
        """
        course = database.course
        self.space: ParameterSpace = database.space
        self._axes = database.interpolants
        operator = course.operator(pressure_mbar, time_s)
        self._error_shapes = operator @ database.errors.T / np.sqrt(len(database.errors))
        wide, turn = np.linalg.qr(operator)
        grid = database.curves
        curves = grid.reshape(-1, grid.shape[-1]) @ turn.T  # samples, in an orthonormal basis
        q = components(curves)
        self._q = wide @ q  # (u, k)
        values = (curves @ q).reshape(*grid.shape[:-1], -1)
        for d, axis in enumerate(self._axes):
            values = axis.coefficients(values, d)
        self._spline = NdBSpline(
            tuple(axis.knots for axis in self._axes),
            np.ascontiguousarray(values),
            tuple(axis.degree for axis in self._axes),
        )
        asked = course.asked(pressure_mbar, time_s)
        top = max(float(asked.max(initial=0.0)), _ALWAYS_MBAR)
        nodes = database.holds_to >= min(top, float(course.nodes[-1])) - 1e-6
        self._holds = cells_that_hold(nodes)

    def _inside(self, parameters: Array) -> NDArray[np.bool_]:
        inside = np.ones(len(parameters), dtype=bool)
        for d, axis in enumerate(self._axes):
            inside &= axis.inside(parameters[:, d])
        cell = tuple(axis.cell(parameters[:, d]) for d, axis in enumerate(self._axes))
        return np.asarray(inside & self._holds[cell])

    def _points(self, parameters: Array) -> Array:
        held = [
            np.clip(p, a.nodes[0], a.nodes[-1])
            for p, a in zip(parameters.T, self._axes, strict=True)
        ]
        return np.stack([a.coordinate(p) for p, a in zip(held, self._axes, strict=True)], axis=1)

    def coordinates(self, parameters: Array) -> Array:
        """Return the components (n, k) of candidates; NaN where the database does not hold."""
        inside = self._inside(parameters)
        found = np.full((len(parameters), self._q.shape[1]), np.nan)
        found[inside] = self._spline(self._points(parameters[inside]))
        return found

    def coordinate_slopes(self, parameters: Array) -> Array:
        """Return derivatives (n, k, p) of the components by the parameters."""
        inside = self._inside(parameters)
        count = len(self._axes)
        slopes = np.full((len(parameters), self._q.shape[1], count), np.nan)
        points = self._points(parameters[inside])
        for d, (axis, order) in enumerate(zip(self._axes, np.eye(count, dtype=int), strict=True)):
            by = axis.coordinate_slope(parameters[inside, d])
            slopes[inside, :, d] = self._spline(points, nu=order) * by[:, None]
        return slopes

    @property
    def error_shapes_mm(self) -> Array:
        """Shapes (u, m) in which it errs between its nodes, as found at m points of the box."""
        return np.asarray(self._error_shapes)

    def deflection_mm(self, parameters: Array) -> Array:
        """Return the curves (n, u) of candidates; NaN where the database does not hold."""
        return np.asarray(self.coordinates(parameters) @ self._q.T)

    def misfit(self, measured_mm: Array, whitening: Whitening | None = None) -> Misfit:
        """Return the sum of squared differences to these deflections (u,), as a function."""
        return Misfit(self, self._q, measured_mm, whitening)
