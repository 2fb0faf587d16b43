"""Draws from the posterior of a few parameters along its curved, narrow valleys.

The posterior of this problem is a banana hundreds of times longer than wide, so that one Gaussian
at the optimum misses nearly all of it. Therefore the valley is followed: for values of each unknown
in turn all others are optimised (the profile likelihood; all problems in one batch). A Gaussian at
each of these points, as wide as the curvature there and the distance to the next point say, joins a
mixture of Student distributions from which candidates are drawn, and importance weights make the
draws exact (mixture importance sampling: Owen and Zhou 2000, J. Am. Stat. Assoc. 95:135).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.optimise import Polished, polish
from skinlab.inference.problem import SquaredMisfit
from skinlab.inference.settings import POSTERIOR
from skinlab.parameters import ParameterSpace

Array = NDArray[np.float64]


_OFFSETS = np.array(POSTERIOR.offsets)
_AT_ONCE = 50_000  # numbers, which stay in a core's cache
_LESS = 0.8  # of the power of weights that are too uneven
FLAT_PRECISION = 12.0  # of a flat distribution on the unit interval


@dataclass(frozen=True, eq=False)
class Draws:
    """Weighted draws: `unit` (n, k), `parameters` (n, p), `weight` (n,), which sums up to 1.

    `log_target` (n,) is the log density that they are of, up to a constant.
    """

    unit: Array
    parameters: Array
    weight: Array
    log_target: Array
    evaluations: int

    @property
    def effective(self) -> float:
        """Number of independent draws that these are worth (Kish)."""
        return float(1.0 / np.square(self.weight).sum())

    def reweighted(self, log_target: Array) -> Draws:
        """Return the same draws, weighed as of another target, which is little off."""
        held = np.isfinite(self.log_target) & np.isfinite(log_target) & (self.weight > 0.0)
        log_weight = np.full(len(held), -np.inf)
        log_weight[held] = np.log(self.weight[held]) + log_target[held] - self.log_target[held]
        weight = np.exp(log_weight - log_weight.max())
        return replace(self, weight=weight / weight.sum(), log_target=log_target)


def sample(
    space: ParameterSpace,
    misfit: SquaredMisfit,
    modes: Array,
    rng: np.random.Generator,
    *,
    log_density: Callable[[Array], Array] | None = None,
    draws: int = POSTERIOR.draws,
    hopeless_chi2: float = np.inf,
) -> Draws:
    """Return draws from exp(−χ²/2), flat in the space's unit cube otherwise.

    `misfit` is χ²: of whitened residuals, and of Gaussian priors if there are any; `modes` (m, k)
    are points of the cube near its minima. With `log_density`, a function of parameters (n, p), the
    draws are from that, and χ² is what it resembles. Valley points that promise to stay
    `hopeless_chi2` above the best are not followed to their end.

    Raises:
        ValueError: the model has no value at any of them, or no draw is within the bounds.
    """
    at_modes = polish(space, misfit, modes, least_gain=1e-4)
    best = int(np.argmin(at_modes.cost))
    if not np.isfinite(at_modes.cost[best]):
        raise ValueError("there is no model at the minimum")
    least = misfit.rest + float(at_modes.cost[best])
    target = log_density or (lambda parameters: 0.5 * (least - misfit(parameters)))
    valley, spacing = _valley(space, misfit, at_modes, best, hopeless_chi2)
    mixtures = [_mixture(valley.unit, valley.normal, spacing, valley.cost - valley.cost.min())]
    evaluations = at_modes.evaluations + valley.evaluations
    units: list[Array] = []
    densities: list[Array] = []
    while True:
        drawn = mixtures[-1].draw(draws, rng)
        drawn = drawn[((drawn >= 0.0) & (drawn <= 1.0)).all(axis=1)]
        if not len(drawn) and not units:  # a narrow valley against a bound
            raise ValueError("no draw about the minimum lies within the bounds")
        units.append(drawn)
        densities.append(target(space.from_unit(drawn)))
        evaluations += len(drawn)
        unit, log_target = np.concatenate(units), np.concatenate(densities)
        # Every draw counts as one of the mixture of all rounds, whichever it came from.
        log_drawn = log_sum_exp(np.column_stack([m.log_density(unit) for m in mixtures]))
        log_weight = log_target - log_drawn
        weight = np.exp(log_weight - log_weight.max())
        found = Draws(unit, space.from_unit(unit), weight / weight.sum(), log_target, evaluations)
        most = (
            POSTERIOR.most_rounds if found.effective >= POSTERIOR.least else POSTERIOR.more_rounds
        )
        if found.effective >= POSTERIOR.enough or len(mixtures) > most:
            found = replace(found, weight=_evened(found.weight))
            return _with_valley(found, space, target, valley.unit)
        # Where a few draws have nearly all weight these alone would say that nothing is wide.
        found = replace(found, weight=_evened(found.weight))
        centres = _resample(found, rng)
        at = polish(space, misfit, centres, most_iterations=0)
        evaluations += at.evaluations
        width = np.sqrt(found.weight @ np.square(unit - found.weight @ unit)) * POSTERIOR.stride
        mixtures.append(
            _mixture(
                centres,
                at.normal,
                np.tile(width, (len(centres), 1)),
                np.zeros(len(centres)),
            )
        )


def _with_valley(
    found: Draws, space: ParameterSpace, target: Callable[[Array], Array], valley: Array
) -> Draws:
    """Return the draws with points of the valley beside them, of next to no weight.

    Intervals ask for the likeliest skins of each value: in a corner of the cube draws are few.
    """
    between = (np.arange(POSTERIOR.between) / POSTERIOR.between)[:, None, None]
    along = (valley[:-1] + between * np.diff(valley, axis=0)).reshape(-1, valley.shape[1])
    unit = np.clip(np.vstack([along, valley[-1:]]), 0.0, 1.0)
    log_target = target(space.from_unit(unit))
    held = log_target > found.log_target.max() - 0.5 * POSTERIOR.lost_chi2
    unit, log_target = unit[held], log_target[held]
    weight = np.concatenate([found.weight, np.full(len(unit), POSTERIOR.no_weight)])
    return Draws(
        np.vstack([found.unit, unit]),
        np.vstack([found.parameters, space.from_unit(unit)]),
        weight / weight.sum(),
        np.concatenate([found.log_target, log_target]),
        found.evaluations + len(along) + 1,
    )


def _evened(weight: Array) -> Array:
    """Return weights (n,) to the power of at most 1 with which they are worth enough draws.

    A single draw that has all of the weight is no posterior: its neighbours by density may be as
    likely as it is, and the mixture that was drawn from was wide enough to find it.
    """
    power, found = 1.0, weight
    least = min(POSTERIOR.least, 0.5 * np.count_nonzero(weight))
    while 1.0 / float(np.square(found).sum()) < least:
        power *= _LESS
        found = weight**power
        found /= found.sum()
    return found


def log_sum_exp(values: Array) -> Array:
    """Return log Σ exp over the last axis; some three times as quick as scipy's."""
    most = values.max(axis=-1, keepdims=True)
    most = np.where(np.isfinite(most), most, 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(np.exp(values - most).sum(axis=-1)) + most[..., 0])


