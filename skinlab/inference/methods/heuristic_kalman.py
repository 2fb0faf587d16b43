"""The heuristic Kalman algorithm, which the paper names as its Kalman variant (2.4): `hka`.

Candidates come from a Gaussian instead of a box. The mean ξ and the variances V of the N_b best are
taken for a measurement of the optimum with its noise, and a Kalman filter moves the Gaussian's mean
m and standard deviations S towards it; a slowdown coefficient keeps it from shrinking too soon.
Toscano and Lyonnet 2009, "Heuristic Kalman algorithm for solving optimization problems", IEEE
Trans. Syst. Man Cybern. B 39:1231-1244, and "Robust PID controller tuning based on the heuristic
Kalman algorithm", Automatica 45:2099-2106. As there, the unknowns' covariances are left out, and
the Gaussian starts in the middle of the box with one sixth of its width for S.

Two things differ. Unknowns are points of the space's unit cube, because the slowdown mixes their
variances, which X1 in MPa and ν do not share. What is drawn outside of the cube is no candidate.

The slowdown's max W is of variances. The papers could not be read again; other people's programs,
written from Toscano's book (2024, "Solving Optimization Problems with the Heuristic Kalman
Algorithm", Springer), have it so: a = α s² / (s² + max P), s = min(1, mean √V).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.methods.base import Method, Option
from skinlab.inference.problem import Estimate, Options, Problem, check

Array = NDArray[np.float64]

SLOWDOWN = Option(  # α, how fast the Gaussian may shrink
    "slowdown",
    0.4,
    "the lower, the slower it narrows, 0 to 1",
    "more than 0, at most 1",
    lambda value: 0.0 < value <= 1.0,
)


def identify(problem: Problem, options: Options, rng: np.random.Generator) -> Estimate:
    """Return the best of all candidates, when the N_b best of a draw agree in E to within C.

    The source asks instead that these be near each other, in units that X1 and ν do not share.

    Raises:
        InputError: an option is out of its range.
    """
    check(options)
    slowdown = SLOWDOWN.of(options)
    space = problem.space
    n = len(space.names)
    mean, deviation = np.full(n, 0.5), np.full(n, 1.0 / 6.0)
    answer, least = mean, np.inf
    evaluations = 0
    for iteration in range(1, options.most_iterations + 1):
        drawn = rng.normal(mean, deviation, (options.samples, n))
        candidates = drawn[((drawn >= 0.0) & (drawn <= 1.0)).all(axis=1)]
        evaluations += len(candidates)
        error = problem.error_um(space.from_unit(candidates))
        order = np.argsort(error, kind="stable")[: options.best]
        order = order[np.isfinite(error[order])]
        if order.size < 2:
            continue  # no variance: draw again
        if error[order[0]] < least:
            answer, least = candidates[order[0]], float(error[order[0]])
        if error[order[-1]] - error[order[0]] <= options.tolerance_um:
            return Estimate(space.from_unit(answer), least, iteration, evaluations, converged=True)
        mean, deviation = update(mean, deviation, candidates[order], slowdown)
    return Estimate(
        space.from_unit(answer), least, options.most_iterations, evaluations, converged=False
    )


def update(mean: Array, deviation: Array, best: Array, slowdown: float) -> tuple[Array, Array]:
    """Return the Gaussian's next mean and standard deviations (k,), given the best (N_b, k).

    L = S² / (S² + V), m ← m + L (ξ − m), W = (1 − L) S², S ← S + a (√W − S), with
    a = α v / (v + max W), v = min(1, (mean √V)²) and α the slowdown coefficient, 0 < α ≤ 1.
    """
    prior, noise = deviation**2, best.var(axis=0)
    gain = prior / (prior + noise)
    posterior = (1.0 - gain) * prior
    v = min(1.0, float(np.sqrt(noise).mean()) ** 2)
    a = slowdown * v / (v + float(posterior.max()))
    return mean + gain * (best.mean(axis=0) - mean), deviation + a * (
        np.sqrt(posterior) - deviation
    )


METHOD = Method(
    "hka",
    identify,
    "the heuristic Kalman algorithm: random candidates from a Gaussian, which is drawn towards the "
    "best ones",
    (SLOWDOWN,),
    in_papers_box=True,
)
