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
_STEP = 1e-6  # of the unit cube, for differences

Array = NDArray[np.float64]


def identify(problem: Problem, options: Options, rng: np.random.Generator) -> Estimate:
    """Return the best of several polished starts.

    Raises:
        InputError: an option is out of its range (see `stochastic`).
    """
    space = problem.space
    n = len(space.names)
    rough = stochastic.identify(problem, options, rng)
    spread = rng.random((options.samples, n))
    error = problem.error_um(space.from_unit(spread))
    order = np.argsort(error, kind="stable")[: _STARTS - 1]
    starts = [space.to_unit(rough.parameters), *spread[order]]
    evaluations = rough.evaluations + options.samples
    best, iterations, converged = rough, rough.iterations, rough.converged
    for start in starts:
        found = _polish(problem, np.clip(start, _STEP, 1 - _STEP))
        if found is None:
            continue
        evaluations += found.evaluations
        iterations += found.iterations
        if found.error_um <= best.error_um:
            best, converged = found, found.converged
    return Estimate(best.parameters, best.error_um, iterations, evaluations, converged)


def _polish(problem: Problem, start: Array) -> Estimate | None:
    """Return the nearest minimum, or None where there is no model at the start."""
    space = problem.space
    spent = 0

    def residuals(unit: Array) -> Array:
        nonlocal spent
        spent += 1
        return problem.misfit.residuals(space.from_unit(unit))

    def jacobian(unit: Array) -> Array:
        columns = []
        for d in range(len(unit)):
            shift = np.zeros(len(unit))
            shift[d] = _STEP
            rise = residuals(unit + shift) - residuals(unit - shift)
            columns.append(rise / (2 * _STEP))
        # Next to where the model ends a difference may have no value: that way is no way.
        return np.nan_to_num(np.column_stack(columns), nan=0.0)

    if not np.isfinite(residuals(start)).all():
        return None
    fit = least_squares(
        residuals,
        start,
        jac=jacobian,
        bounds=(np.zeros(len(start)), np.ones(len(start))),
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-14,
        max_nfev=100,
    )
    parameters = space.from_unit(fit.x)
    error = float(problem.error_um(parameters[None])[0])
    return Estimate(parameters, error, int(fit.nfev), spent, converged=bool(fit.success))


METHOD = ("auto", identify)