def _resample(found: Draws, rng: np.random.Generator) -> Array:
    """Return unit-cube points (m, k), more of them where the draws so far had too few."""
    share = np.cumsum(np.sqrt(found.weight))
    count = POSTERIOR.centres
    at = (np.arange(count) + rng.random(count)) / count * share[-1]
    chosen = np.unique(np.minimum(np.searchsorted(share, at), len(share) - 1))
    return np.asarray(found.unit[chosen])


def _valley(
    space: ParameterSpace, misfit: SquaredMisfit, modes: Polished, best: int, hopeless_chi2: float
) -> tuple[Polished, Array]:
    """Return points along the valley, and how far (n, k) each one speaks; 1 where free."""
    centre = modes.unit[best]
    k = len(centre)
    precision = modes.normal[best] + FLAT_PRECISION * np.eye(k)
    covariance = np.linalg.inv(precision)
    starts, spacings = [modes.unit], [np.ones_like(modes.unit)]
    held = [np.zeros(modes.unit.shape, dtype=bool)]
    for i in range(k):
        deviation = np.sqrt(covariance[i, i])
        along = covariance[i] / deviation  # the others move along with this one
        offsets = np.unique(np.concatenate([-_OFFSETS, _OFFSETS]))
        value = centre[i] + offsets * deviation
        inside = (value > 0.0) & (value < 1.0)
        # The ends of the range belong to the profile wherever the steps would pass over them.
        value = np.concatenate([[0.0], value[inside], [1.0]])
        gaps = np.diff(value)
        width = np.maximum(np.concatenate([[gaps[0]], gaps]), np.concatenate([gaps, [gaps[-1]]]))
        start = centre + np.outer((value - centre[i]) / deviation, along)
        start[:, i] = value
        starts.append(np.clip(start, 0.0, 1.0))
        spacing = np.ones_like(start)
        spacing[:, i] = width
        spacings.append(spacing)
        only = np.zeros(start.shape, dtype=bool)
        only[:, i] = True
        held.append(only)
    points = polish(
        space,
        misfit,
        np.concatenate(starts),
        held=np.concatenate(held),
        least_gain=0.02,
        most_iterations=40,
        hopeless=float(modes.cost[best]) + hopeless_chi2,
    )
    return points, np.concatenate(spacings)


