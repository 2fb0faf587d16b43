"""Gauss-Newton as the paper compares with (section 3.1, eqs. (12.a) and (13)): `gn`.

With F = ∂Ω/∂x, and not ∂D/∂x as printed, which climbs: x ← x + W, W = (FᵀF)⁻¹ Fᵀ (M − Ω). A step
that leaves the space ends on its boundary, which is where the paper's runs got stuck. Unknowns are
points of the space's unit cube; for a box, where that is a change of units, the steps are the same.
Also here: what the methods that use slopes share.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.methods.base import Method
from skinlab.inference.problem import Estimate, Options, Problem

Array = NDArray[np.float64]

_STEP = 1e-6  # of the unit cube, for differences
_DIAGONAL = 101  # points at which a start is looked for
_HALVINGS = 20


def identify(
    problem: Problem, options: Options, rng: np.random.Generator, *, start: Array | None = None
) -> Estimate:
    """Return where E changes by no more than C, from `start` (k,) or the space's minimal values.

    Where a whole step ends at a point without a model, it is halved until it does not.
    """
    del rng  # nothing is drawn
    search = Search(problem)
    unit, error = search.begin(start)
    for iteration in range(1, options.most_iterations + 1):
        step = search.step(unit)
        if step is None:
            return search.end(unit, error, iteration, converged=False)
        previous = error
        for halving in range(_HALVINGS):
            trial = np.clip(unit + step * 0.5**halving, 0.0, 1.0)
            error = float(search.error_um(trial[None])[0])
            if np.isfinite(error):
                break
        else:
            return search.end(unit, previous, iteration, converged=False)
        unit = trial
        if abs(previous - error) <= options.tolerance_um:
            return search.end(unit, error, iteration, converged=True)
    return search.end(unit, error, options.most_iterations, converged=False)


class Search:
    """A problem as functions of the unit cube, with its evaluations counted."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self.evaluations = 0

    def error_um(self, unit: Array) -> Array:
        """Return E (n,), µm, at points (n, k); infinite where there is no model."""
        self.evaluations += len(unit)
        return self._problem.error_um(self._problem.space.from_unit(unit))

    def residuals(self, unit: Array) -> Array:
        """Return the residuals Ω − M (m,), mm, at a point (k,); NaN where there is no model."""
        self.evaluations += 1
        return self._problem.residuals(self._problem.space.from_unit(unit))

    def jacobian(self, unit: Array) -> Array:
        """Return derivatives (m, k) of `residuals`, mm, at a point (k,).

        They are differences where the misfit's own are NaN. Those stay inside the cube and where
        there is a model, one-sided if need be; NaN where it is missing on both sides.
        """
        space = self._problem.space
        self.evaluations += 1
        parameters = space.from_unit(unit)
        known = self._problem.misfit.slopes(parameters[None])[0]
        slopes = np.vstack([known, np.zeros(known.shape[1])]) @ space.by_unit(parameters)
        if np.isfinite(slopes).all():
            return np.asarray(slopes)
        here = self.residuals(unit)
        columns = np.empty((len(here), len(unit)))
        for d, axis in enumerate(np.eye(len(unit))):
            low, high = (np.clip(unit + s * axis, 0.0, 1.0) for s in (-_STEP, _STEP))
            at_low, at_high = self.residuals(low), self.residuals(high)
            if not np.isfinite(at_low).all():
                low, at_low = unit, here
            elif not np.isfinite(at_high).all():
                high, at_high = unit, here
            columns[:, d] = (at_high - at_low) / (high[d] - low[d])
        return columns

    def begin(self, start: Array | None) -> tuple[Array, float]:
        """Return the first point (k,), and E there in µm.

        Without a `start` (k,), in the parameters' units, it is the paper's, the minimal values of
        the space; where the model does not hold there, the first point of the cube's diagonal at
        which it does.
        """
        space = self._problem.space
        if start is not None:
            units = np.clip(space.to_unit(start), 0.0, 1.0)[None]
        else:
            units = np.linspace(0.0, 1.0, _DIAGONAL)[:, None] * np.ones(len(space.names))
        error = self.error_um(units)
        first = int(np.argmax(np.isfinite(error)))  # the first of all where there is none
        return units[first], float(error[first])

    def step(self, unit: Array, *, inwards: bool = False) -> Array | None:
        """Return W (k,) of eq. (13) at a point (k,), None where there is no model.

        `inwards` keeps unknowns that are on the boundary there when the misfit falls outwards;
        without it the others' part of the step is wrong for a step that is cut at the boundary.
        """
        r, F = self.residuals(unit), self.jacobian(unit)
        if not (np.isfinite(r).all() and np.isfinite(F).all()):
            return None
        free = np.ones(len(unit), dtype=bool)
        if inwards:
            gradient = F.T @ r
            free = ~(((unit <= 0.0) & (gradient > 0.0)) | ((unit >= 1.0) & (gradient < 0.0)))
        step = np.zeros(len(unit))
        # The same as (FᵀF)⁻¹ Fᵀ without squaring F's condition; the shortest where F is singular.
        step[free] = np.linalg.lstsq(F[:, free], -r, rcond=None)[0]
        return step

    def end(self, unit: Array, error_um: float, iterations: int, *, converged: bool) -> Estimate:
        """Return the answer at a point (k,)."""
        parameters = self._problem.space.from_unit(unit)
        return Estimate(parameters, error_um, iterations, self.evaluations, converged)


METHOD = Method("gn", identify, "Gauss-Newton from the lowest values", in_papers_box=True)
