"""The dimensionless table itself: curves of any skins, each under an opening of its own.

`Evaluator` is quicker for many candidates at one geometry, which it first tabulates; this has
nothing to prepare, which pays where thickness and opening vary, or where few curves are asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.mechanics.fem import kernel
from skinlab.tables.axes import TableAxis
from skinlab.tables.model_errors import SeenErrors
from skinlab.tables.splines import TensorBSpline, local_basis

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AnyGeometry:
    """w/R = q exp(log compliance) of the law's parameters, h/R and the load q = p/scale.

    `axes` are those of log h/R and of the law's parameters but the scale; `log_holds` is the
    logarithm of the load to which they hold, linear between the nodes. `load_knots` are those of
    the cubic spline along `coordinate(q, h/R)`, whose coefficients (n1, …, nd, k) `log_compliance`
    interpolates. `seen_errors` is by how much it was off along q, by h/R; None: not measured.
    """

    axes: Sequence[TableAxis]
    log_compliance: TensorBSpline
    log_holds: TensorBSpline
    load_knots: Array
    coordinate: Callable[[Array, Array], Array]
    seen_errors: Callable[[float], SeenErrors] | None = None

    def __call__(self, parameters: Array, thickness: Array, load: Array) -> tuple[Array, Array]:
        """Return w/R (n, m) and the loads (n,) up to which these are answers, 0 outside.

        `parameters` (n, p) of the law, the scale first; `thickness` (n,) h/R; `load` (n, m). Beyond
        where a skin holds its curve goes on smoothly, and means nothing; outside it is NaN.
        """
        points = np.empty((len(parameters), len(self.axes)))
        inside = np.ones(len(parameters), dtype=bool)
        columns = [thickness, *parameters[:, 1:].T]
        for d, (axis, values) in enumerate(zip(self.axes, columns, strict=True)):
            at = axis.coordinate(values, parameters[:, 0])
            inside &= axis.inside(at)
            points[:, d] = np.fmin(np.fmax(at, axis.nodes[0]), axis.nodes[-1])
        holds_to = np.where(inside, np.exp(self.log_holds(points)[:, 0]), 0.0)
        spline = self.log_compliance(points)  # (n, k)
        at = self.coordinate(load, thickness[:, None])
        compliance = np.exp(_along(self.load_knots, spline, at))
        return np.where(inside[:, None], load * compliance, np.nan), holds_to


def _along(knots: Array, coefficients: Array, at: Array) -> Array:
    """Return values (n, m) of n cubic splines (n, k) at points (n, m), constant beyond the ends."""
    found = kernel.splines(knots, coefficients, at)
    if found is None:
        within = np.clip(at, knots[0], knots[-1])
        first, weights = local_basis(knots, 3, within.ravel())
        row = np.repeat(np.arange(len(at)) * coefficients.shape[1], at.shape[1])
        around = coefficients.ravel()[(row + first)[:, None] + np.arange(4)]
        found = np.einsum("ij,ij->i", around, weights).reshape(at.shape)
    return found
