"""The paper's stochastic algorithm (sections 2.4 and 2.5), as printed: `sto`.

N candidates are drawn uniformly from a box; the N_b best span the next box; it ends when the best
error of an iteration differs from the one before by no more than C. The boxes are those of the
space's unit cube, which for the paper's space is the same up to scale. They often shrink past the
optimum along the flat valley of this problem, so the answer is near it, not at it.
"""

from __future__ import annotations

import numpy as np

from skinlab.errors import InputError
from skinlab.identify.problem import Estimate, Options, Problem


def identify(problem: Problem, options: Options, rng: np.random.Generator) -> Estimate:
    """Return the best candidate of the last iteration.

    Raises:
        InputError: N_b is not within 2…N, or the tolerance is negative.
    """
    check(options)
    low, high = np.zeros(len(problem.space.names)), np.ones(len(problem.space.names))
    previous = np.inf
    for iteration in range(1, options.most_iterations + 1):
        candidates = low + (high - low) * rng.random((options.samples, len(low)))
        error = problem.error_um(problem.space.from_unit(candidates))
        order = np.argpartition(error, options.best - 1)[: options.best]
        order = order[np.isfinite(error[order])]
        if order.size:
            elite = candidates[order]
            best = int(order[np.argmin(error[order])])
            low, high = elite.min(axis=0), elite.max(axis=0)
            if abs(previous - error[best]) <= options.tolerance_um:
                return Estimate(
                    problem.space.from_unit(candidates[best]),
                    float(error[best]),
                    iteration,
                    iteration * options.samples,
                    converged=True,
                )
            previous = float(error[best])
            last = candidates[best]
    if not np.isfinite(previous):
        last = 0.5 * (low + high)
    return Estimate(
        problem.space.from_unit(last),
        previous,
        options.most_iterations,
        options.most_iterations * options.samples,
        converged=False,
    )


def check(options: Options) -> None:
    """Refuse options that cannot work.

    Raises:
        InputError: names the option and what was expected.
    """
    if options.samples < 2:
        raise InputError(f"samples {options.samples}: expected 2 or more")
    if not 2 <= options.best <= options.samples:
        raise InputError(
            f"best {options.best}: expected 2 to the number of samples, {options.samples}"
        )
    if not options.tolerance_um >= 0:
        raise InputError(f"tolerance_um {options.tolerance_um}: expected zero or more")


METHOD = ("sto", identify)
