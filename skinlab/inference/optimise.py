"""Levenberg-Marquardt for many starts at once, inside the unit cube of a parameter space.

One step of all starts costs one call of the model. Unknowns that are on the cube's boundary and
would leave are held there; points without a model are refused like points that are worse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.problem import LeastSquares
from skinlab.parameters import ParameterSpace

Array = NDArray[np.float64]

_STEP = 1e-6  # of the unit cube, for the slopes of the space's own map
_FIRST_DAMPING = 1e-3
_MOST_DAMPING = 1e12
_SMALL_STEP = 1e-10  # of the unit cube


@dataclass(frozen=True, eq=False)
class Polished:
    """Where the starts ended. `cost` (n,) is the sum of squares, infinite without a model."""

    unit: Array  # (n, k)
    cost: Array
    normal: Array  # (n, k, k) JᵀJ there, by the unit cube's coordinates
    converged: NDArray[np.bool_]  # (n,)
    iterations: int
    evaluations: int


def unit_slopes(space: ParameterSpace, unit: Array) -> Array:
    """Return derivatives (..., p, k) of the parameters by the cube's coordinates, at (..., k).

    By central differences, good to about 1e-9: spaces are smooth, also beyond their boundary.
    """
    shifts = _STEP * np.eye(unit.shape[-1])
    at = unit[..., None, :]
    rise = space.from_unit(at + shifts) - space.from_unit(at - shifts)
    return np.asarray(np.swapaxes(rise, -1, -2) / (2.0 * _STEP))


def polish(
    space: ParameterSpace,
    problem: LeastSquares,
    starts: Array,
    *,
    held: NDArray[np.bool_] | None = None,
    least_gain: float = 1e-14,
    most_iterations: int = 100,
) -> Polished:
    """Return the minima that starts (n, k) lead to.

    `held` (n, k) says which unknowns keep their value; a start has converged when its next step
    promises less than `least_gain` (in the unit of the sum) or is below 1e-10 of the cube.
    """
    unit = np.clip(starts, 0.0, 1.0)
    n, k = unit.shape
    keep = np.zeros((n, k), dtype=bool) if held is None else held
    residual, jacobian = _evaluate(space, problem, unit)
    cost = _squares(residual)
    damping = np.full(n, _FIRST_DAMPING)
    growth = np.full(n, 2.0)
    converged = np.zeros(n, dtype=bool)
    evaluations, iteration = n, 0
    live = np.flatnonzero(np.isfinite(cost))
    while live.size and iteration < most_iterations:
        iteration += 1
        J, r = jacobian[live], residual[live]
        turned = np.swapaxes(J, 1, 2)
        gradient = (turned @ r[..., None])[..., 0]
        at = unit[live]
        stuck = keep[live] | ((at <= 0.0) & (gradient > 0.0)) | ((at >= 1.0) & (gradient < 0.0))
        normal = turned @ J
        step = _damped_step(normal, gradient, damping[live], stuck)
        trial = np.clip(at + step, 0.0, 1.0)
        step = trial - at
        promise = -np.einsum("nk,nk->n", step, 2.0 * gradient) - np.einsum(
            "nk,nkl,nl->n", step, normal, step
        )
        done = (promise < least_gain) | (np.abs(step).max(axis=1) < _SMALL_STEP)
        # A step cut at the boundary may promise nothing though a shorter way goes on.
        cut = done & (promise <= 0.0) & (np.abs(step).max(axis=1) >= _SMALL_STEP)
        done &= ~cut
        r_new, J_new = _evaluate(space, problem, trial)
        evaluations += len(trial)
        cost_new = _squares(r_new)
        better = cost_new < cost[live]
        with np.errstate(over="ignore"):  # a step that promised nothing; the gain is clipped
            gain = (cost[live] - cost_new) / np.maximum(promise, 1e-300)
        yes, no = live[better], live[~better]
        unit[yes], cost[yes] = trial[better], cost_new[better]
        residual[yes], jacobian[yes] = r_new[better], J_new[better]
        # Nielsen 1999 (IMM-REP-1999-05): damping follows the quality of the quadratic model.
        damping[yes] *= np.maximum(1.0 / 9.0, 1.0 - (2.0 * np.clip(gain[better], 0, 1) - 1.0) ** 3)
        growth[yes] = 2.0
        damping[no] *= growth[no]
        growth[no] *= 2.0
        converged[live[done]] = True
        lost = damping[live] > _MOST_DAMPING
        live = live[~(done | lost)]
    normal = np.swapaxes(jacobian, 1, 2) @ jacobian
    return Polished(unit, cost, normal, converged, iteration, evaluations)


def _evaluate(space: ParameterSpace, problem: LeastSquares, unit: Array) -> tuple[Array, Array]:
    parameters = space.from_unit(unit)
    return problem.differences(parameters), problem.slopes(parameters) @ unit_slopes(space, unit)


def _squares(residual: Array) -> Array:
    cost = np.einsum("nm,nm->n", residual, residual)
    return np.where(np.isfinite(cost), cost, np.inf)


def _damped_step(normal: Array, gradient: Array, damping: Array, stuck: NDArray[np.bool_]) -> Array:
    """Return Marquardt's step (n, k), zero where stuck."""
    free = ~stuck
    matrix = np.where(free[:, :, None] & free[:, None, :], normal, 0.0)
    diagonal = np.einsum("nkk->nk", matrix)
    scale = np.maximum(diagonal, 1e-12 * diagonal.max(axis=1, keepdims=True))
    add = np.where(free, damping[:, None] * scale + 1e-300, 1.0)
    k = normal.shape[-1]
    matrix = matrix + add[:, :, None] * np.eye(k)
    return np.asarray(-np.linalg.solve(matrix, np.where(free, gradient, 0.0)[..., None])[..., 0])
