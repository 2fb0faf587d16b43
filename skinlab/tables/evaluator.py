"""A table at the samples of one curve: fast curves and misfits of many candidates at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skinlab.parameters import Space
from skinlab.tables.axes import TableAxis
from skinlab.tables.misfit import Misfit, Whitening
from skinlab.tables.model_errors import crease_shapes, locking
from skinlab.tables.settings import INTERPOLATION
from skinlab.tables.splines import TensorBSpline, knots_through

Array = NDArray[np.float64]

_NOTHING = 1e-300


class Tensor(Protocol):
    """Values on a grid, interpolated."""

    def __call__(self, points: Array) -> Array:
        """Return the values (n, k) at points (n, d)."""
        ...

    def slopes(self, points: Array) -> Array:
        """Return their derivatives (n, d, k) by each coordinate."""
        ...


def tensor_spline(axes: Sequence[TableAxis], values: Array) -> TensorBSpline:
    """Return the splines along all axes through values (n1, …, nd, k) at the nodes."""
    for d, axis in enumerate(axes):
        values = axis.coefficients(values, d)
    return TensorBSpline([axis.knots for axis in axes], [axis.degree for axis in axes], values)


class Evaluator:
    """The curves of a table at given samples, as components of an orthonormal basis.

    How far a candidate holds is interpolated between the nodes. It has an answer a little beyond
    that too, since finer meshes end elsewhere; `error_shapes_mm` says how wrong it may be there.
    """

    def __init__(
        self,
        space: Space,
        axes: Sequence[TableAxis],
        tensor: Tensor,
        basis: Array,
        holds_to: Array,
        along: Array,
        *,
        load_mbar: float | None = None,
        goes_on_to: Array | None = None,
        errors_mm: Array | None = None,
        relative_errors: Callable[[float], Array] | None = None,
    ) -> None:
        """Prepare.

        `basis` (u, k) is orthonormal, `tensor` gives components; `holds_to` (n1, …, nd) is how
        far each node holds, `goes_on_to` how far it goes on beyond a crease (None: no further) and
        `along` (u,) where the samples are, all along what the table holds its curves. With
        `load_mbar` the last are in mbar, and the first two (n2, …, nd), which do not depend on the
        law's scale, are per unit of `load_mbar` times that.
        `errors_mm` (u, m) are shapes in which the curves err as a whole; `relative_errors` gives
        those of a candidate by its scale, as shares of its deflection.
        """
        self.space = space
        self._axes, self._tensor, self.basis = tuple(axes), tensor, basis
        self._limit_axes = self._axes if load_mbar is None else self._axes[1:]
        ends = np.array([(*axis.ends, axis.nodes[0], axis.nodes[-1]) for axis in self._axes])
        self._low, self._high, self._first, self._last = ends.T
        limits = np.stack([holds_to, holds_to if goes_on_to is None else goes_on_to], axis=-1)
        self._log_limits = TensorBSpline(  # linear between the nodes
            [knots_through(axis.nodes, 1) for axis in self._limit_axes],
            [1] * len(self._limit_axes),
            np.log(np.maximum(limits, _NOTHING)),
        )
        self._ends = 1  # of the limits: where a candidate has no answer any more
        self._along, self._load_mbar = along, load_mbar
        self._top = max(float(along.max(initial=0.0)), 1e-8)
        self._errors = np.zeros((len(basis), 0)) if errors_mm is None else errors_mm
        self._relative_errors = relative_errors
        self._placed: tuple[bytes, tuple[Array, Array]] = (b"", (np.empty(0), np.empty(0)))

    def ended(self) -> Evaluator:
        """Return the same without what goes on beyond a crease, but for a little."""
        other = copy(self)
        other._ends = 0
        return other

    def _points(self, parameters: Array) -> tuple[Array, Array]:
        """Return coordinates (n, d) of parameters; how far they hold and go on (2, n).

        -inf outside of the table.
        """
        # Fits ask for the values and then for the slopes at the same candidates
        asked, placed = parameters.tobytes(), self._placed
        if asked != placed[0]:
            placed = self._placed = (asked, self._place(parameters))
        return placed[1]  # of this call: other threads may ask, too

    def _place(self, parameters: Array) -> tuple[Array, Array]:
        at = np.empty(parameters.shape)
        scale = parameters[:, 0]
        for d, axis in enumerate(self._axes):
            at[:, d] = axis.coordinate(parameters[:, d], scale)
        inside = ((at >= self._low) & (at <= self._high)).all(axis=1)
        points = np.fmin(np.fmax(at, self._first), self._last)
        limit_at = points[:, len(self._axes) - len(self._limit_axes) :]
        reach = np.exp(self._log_limits(limit_at).T)
        if self._load_mbar is not None:
            reach = reach * scale * self._load_mbar
        return points, np.where(inside, reach, -np.inf)

    def holds_to(self, parameters: Array) -> Array:
        """Return how far (n,) candidates hold; -inf outside of the table."""
        return np.asarray(self._points(parameters)[1][0])

    def creases(self, parameters: Array) -> NDArray[np.bool_]:
        """Return which candidates (n,) end before the samples do, and go on all the same."""
        return np.asarray(self._points(parameters)[1][0] < self._top)

    def coordinates(self, parameters: Array) -> Array:
        """Return the components (n, k) of candidates (n, p); NaN where the table does not hold."""
        points, reach = self._points(parameters)
        inside = reach[self._ends] * INTERPOLATION.continued >= self._top
        if inside.all():
            return self._tensor(points)
        found = np.full((len(points), self.basis.shape[1]), np.nan)
        found[inside] = self._tensor(points[inside])
        return found

    def coordinate_slopes(self, parameters: Array) -> Array:
        """Return derivatives (n, k, p) of the components by the parameters."""
        points, reach = self._points(parameters)
        inside = reach[self._ends] * INTERPOLATION.continued >= self._top
        some, values = (
            (points, parameters) if inside.all() else (points[inside], parameters[inside])
        )
        slopes = self._tensor.slopes(some)
        # A ratio's coordinate falls as the scale, the first parameter, rises.
        for d, axis in enumerate(self._axes):
            if axis.coordinate.kind == "ratio":
                slopes[:, 0] -= slopes[:, d]
        for d, axis in enumerate(self._axes):
            slopes[:, d] = axis.coordinate.by_parameter(slopes[:, d], values[:, d])
        if len(some) == len(points):
            return np.swapaxes(slopes, 1, 2)
        found = np.full((len(points), slopes.shape[2], len(self._axes)), np.nan)
        found[inside] = np.swapaxes(slopes, 1, 2)
        return found

    def error_shapes_mm(self, parameters: Array) -> Array:
        """Return shapes (u, m) in which the curve of a candidate (p,) errs as a whole.

        Each is as large as its standard deviation.
        """
        points, reach = self._points(parameters[None])
        deflection = self._tensor(points)[0] @ self.basis.T
        relative = crease_shapes(self._along / max(float(reach[0, 0]), _NOTHING))
        if self._relative_errors is not None:
            relative = np.hstack([relative, self._relative_errors(float(parameters[0]))])
        return np.hstack([self._errors, deflection[:, None] * relative])

    def locking(self, parameters: Array) -> Array:
        """Return how much the mesh locks (n,) at candidates (n, p): a share of the deflection."""
        found = np.zeros(len(parameters))
        for axis, values in zip(self._axes, parameters.T, strict=True):
            ratio = axis.coordinate.dilatation_ratio(values)
            if ratio is not None:
                found = locking(ratio)
        return found

    def deflection_mm(self, parameters: Array) -> Array:
        """Return the curves (n, u) of candidates (n, p); NaN where the table does not hold."""
        return np.asarray(self.coordinates(parameters) @ self.basis.T)

    def misfit(self, measured_mm: Array, whitening: Whitening | None = None) -> Misfit:
        """Return the sum of squared differences to these deflections (u,), as a function."""
        return Misfit(self, self.basis, measured_mm, whitening)
