"""Pattern search: from the best of random candidates, one step along each axis at a time.

Source: R. Hooke and T. A. Jeeves, "Direct search solution of numerical and statistical problems",
J. ACM 8 (1961) 212-229, without its pattern moves.
"""

from __future__ import annotations

import numpy as np

from skinlab.inference.methods.base import Method, Option
from skinlab.inference.problem import Estimate, Options, Problem, check

SHRINK = Option(
    "shrink",
    0.5,
    "by what the step is multiplied where none helps",
    "more than 0, less than 1",
    lambda value: 0.0 < value < 1.0,
)

_FIRST = 0.1  # of the cube
_LAST = 1e-6


def identify(problem: Problem, options: Options, rng: np.random.Generator) -> Estimate:
    """Return where no step helps any more. Unknowns are points of the space's unit cube."""
    check(options)
    shrink, space = SHRINK.of(options), problem.space
    drawn = rng.random((options.samples, len(space.names)))
    errors = problem.error_um(space.from_unit(drawn))
    at, error = drawn[np.argmin(errors)], float(errors.min())
    steps = np.vstack([np.eye(len(at)), -np.eye(len(at))])
    size, evaluations = _FIRST, options.samples
    for iteration in range(1, options.most_iterations + 1):
        tried = np.clip(at + size * steps, 0.0, 1.0)
        errors = problem.error_um(space.from_unit(tried))
        evaluations += len(tried)
        best = int(np.argmin(errors))
        if errors[best] < error:
            at, error = tried[best], float(errors[best])
        elif (size := size * shrink) < _LAST:
            return Estimate(
                space.from_unit(at), error, iteration, evaluations, bool(np.isfinite(error))
            )
    return Estimate(space.from_unit(at), error, options.most_iterations, evaluations, False)


METHOD = Method(
    "pattern_search",
    identify,
    "pattern search from the best of random candidates, one step along each axis at a time",
    (SHRINK,),
)
