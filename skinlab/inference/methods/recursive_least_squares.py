"""Recursive least squares with a forgetting factor, in repeated passes (eqs. (14)-(16)): `rls`.

Sample by sample, H = ∂Ω(p_t)/∂x a row: A = P Hᵀ (H P Hᵀ + λ)⁻¹, x ← x + A (M_t − Ω_t),
P ← (P − A H P) / λ, λ ← λ0 λ + (1 − λ0), λ starting at λ0. A pass is one run over the curve. P goes
on from pass to pass and λ starts anew, so that every pass forgets the ones before by the same
factor; the paper leaves both open, and this reading finds its Table 1. If P started anew too, P = I
would hold back every pass, and C end the search far up the valley.

P = I at the start speaks of the unknowns in their own units (MPa, MPa and 1) and of mm: 1 MPa is
far for X1 and little for X2. A larger `covariance` makes the first passes bolder, and is forgotten.

Why 100 passes at most: the paper's blind test ends after 29 with λ0 = 0.9 and after 68 with 0.99,
and a curve that the model does not fit to the last µm can make the estimates swing for ever.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.methods.base import Method, Option
from skinlab.inference.methods.gauss_newton import Search
from skinlab.inference.problem import Estimate, Options, Problem, check

Array = NDArray[np.float64]

FORGETTING = Option(  # λ0
    "forgetting",
    0.9,
    "lambda0, 1 forgets nothing",
    "more than 0, at most 1",
    lambda value: 0.0 < value <= 1.0,
)
COVARIANCE = Option(
    "covariance",
    1.0,
    "diagonal of P at the start; more is bolder",
    "more than 0",
    lambda value: 0.0 < value < math.inf,
)
PASSES = Option("passes", 100, "most runs over a curve", "1 or more", lambda value: value >= 1)

_WOUND_UP = 1e100  # trace of P: a direction that no sample speaks of, forgotten too often


@runtime_checkable
class Sampled(Protocol):
    """A misfit that can be asked sample by sample."""

    def sample(self, parameters: Array, t: int) -> tuple[float, Array]:
        """Return M − Ω, mm, at sample t and ∂Ω/∂x (k,) there; NaN where there is no model."""
        ...


def identify(
    problem: Problem,
    options: Options,
    rng: np.random.Generator,
    *,
    start: Array | None = None,
    watch: Callable[[Array, float], None] = lambda *_: None,
) -> Estimate:
    """Return where a pass changes E by no more than C; from `start` (k,) or the minimal values.

    `watch` is told of the parameters (k,) and E in µm after every pass. Estimates that leave the
    space are moved to its boundary; a step that ends where there is no model is taken back.

    Raises:
        InputError: an option is out of its range.
    """
    del rng  # nothing is drawn
    check(options)
    forgetting, passes = FORGETTING.of(options), PASSES.of(options)
    search = Search(problem)
    unit, error = search.begin(start)
    if not np.isfinite(error):
        return search.end(unit, error, 0, converged=False)
    to_unit = np.linalg.inv(problem.space.by_unit(problem.space.from_unit(unit)))
    P = COVARIANCE.of(options) * to_unit @ to_unit.T
    for iteration in range(1, passes + 1):
        if not np.isfinite(_sample(problem, search, unit, 0)[1]).all():  # the model ends right here
            return search.end(unit, error, iteration, converged=False)
        unit, P = _one_pass(problem, search, unit, P, forgetting)
        previous, error = error, float(search.error_um(unit[None])[0])
        watch(problem.space.from_unit(unit), error)
        if abs(previous - error) <= options.tolerance_um:
            return search.end(unit, error, iteration, converged=True)
        if not np.trace(P) < _WOUND_UP:
            return search.end(unit, error, iteration, converged=False)
    return search.end(unit, error, passes, converged=False)


def _one_pass(
    problem: Problem, search: Search, unit: Array, P: Array, forgetting: float
) -> tuple[Array, Array]:
    """Return the estimate (k,), a point of the unit cube, and P (k, k) after one run."""
    factor = forgetting
    sampled = isinstance(problem.misfit, Sampled)
    count = problem.points if sampled else len(search.residuals(unit))
    held = unit  # the last estimate at which there are slopes
    for t in range(count):
        difference, H = _sample(problem, search, unit, t)
        if not (np.isfinite(difference) and np.isfinite(H).all()):
            unit = held
            difference, H = _sample(problem, search, unit, t)
        held = unit
        A = P @ H / (H @ P @ H + factor)
        unit = np.clip(unit + A * difference, 0.0, 1.0)
        # Eq. (15) in Joseph's form, the same number, which round-off leaves positive.
        rest = np.eye(len(unit)) - np.outer(A, H)
        P = (rest @ P @ rest.T + factor * np.outer(A, A)) / factor
        factor = forgetting * factor + (1.0 - forgetting)
    return (unit if np.isfinite(search.error_um(unit[None])[0]) else held), P


def _sample(problem: Problem, search: Search, unit: Array, t: int) -> tuple[float, Array]:
    """Return M − Ω, mm, at sample t and its slopes (k,) by the unit cube's coordinates.

    A misfit without samples gives its residuals for them, which weighs them in another order.
    """
    if not isinstance(problem.misfit, Sampled):
        return -float(search.residuals(unit)[t]), search.jacobian(unit)[t]
    search.evaluations += 1
    parameters = problem.space.from_unit(unit)
    difference, by_parameters = problem.misfit.sample(parameters, t)
    return difference, by_parameters @ problem.space.by_unit(parameters)


METHOD = Method(
    "rls",
    identify,
    "recursive least squares with forgetting, sample by sample, in repeated passes",
    (FORGETTING, COVARIANCE, PASSES),
    in_papers_box=True,
    most_fitted=500,  # one after another: 5000 in 100 passes took half a minute
)
