"""A table at the samples of one curve: fast curves and misfits of many candidates at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import NdBSpline

from skinlab.parameters import Space
from skinlab.tables.axes import TableAxis
from skinlab.tables.misfit import Misfit, Whitening

Array = NDArray[np.float64]


class Tensor(Protocol):
    """Values on a grid, interpolated."""

    def __call__(self, points: Array) -> Array:
        """Return the values (n, k) at points (n, d)."""
        ...

    def slope(self, points: Array, d: int) -> Array:
        """Return their derivatives (n, k) by coordinate `d`."""
        ...


class TensorSpline:
    """Splines along all axes."""

    def __init__(self, axes: Sequence[TableAxis], values: Array) -> None:
        """`values` (n1, …, nd, k) are those at the nodes."""
        for d, axis in enumerate(axes):
            values = axis.coefficients(values, d)
        self._orders = np.eye(len(axes), dtype=int)
        self._spline = NdBSpline(
            tuple(axis.knots for axis in axes),
            np.ascontiguousarray(values),
            tuple(axis.degree for axis in axes),
        )

    def __call__(self, points: Array) -> Array:
        """Return the values (n, k) at points (n, d)."""
        return np.asarray(self._spline(points))

    def slope(self, points: Array, d: int) -> Array:
        """Return their derivatives (n, k) by coordinate `d`."""
        return np.asarray(self._spline(points, nu=self._orders[d]))


class Evaluator:
    """The curves of a table at given samples, as components of an orthonormal basis.

    A candidate has an answer where all corners of its cell hold as far as the samples go.
    """

    def __init__(
        self,
        space: Space,
        axes: Sequence[TableAxis],
        tensor: Tensor,
        basis: Array,
        holds_to: Array,
        top: float,
        *,
        load_mbar: float | None = None,
        errors_mm: Array | None = None,
    ) -> None:
        """Prepare.

        `basis` (u, k) is orthonormal, `tensor` gives components; `holds_to` is how far each cell
        holds and `top` how far it has to: both along what the table holds its curves, or, with
        `load_mbar`, in mbar, `holds_to` per unit of `load_mbar` times the law's scale.
        `errors_mm` (u, m) are shapes in which the curves err as a whole.
        """
        self.space = space
        self._axes, self._tensor, self._q = tuple(axes), tensor, basis
        self._holds_to, self._top, self._load_mbar = holds_to, top, load_mbar
        self._errors = np.zeros((len(basis), 0)) if errors_mm is None else errors_mm

    def _points(self, parameters: Array) -> tuple[Array, Array]:
        """Return coordinates (n, d) of parameters, and how far they hold (n,); -inf outside."""
        points = np.empty_like(parameters, dtype=float)
        inside = np.ones(len(parameters), dtype=bool)
        scale = parameters[:, 0]
        cells = []
        for d, axis in enumerate(self._axes):
            at = axis.coordinate(parameters[:, d], scale)
            inside &= axis.inside(at)
            cells.append(axis.cell(at))
            points[:, d] = np.clip(at, axis.nodes[0], axis.nodes[-1])
        reach = self._holds_to[tuple(cells)]
        if self._load_mbar is not None:
            reach = reach * scale * self._load_mbar
        return points, np.where(inside, reach, -np.inf)

    def holds_to(self, parameters: Array) -> Array:
        """Return how far (n,) candidates hold; -inf outside of the table."""
        return self._points(parameters)[1]

    def coordinates(self, parameters: Array) -> Array:
        """Return the components (n, k) of candidates (n, p); NaN where the table does not hold."""
        points, reach = self._points(parameters)
        inside = reach >= self._top
        if inside.all():
            return self._tensor(points)
        found = np.full((len(points), self._q.shape[1]), np.nan)
        found[inside] = self._tensor(points[inside])
        return found

    def coordinate_slopes(self, parameters: Array) -> Array:
        """Return derivatives (n, k, p) of the components by the parameters."""
        points, reach = self._points(parameters)
        inside = reach >= self._top
        slopes = np.full((len(points), self._q.shape[1], len(self._axes)), np.nan)
        points, values = points[inside], parameters[inside]
        # A ratio's coordinate falls as the scale, the first parameter, rises.
        by = [self._tensor.slope(points, d) for d in range(len(self._axes))]
        by[0] = by[0] - sum(
            (b for b, a in zip(by, self._axes, strict=True) if a.coordinate.kind == "ratio"), 0.0
        )
        for d, axis in enumerate(self._axes):
            slopes[inside, :, d] = axis.coordinate.by_parameter(by[d], values[:, d])
        return slopes

    @property
    def error_shapes_mm(self) -> Array:
        """Shapes (u, m) in which it errs as a whole; none where that is less than any noise."""
        return self._errors

    def deflection_mm(self, parameters: Array) -> Array:
        """Return the curves (n, u) of candidates (n, p); NaN where the table does not hold."""
        return np.asarray(self.coordinates(parameters) @ self._q.T)

    def with_reach(self, parameters: Array) -> tuple[Array, Array]:
        """Return curves (n, u), and how far (n,) these are answers; NaN and 0 outside.

        Beyond that they go on smoothly and mean nothing.
        """
        points, reach = self._points(parameters)
        inside = reach > 0.0
        found = np.full((len(points), len(self._q)), np.nan)
        found[inside] = self._tensor(points[inside]) @ self._q.T
        return found, np.maximum(reach, 0.0)

    def misfit(self, measured_mm: Array, whitening: Whitening | None = None) -> Misfit:
        """Return the sum of squared differences to these deflections (u,), as a function."""
        return Misfit(self, self._q, measured_mm, whitening)
