"""Recursive least squares with a forgetting factor, in repeated passes (eqs. (14)-(16)): `rls`.

Sample by sample, H = ∂Ω(p_t)/∂x a row: A = P Hᵀ (H P Hᵀ + λ)⁻¹, x ← x + A (M_t − Ω_t),
P ← (P − A H P) / λ, λ ← λ0 λ + (1 − λ0), λ starting at λ0. A pass is one run over the curve; each
starts with P = I and λ = λ0 again. With λ0 = 1 a pass of a linear problem minimises
Σ (M − Ω)² + ‖x − x₀‖²/P₀: one step of the proximal-point method, which repeated ends at least
squares.

P = I speaks of the unknowns in their own units (MPa, MPa and 1) and of deflections in mm. It says
how far a pass may go: a larger one (`covariance`) is nearer to Gauss-Newton, faster and less sure.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from skinlab.identify.gauss_newton import Search, unit_slopes
from skinlab.identify.problem import Estimate, Options, Problem

Array = NDArray[np.float64]


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
    forgetting: float = 0.9,
    covariance: float = 1.0,
) -> Estimate:
    """Return where a pass changes E by no more than C; from `start` (k,) or the minimal values.

    `forgetting` is λ0, `covariance` the diagonal of P at a pass's start. Estimates that leave the
    space are moved to its boundary; a step that ends where there is no model is taken
    back. `options.most_iterations` bounds the passes.
    """
    del rng  # nothing is drawn
    search = Search(problem)
    unit, error = search.begin(start)
    if not np.isfinite(error):
        return search.end(unit, error, 0, converged=False)
    for iteration in range(1, options.most_iterations + 1):
        unit = _one_pass(problem, search, unit, forgetting, covariance)
        previous, error = error, float(search.error_um(unit[None])[0])
        if abs(previous - error) <= options.tolerance_um:
            return search.end(unit, error, iteration, converged=True)
    return search.end(unit, error, options.most_iterations, converged=False)


def _one_pass(
    problem: Problem, search: Search, unit: Array, forgetting: float, covariance: float
) -> Array:
    """Return the estimate (k,), a point of the unit cube, after one run over the samples."""
    to_unit = np.linalg.inv(unit_slopes(problem.space, unit))
    P = covariance * to_unit @ to_unit.T
    factor = forgetting
    sampled = isinstance(problem.misfit, Sampled)
    count = problem.points if sampled else len(search.residuals(unit))
    held = unit  # the last estimate at which there is a model
    for t in range(count):
        difference, H = _sample(problem, search, unit, t)
        if not (np.isfinite(difference) and np.isfinite(H).all()):
            unit = held
            difference, H = _sample(problem, search, unit, t)
        held = unit
        A = P @ H / (H @ P @ H + factor)
        unit = np.clip(unit + A * difference, 0.0, 1.0)
        P = (P - np.outer(A, H @ P)) / factor
        P = 0.5 * (P + P.T)  # round-off must not tilt it
        factor = forgetting * factor + (1.0 - forgetting)
    return unit if np.isfinite(search.error_um(unit[None])[0]) else held


def _sample(problem: Problem, search: Search, unit: Array, t: int) -> tuple[float, Array]:
    """Return M − Ω, mm, at sample t and its slopes (k,) by the unit cube's coordinates.

    A misfit without samples gives its residuals for them, which weighs them in another order.
    """
    if not isinstance(problem.misfit, Sampled):
        return -float(search.residuals(unit)[t]), search.jacobian(unit)[t]
    search.evaluations += 1
    difference, by_parameters = problem.misfit.sample(problem.space.from_unit(unit), t)
    return difference, by_parameters @ unit_slopes(problem.space, unit)


METHOD = ("rls", identify)
