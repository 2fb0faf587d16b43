"""Levenberg-Marquardt, scipy's (MINPACK's `lmder`), from the best of N random candidates: `lm`.

MINPACK knows no bounds: it searches θ with sin² θ the point of the space's unit cube, as MINUIT
does for limits (James and Roos 1975, Comput. Phys. Commun. 10:343).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.methods.base import Method
from skinlab.inference.methods.gauss_newton import Search
from skinlab.inference.problem import Estimate, Options, Problem, check

Array = NDArray[np.float64]

_NO_MODEL_MM = 1e6  # a residual no step is taken to
_EDGE = 1e-3  # of the unit cube: closer to its boundary the slope by θ, 0 on it, hides the way


def identify(
    problem: Problem, options: Options, rng: np.random.Generator, *, start: Array | None = None
) -> Estimate:
    """Return the minimum next to `start` (k,), or to the best of `options.samples` candidates.

    `options.most_iterations` bounds the number of steps tried.

    Raises:
        InputError: an option is out of its range.
    """
    from scipy.optimize import least_squares  # slow to import, and seldom asked for

    check(options)
    search = Search(problem)
    if start is None:
        candidates = rng.random((options.samples, len(problem.space.names)))
        unit = candidates[int(np.argmin(search.error_um(candidates)))]
        start = problem.space.from_unit(unit)
    unit, error = search.begin(start)
    if not np.isfinite(error):
        return search.end(unit, error, 0, converged=False)
    iterations = 0

    def residuals(theta: Array) -> Array:
        r = _as_many(search.residuals(np.sin(theta) ** 2), len(theta))
        return r if np.isfinite(r).all() else np.full(len(r), _NO_MODEL_MM)

    def jacobian(theta: Array) -> Array:
        nonlocal iterations
        iterations += 1
        # Next to where the model ends a difference may have no value: that way is no way.
        slopes = search.jacobian(np.sin(theta) ** 2) * np.sin(2.0 * theta)
        return _as_many(np.nan_to_num(slopes, nan=0.0), len(theta))

    fit = least_squares(
        residuals,
        np.arcsin(np.sqrt(np.clip(unit, _EDGE, 1.0 - _EDGE))),
        jac=jacobian,
        method="lm",
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-14,
        max_nfev=options.most_iterations,
    )
    found = np.sin(fit.x) ** 2
    at_found = float(search.error_um(found[None])[0])
    converged = bool(fit.success and np.isfinite(at_found))
    if not at_found <= error:  # `_EDGE` moved a start away from its place, or off the model
        return search.end(unit, error, iterations, converged=converged)
    return search.end(found, at_found, iterations, converged=converged)


def _as_many(rows: Array, least: int) -> Array:
    """Return rows with zeros behind them: MINPACK wants as many residuals as parameters.

    A curve without suction has fewer: one number says all of it.
    """
    missing = max(0, least - len(rows))
    return np.concatenate([rows, np.zeros((missing, *rows.shape[1:]))])


METHOD = Method("lm", identify, "Levenberg-Marquardt from the best of random candidates")
