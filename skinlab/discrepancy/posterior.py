"""How sure an explanation's parameters are: draws from its posterior, not a Gaussian at its best.

The valley is followed as in the identification of a curve (inference/posterior.py); the model stays
anchored at the fit, and asks the finite elements where that matters.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.fit import Fit, Fitter, Misfit
from skinlab.discrepancy.space_mapping import MappedModel
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.inference.error_choice import ErrorChoice
from skinlab.inference.intervals import at_an_end, correlation, summary
from skinlab.inference.marginal import IntegratedErrors
from skinlab.inference.posterior import Draws
from skinlab.inference.posterior import sample as follow_the_valley
from skinlab.inference.settings import INTERVALS, POSTERIOR
from skinlab.parameters import Space

Array = NDArray[np.float64]

_DRAWS = 600  # a round
# Valley points that promise to stay so much above the best after two steps are not followed to
# their end: of 381 that ended within 30 none did. Half of the evaluations.
_HOPELESS_CHI2 = 100.0
# Rounds in which finite elements are asked at so many points, until no density there changes by so
# much of the highest. Steps in time take longer: what relaxes has fewer rounds.
_ROUNDS, _ROUNDS_RELAXING, _ASKED, _OFF = 6, 3, 6, 0.1
_TEMPER, _FAR = 0.5, 25.0  # of a log density: what seems unlikely may not be
_GAUSSIAN_DRAWS = 2000


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weighted draws of an explanation's unknowns; `weight` (n,) sums up to 1."""

    unknowns: Unknowns
    best: Array  # (k,) the optimum
    u: Array  # (n, k)
    weight: Array
    log_density: Array  # (n,) up to a constant

    @cached_property
    def parameters(self) -> dict[str, dict[str, float]]:
        """Medians with the shortest 90 % intervals, by name."""
        low, high = (self.unknowns.named(u) for u in self.unknowns.bounds)
        space, found = self.unknowns.space, {}
        first, last = self.unknowns.bounds
        at_end = at_an_end((self.u - first) / (last - first))
        logarithmic = {
            n for n, t in zip(space.names, space.transforms, strict=True) if t != "linear"
        } | {axis.name for axis in self.unknowns.axes if axis.parameter.zero is None}
        for name, values in self._named().items():
            bounds = (low[name], high[name])
            middle, *ends = summary(
                values, self.weight, self.log_density, bounds,
                logarithmic=name in logarithmic, at_end=at_end, inside=INTERVALS.level,
            )  # fmt: skip
            found[name] = {"value": middle, "low": ends[0], "high": ends[1]}
        return found

    @property
    def deviations(self) -> Array:
        """Standard deviations (k,) of the unknowns."""
        off = self.u - self.weight @ self.u
        return np.asarray(np.sqrt(self.weight @ np.square(off)))

    @property
    def correlation(self) -> tuple[tuple[float, ...], ...]:
        """Correlation matrix of the parameters, in the order of `parameters`."""
        return correlation(np.column_stack(list(self._named().values())), self.weight)

    def _named(self) -> dict[str, Array]:
        rows = [self.unknowns.named(u) for u in self.u]
        return {name: np.array([row[name] for row in rows]) for name in self.unknowns.names}


def sample(fitter: Fitter, fit: Fit, errors: ErrorChoice, rng: np.random.Generator) -> Posterior:
    """Return draws from the posterior about a fit by the likeliest of these errors.

    The errors' own parameters are integrated out.
    """
    unknowns = fit.unknowns
    model = fitter.model(unknowns)
    if not fitter.prepare(model, fit.u, slopes=True):
        return gaussian(fit)
    low, high = unknowns.bounds
    space = Space.box(unknowns.names, low.tolist(), high.tolist())
    best, likeliest = np.concatenate(model.predict(fit.u)), fit.u
    density = _LogDensity(fitter, model, best, errors)
    draws: Draws | None = None
    rounds = (_ROUNDS if model.sloped else _ROUNDS_RELAXING) if model.corrected else 0
    for left in range(rounds, -1, -1):
        if draws is None or draws.effective < POSTERIOR.enough:
            try:
                draws = follow_the_valley(
                    space, Misfit(fitter, model), space.to_unit(likeliest)[None], rng,
                    log_density=density, draws=_DRAWS, hopeless_chi2=_HOPELESS_CHI2,
                )  # fmt: skip
            except ValueError:  # nothing can be drawn about this minimum
                return gaussian(fit)
        if not left:
            break
        # By slopes at the fit a far skin may seem likely that is not, and a likely one impossible:
        # by 134 of a log density. So the finite elements are asked where it matters most.
        asked = _worth_asking(model, draws)
        before = density(asked)
        model.learn(asked)
        density = _LogDensity(fitter, model, best, errors)
        draws = draws.reweighted(density(draws.parameters))
        after = density(asked)
        every, u = np.concatenate([draws.log_target, after]), np.vstack([draws.parameters, asked])
        likeliest = u[np.argmax(every)]
        off = np.abs(np.exp(after - every.max()) - np.exp(before - every.max()))
        if off.max() <= _OFF and draws.effective >= POSTERIOR.least:
            break
    assert draws is not None
    return Posterior(unknowns, fit.u, draws.parameters, draws.weight, draws.log_target)


class _LogDensity:
    """The log density of unknowns (n, k): the errors' parameters are integrated out."""

    def __init__(
        self, fitter: Fitter, model: MappedModel, best_mm: Array, errors: ErrorChoice
    ) -> None:
        self._model, self._best_mm, self._misfit = model, best_mm, Misfit(fitter, model)
        self._errors = IntegratedErrors(fitter.measured - best_mm, errors)

    def __call__(self, u: Array) -> Array:
        moved = np.hstack(self._model.predict_many(u)) - self._best_mm
        found = -0.5 * np.square(self._misfit.priors(u)).sum(axis=1)
        holds = np.isfinite(moved).all(axis=1)
        if holds.any():
            found[holds] += self._errors(moved[holds])
        return np.where(holds, found, -np.inf)


def _worth_asking(model: MappedModel, draws: Draws) -> Array:
    """Return unknowns (p, k) where corrections are little known, for how likely they may be."""
    behind = draws.log_target.max() - draws.log_target
    some = np.flatnonzero(behind < _FAR)
    points, off = model.points, model.from_anchor(draws.parameters[some])
    found: list[int] = []
    for _ in range(_ASKED):
        with np.errstate(divide="ignore"):
            worth = np.log(points.doubt(off).clip(0.0)) - _TEMPER * behind[some]
        found.append(int(np.argmax(worth)))
        points = points.also(off[found[-1:]])
    return np.asarray(draws.parameters[some[found]])


def gaussian(fit: Fit) -> Posterior:
    """Return draws from the Gaussian at a fit's optimum, cut off at the bounds: quick and rough."""
    low, high = fit.unknowns.bounds
    drawn = np.random.default_rng(0).standard_normal((_GAUSSIAN_DRAWS, len(fit.u)))
    u = fit.u + drawn @ _root(fit.information).T
    inside = u[((u >= low) & (u <= high)).all(axis=1)]
    u = inside if len(inside) else fit.u[None]
    off = u - fit.u
    log_density = -0.5 * np.einsum("ni,ij,nj->n", off, fit.information, off)
    return Posterior(fit.unknowns, fit.u, u, np.full(len(u), 1.0 / len(u)), log_density)


def _root(information: Array) -> Array:
    """Return the lower triangular root of its inverse."""
    return np.asarray(np.linalg.cholesky(np.linalg.inv(information)))
