"""The default, `auto`: a global stochastic search that keeps every valley, then a polish.

N candidates over the whole space; the best of all and the best of each slice along the last unknown
(ν, along which the valley runs) are polished by least squares, all at once. The paper's shrinking
box commits itself to a part of the valley before it has seen the bottom; here nothing is dropped
until it has been walked down.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.identify.polish import polish
from skinlab.identify.problem import Estimate, Options, Problem, check

_BEST = 8  # starts that are the best of all candidates
_SLICES = 8  # and of each of these
_ALIKE = 1e-4  # of the cube: minima closer than this are one

Array = NDArray[np.float64]


def identify(
    problem: Problem, options: Options, rng: np.random.Generator, *, start: Array | None = None
) -> Estimate:
    """Return the best of several polished starts, and the other minima with it.

    With a `start` (p,) near the optimum only that and the best of each slice are polished.

    Raises:
        InputError: an option is out of its range (see `stochastic`).
    """
    check(options)
    space = problem.space
    unit = rng.random((options.samples, len(space.names)))
    cost = problem.misfit(space.from_unit(unit))
    order = np.argsort(cost, kind="stable")
    place = np.minimum((unit[order, -1] * _SLICES).astype(int), _SLICES - 1)
    firsts = np.unique(place, return_index=True)[1]
    if start is None:
        chosen = np.unique(np.concatenate([np.arange(min(_BEST, len(order))), firsts]))
        starts = unit[order[chosen]]
    else:
        starts = np.vstack([space.to_unit(start), unit[order[firsts[:4]]]])
    found = polish(space, problem.misfit, starts, most_iterations=options.most_iterations)
    best = np.argsort(found.cost, kind="stable")
    parameters = space.from_unit(found.unit[best[0]])
    return Estimate(
        parameters,
        float(problem.error_um(parameters[None])[0]),
        found.iterations,
        options.samples + found.evaluations,
        converged=bool(found.converged[best[0]] and np.isfinite(found.cost[best[0]])),
        minima=_distinct(found.unit[best[np.isfinite(found.cost[best])]]),
    )


def _distinct(unit: Array) -> Array:
    """Return the points (m, k) without those that an earlier one is close to."""
    kept: list[Array] = []
    for point in unit:
        if all(np.abs(point - other).max() > _ALIKE for other in kept):
            kept.append(point)
    return np.array(kept).reshape(-1, unit.shape[1])


METHOD = ("auto", identify)
