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

_FIRST_DAMPING = 1e-3
_MOST_DAMPING = 1e12
_SMALL_STEP = 1e-10  # of the unit cube
_BEFORE_GIVING_UP = 2  # steps: by the first ones nothing can be told


@dataclass(frozen=True, eq=False)
class Polished:
    """Where the starts ended. `cost` (n,) is the sum of squares, infinite without a model."""

    unit: Array  # (n, k)
    cost: Array
    normal: Array  # (n, k, k) JᵀJ there, by the unit cube's coordinates
    converged: NDArray[np.bool_]  # (n,)
    iterations: int
    evaluations: int


def polish(
    space: ParameterSpace,
    problem: LeastSquares,
    starts: Array,
    *,
    held: NDArray[np.bool_] | None = None,
    least_gain: float = 1e-14,
    most_iterations: int = 100,
    hopeless: float = np.inf,
) -> Polished:
    """Return the minima that starts (n, k) lead to.

    `held` (n, k) says which unknowns keep their value; a start has converged when its next step
    promises less than `least_gain` (in the unit of the sum) or is below 1e-10 of the cube. After
    two steps a start whose next one promises to stay above a cost of `hopeless` is given up.
    """
    unit = np.clip(starts, 0.0, 1.0)
    n, k = unit.shape
    keep = np.zeros((n, k), dtype=bool) if held is None else held
    cost, gradient, normal = _evaluate(space, problem, unit)
    damping = np.full(n, _FIRST_DAMPING)
    growth = np.full(n, 2.0)
    converged = np.zeros(n, dtype=bool)
    evaluations, iteration = n, 0
    live = np.flatnonzero(np.isfinite(cost))
    while live.size and iteration < most_iterations:
        iteration += 1
        at, down, curvature = unit[live], gradient[live], normal[live]
        stuck = keep[live] | ((at <= 0.0) & (down > 0.0)) | ((at >= 1.0) & (down < 0.0))
        step = _damped_step(curvature, down, damping[live], stuck, at)
        trial = np.clip(at + step, 0.0, 1.0)
        step = trial - at
        longest = np.abs(step).max(axis=1)
        bent = (curvature @ step[..., None])[..., 0]
        promise = -np.einsum("nk,nk->n", step, 2.0 * down + bent)
        done = (promise < least_gain) | (longest < _SMALL_STEP)
        lost = (cost[live] - promise > hopeless) & (iteration > _BEFORE_GIVING_UP)
        found = _evaluate(space, problem, trial)
        evaluations += len(trial)
        better = found[0] < cost[live]
        with np.errstate(over="ignore"):  # a step that promised nothing; the gain is clipped
            gain = (cost[live] - found[0]) / np.maximum(promise, 1e-300)
        yes, no = live[better], live[~better]
        unit[yes] = trial[better]
        for kept, new in zip((cost, gradient, normal), found, strict=True):
            kept[yes] = new[better]
        # Nielsen 1999 (IMM-REP-1999-05): damping follows the quality of the quadratic model.
        damping[yes] *= np.maximum(1.0 / 9.0, 1.0 - (2.0 * np.clip(gain[better], 0, 1) - 1.0) ** 3)
        growth[yes] = 2.0
        damping[no] *= growth[no]
        growth[no] *= 2.0
        converged[live[done]] = True
        lost |= damping[live] > _MOST_DAMPING
        live = live[~(done | lost)]
    return Polished(unit, cost, normal, converged, iteration, evaluations)


def _evaluate(
    space: ParameterSpace, problem: LeastSquares, unit: Array
) -> tuple[Array, Array, Array]:
    """Return |r|² (n,), infinite without a model, Jᵀr (n, k) and JᵀJ (n, k, k)."""
    parameters = space.from_unit(unit)
    residual = problem.differences(parameters)
    by_parameters = np.swapaxes(problem.slopes(parameters), 1, 2)
    turned = np.swapaxes(space.by_unit(parameters), 1, 2) @ by_parameters
    rows = np.concatenate([turned, residual[:, None]], axis=1)  # one product for all three
    products = rows @ np.swapaxes(rows, 1, 2)
    cost = products[:, -1, -1]
    cost = np.where(np.isfinite(cost), cost, np.inf)
    return cost, products[:, :-1, -1].copy(), products[:, :-1, :-1].copy()


def _damped_step(
    normal: Array, gradient: Array, damping: Array, stuck: NDArray[np.bool_], at: Array
) -> Array:
    """Return Marquardt's step (n, k) from a place (n, k) in the cube, zero where stuck.

    It ends at the first wall and goes on along it, to the least of the quadratic there: a step that
    is merely cut at the cube is none for the other unknowns, and may lead up.
    """
    n, k = gradient.shape
    held = stuck.copy()
    diagonal = np.einsum("nkk->nk", np.where(held[:, :, None] | held[:, None, :], 0.0, normal))
    scale = np.maximum(diagonal, 1e-12 * diagonal.max(axis=1, keepdims=True))
    damped = normal + (damping[:, None] * scale + 1e-300)[:, :, None] * np.eye(k)
    step = np.zeros((n, k))
    for _ in range(k + 1):
        free = ~held
        matrix = np.where(free[:, :, None] & free[:, None, :], damped, 0.0) + np.where(
            held[:, :, None], np.eye(k), 0.0
        )
        along = (damped @ np.where(held, step, 0.0)[..., None])[..., 0]
        goal = np.linalg.solve(matrix, np.where(free, -gradient - along, step)[..., None])[..., 0]
        way = np.where(free, goal - step, 0.0)
        room = np.where(way > 0.0, 1.0 - at, -at) - step
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(way == 0.0, np.inf, np.maximum(room / way, 0.0))
        first = share.argmin(axis=1)
        least = np.take_along_axis(share, first[:, None], axis=1)
        step = step + np.minimum(least, 1.0) * way
        walled = np.flatnonzero(least[:, 0] < 1.0)
        if not walled.size:
            break
        held[walled, first[walled]] = True
    return step
