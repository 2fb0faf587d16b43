"""The default, `auto`: a global stochastic search, then a least-squares polish from several starts.

The paper's box loses the optimum along the flat valley; the polish (trust-region reflective,
scipy) walks the valley to its bottom, and several starts guard against a second one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from skinlab.identify import stochastic
from skinlab.identify.problem import Estimate, Options, Problem

_STARTS = 4


def identify(problem: Problem, options: Options, rng: np.random.Generator) -> Estimate:
    """Return the best of several polished starts.

    Raises:
        InputError: an option is out of its range (see `stochastic`).
    """
    low, high = problem.space.bounds
    scale = high - low  # the parameters' ranges differ by a factor of fifty

    def residuals(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return problem.misfit.residuals(low + scale * x)

    rough = stochastic.identify(problem, options, rng)
    spread = low + (high - low) * rng.random((options.samples, len(low)))
    order = np.argsort(problem.error_um(spread), kind="stable")
    starts = [rough.parameters, *spread[order[: _STARTS - 1]]]
    evaluations = rough.evaluations + options.samples
    best, iterations, converged = rough, rough.iterations, False
    for start in starts:
        inside = np.clip((start - low) / scale, 1e-9, 1 - 1e-9)
        if not np.isfinite(problem.misfit(start[None])[0]):
            continue
        fit = least_squares(
            residuals,
            inside,
            bounds=(np.zeros_like(low), np.ones_like(low)),
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-14,
            max_nfev=200,
        )
        evaluations += int(fit.nfev) * (len(low) + 1)
        iterations += int(fit.nfev)
        parameters = low + scale * fit.x
        error = float(problem.error_um(parameters[None])[0])
        if error <= best.error_um:
            best = Estimate(parameters, error, 0, 0, converged=fit.success)
            converged = bool(fit.success)
    return Estimate(
        best.parameters, best.error_um, iterations, evaluations, converged or rough.converged
    )


METHOD = ("auto", identify)
