"""From weighted draws to intervals, correlations, and what the data do not fix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.settings import INTERVALS

Array = NDArray[np.float64]

_STARTS = np.linspace(0.0, 1.0, 101)  # of an interval, share of where it may begin


def summary(
    values: Array,
    weight: Array,
    log_density: Array,
    bounds: tuple[float, float] = (-np.inf, np.inf),
    *,
    logarithmic: bool = False,
    at_end: NDArray[np.bool_] | None = None,
    inside: float = INTERVALS.weight,
) -> tuple[float, float, float]:
    """Return the median of weighted values (n,), and the shortest interval that may be said of it.

    In logarithms where the prior is flat in these. It contains all that is likely (by `log_density`
    (n,)), however little weight that has: a valley's narrow end has next to none, and true values
    are there. Of the ends of the ranges, the value's own `bounds` and those of other unknowns
    (draws `at_end`, (n,)), more counts as likely. So 88 % of the weight `inside` suffice to hold
    90 % of true values over the prior (docs/decisions/0143-what-is-likely-is-inside.md).
    """
    scale, back = (np.log, np.exp) if logarithmic else (np.asarray, np.asarray)
    z = scale(values)
    by_value = np.argsort(z, kind="stable")
    share = np.cumsum(weight[by_value])
    share = (share - 0.5 * weight[by_value]) / share[-1]
    sides = 0.5 + np.array([-0.5, 0.0, 0.5]) * INTERVALS.middle
    left, middle, right = np.interp(sides, share, z[by_value])
    fall = 2.0 * (log_density[weight > 0.0].max() - log_density)
    at_an_end = fall <= INTERVALS.end_fall
    likely = [np.array([left, right]), z[fall <= INTERVALS.likely_fall]]
    if at_end is not None:
        likely.append(z[at_end & at_an_end])
    if np.isfinite(bounds).all():
        ends = scale(np.array(bounds))
        near = INTERVALS.at_end * float(ends[1] - ends[0])
        likely.append(ends[[(at_an_end & (np.abs(z - end) <= near)).any() for end in ends]])
    every = np.concatenate(likely)
    low, high = float(every.min()), float(every.max())
    found = back(np.array(_shortest(*_with_share(low, high, z[by_value], share, inside))))
    if np.isfinite(bounds).all():  # a logarithm there and back may be off by the last digit
        found = np.clip(found, *bounds)
    return float(back(middle)), float(found[0]), float(found[1])


def _with_share(
    low: float, high: float, values: Array, share: Array, level: float
) -> tuple[Array, Array]:
    """Return the ends of intervals about low to high that have so much of sorted values (n,)."""
    first = min(float(np.interp(low, values, share)), 1.0 - level) * _STARTS
    lows = np.minimum(np.interp(first, share, values), low)
    return lows, np.maximum(np.interp(first + level, share, values), high)


def _shortest(lows: Array, highs: Array) -> tuple[float, float]:
    """Return the shortest of intervals; of many that are nearly as short the middle one.

    Where the density is flat chance alone decides which is the very shortest.
    """
    width = highs - lows
    best = int(np.argmin(width))
    enough = width <= width[best] * (1.0 + INTERVALS.as_short)
    middle = round(float(np.flatnonzero(enough).mean()))
    chosen = middle if enough[middle] else best
    return float(lows[chosen]), float(highs[chosen])


def at_an_end(unit: Array) -> NDArray[np.bool_]:
    """Return which points (n, k) of the unit cube have an unknown at an end of its range."""
    return np.asarray((np.abs(unit - 0.5) >= 0.5 - INTERVALS.at_end).any(axis=1))


def is_logarithmic(prior: Array) -> bool:
    """Return whether values (n,) drawn from the prior are to be compared in logarithms."""
    low, middle, high = np.quantile(prior, [0.0, 0.5, 1.0])
    return bool(low > 0.0 and high > 5.0 * low and middle - low < 0.35 * (high - low))


def correlation(parameters: Array, weight: Array) -> tuple[tuple[float, ...], ...]:
    """Return the correlation matrix of weighted parameters (n, p)."""
    centred = parameters - weight @ parameters
    covariance = (centred * weight[:, None]).T @ centred
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    matrix = np.clip(covariance / np.outer(deviation, deviation), -1.0, 1.0)
    np.fill_diagonal(matrix, 1.0)
    # The last digits of long sums depend on threads and alignment, and say nothing.
    return tuple(tuple(round(float(v), 9) for v in row) for row in matrix)


def most_of_the_range(width: tuple[float, float], prior: Array) -> bool:
    """Return whether an interval is more than half as wide as that of the prior's draws (n,)."""
    starts = (1.0 - INTERVALS.level) * np.linspace(0.0, 1.0, 11)
    lows, highs = np.quantile(prior, starts), np.quantile(prior, starts + INTERVALS.level)
    shortest = int(np.argmin(highs - lows))
    low, high = float(lows[shortest]), float(highs[shortest])
    if is_logarithmic(prior):
        return bool(np.log(width[1] / width[0]) > INTERVALS.most_of_the_range * np.log(high / low))
    return bool(width[1] - width[0] > INTERVALS.most_of_the_range * (high - low))