@dataclass(frozen=True, eq=False)
class _Mixture:
    """Student distributions with means (m, k), scale factors (m, k, k) and shares (m,)."""

    mean: Array
    factor: Array  # lower triangular: factor @ factorᵀ is the scale matrix
    log_share: Array

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        k = self.mean.shape[1]
        edges = np.cumsum(np.exp(self.log_share))
        stratified = (np.arange(n) + rng.random(n)) / n
        which = np.minimum(np.searchsorted(edges, stratified * edges[-1]), len(edges) - 1)
        normal = rng.standard_normal((n, k))
        stretch = np.sqrt(POSTERIOR.freedom / rng.chisquare(POSTERIOR.freedom, n))
        return np.asarray(
            self.mean[which]
            + np.einsum("nij,nj->ni", self.factor[which], normal) * stretch[:, None]
        )

    def log_density(self, at: Array) -> Array:
        step = max(8, _AT_ONCE // self.mean.size)
        parts = [self._log_density(at[i : i + step]) for i in range(0, len(at), step)]
        return np.concatenate(parts) if parts else np.zeros(0)

    def _log_density(self, at: Array) -> Array:
        k, freedom = self.mean.shape[1], POSTERIOR.freedom
        # All z = factor⁻¹ (at − mean) by one matrix product, component after component
        middle, inverse, shift, height = self._prepared
        z = (at - middle) @ inverse - shift
        first, *others = np.split(np.square(z, out=z), k, axis=1)
        distance = sum(others, first)
        constant = (
            math.lgamma(0.5 * (freedom + k))
            - math.lgamma(0.5 * freedom)
            - 0.5 * k * np.log(freedom)
        )
        # Products and a root in place of a logarithm and an exponential of each number
        each = 1.0 / _half_power(1.0 + distance / freedom, freedom + k)
        return np.asarray(constant + height.max() + np.log(each @ np.exp(height - height.max())))

    @cached_property
    def _prepared(self) -> tuple[Array, Array, Array, Array]:
        k = self.mean.shape[1]
        inverse = np.linalg.inv(self.factor)  # (m, k, k)
        middle = self.mean.mean(axis=0)
        shift = (inverse @ (self.mean - middle)[:, :, None])[:, :, 0]  # (m, k)
        log_det = np.log(np.einsum("mii->mi", self.factor)).sum(axis=1)
        turned = np.asarray(inverse.transpose(1, 0, 2).reshape(-1, k).T)
        return middle, turned, shift.T.ravel(), self.log_share - log_det


def _half_power(values: Array, n: int) -> Array:
    """Return values ** (n / 2); infinite where that is too large, which weighs nothing."""
    found, power, left = np.sqrt(values) if n % 2 else 1.0, values, n // 2
    with np.errstate(over="ignore"):
        while left:
            if left % 2:
                found = found * power
            left //= 2
            power = power * power if left else power
    return np.asarray(found)


def _mixture(centre: Array, precision: Array, spacing: Array, worse: Array) -> _Mixture:
    """Return Student distributions at points (m, k).

    As wide as the curvature (m, k, k) and the distances to the neighbours (m, k) say; `worse` (m,)
    is by how much χ² exceeds that of the best point.
    """
    kept = worse < POSTERIOR.lost_chi2
    k = spacing.shape[1]
    # Next to no distance is that of neighbours at a bound, and says nothing of the width.
    apart = np.where(spacing[kept] > POSTERIOR.no_distance, spacing[kept], 1.0)
    near = np.where(apart < 1.0, 1.0 / np.square(apart), 0.0)
    whole = precision[kept] + np.eye(k) * (FLAT_PRECISION + near)[:, None, :]
    root = np.linalg.cholesky(np.linalg.inv(whole)) * POSTERIOR.wider
    log_det = np.log(np.einsum("mii->mi", root)).sum(axis=1)
    log_share = -0.5 * worse[kept] + log_det
    return _Mixture(centre[kept], root, log_share - log_sum_exp(log_share))
