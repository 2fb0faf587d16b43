"""The default, `auto`: a global stochastic search that keeps every valley, then a polish.

N candidates over the whole space; the best of all and the best of each patch of the last two
unknowns (X2 and ν, along which the valleys run) are walked downhill by least squares for a few
steps, all at once, and the best of those to the bottom. The paper's shrinking box commits itself to
a part of the valley before it has seen the bottom; here nothing is dropped until it has been walked
down. Patches of ν alone are not enough: where skins crease the space ends in stairs, at which the
starts of one side stop.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.methods.base import Method
from skinlab.inference.optimise import polish
from skinlab.inference.problem import Estimate, Options, Problem, check
from skinlab.inference.settings import STARTS

Array = NDArray[np.float64]


def identify(
    problem: Problem, options: Options, rng: np.random.Generator, *, start: Array | None = None
) -> Estimate:
    """Return the best of several polished starts, and the other minima with it.

    With a `start` (p,) near the optimum only that and the best of a few patches are polished.

    Raises:
        InputError: an option is out of its range (see `stochastic`).
    """
    check(options)
    space = problem.space
    unit = rng.random((options.samples, len(space.names)))
    cost = problem.misfit(space.from_unit(unit))
    order = np.argsort(cost, kind="stable")
    patches = (unit[order, -2:] * STARTS.patches).astype(int)
    place = np.ravel_multi_index(tuple(patches.T), STARTS.patches)
    firsts = np.sort(np.unique(place, return_index=True)[1])
    iterations, evaluations = 0, options.samples
    if start is None:
        chosen = np.unique(np.concatenate([np.arange(min(STARTS.best, len(order))), firsts]))
        walked = polish(
            space,
            problem.misfit,
            unit[order[chosen]],
            most_iterations=min(STARTS.first_steps, options.most_iterations),
        )
        by_cost = walked.unit[np.argsort(walked.cost, kind="stable")]
        starts = _distinct(by_cost, STARTS.apart)[: STARTS.kept]
        iterations, evaluations = walked.iterations, evaluations + walked.evaluations
    else:
        starts = np.vstack([space.to_unit(start), unit[order[firsts[: STARTS.growing_firsts]]]])
    found = polish(space, problem.misfit, starts, most_iterations=options.most_iterations)
    best = np.argsort(found.cost, kind="stable")
    parameters = space.from_unit(found.unit[best[0]])
    return Estimate(
        parameters,
        float(problem.error_um(parameters[None])[0]),
        iterations + found.iterations,
        evaluations + found.evaluations,
        converged=bool(found.converged[best[0]] and np.isfinite(found.cost[best[0]])),
        minima=_distinct(found.unit[best[np.isfinite(found.cost[best])]], STARTS.alike),
    )


def _distinct(unit: Array, apart: float) -> Array:
    """Return the points (m, k) without those that an earlier one is closer to than `apart`."""
    kept: list[Array] = []
    for point in unit:
        if all(np.abs(point - other).max() > apart for other in kept):
            kept.append(point)
    return np.array(kept).reshape(-1, unit.shape[1])


METHOD = Method(
    "auto",
    identify,
    "many random candidates over all that is possible, the best ones of every part of it walked "
    "down to the bottom of their valley by least squares; the lowest is the answer",
)
