"""From weighted draws to intervals, correlations, and what the data do not fix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.settings import INTERVALS

Array = NDArray[np.float64]

# Twice the fall of the log likelihood inside an interval: at most that of χ² of one degree, 90 %;
# at least so much, which holds at the ends of a range too (docs/intervals.md has the coverage).


def summary(
    values: Array,
    weight: Array,
    log_density: Array,
    bounds: tuple[float, float] = (-np.inf, np.inf),
    *,
    logarithmic: bool = False,
    at_end: NDArray[np.bool_] | None = None,
) -> tuple[float, float, float]:
    """Return the median of weighted values (n,), and an interval with 90 % of the weight.

    Values come in by the best log density (n,) that the other unknowns give them, the likeliest
    first (the order of Feldman and Cousins 1998, Phys. Rev. D 57:3873), until 90 % of the weight is
    inside, within the limits of fall. The middle half of the weight is always inside, and so the
    median is well inside: the likeliest values may be a narrow place far from most. Next to a bound
    it ends at the bound, in logarithms where the prior is flat in these. Where another unknown is
    at an end of its range (`at_end`, (n,)) all within the largest fall is inside: next to no weight
    is there, and a true value may be.
    """
    by_value = np.argsort(values, kind="stable")
    x, below = values[by_value], np.cumsum(weight[by_value])
    quarters = [0.25, 0.5, 0.75]
    left, middle, right = np.interp(quarters, (below - 0.5 * weight[by_value]) / below[-1], x)
    held = np.flatnonzero((weight > 0.0) & np.isfinite(log_density))
    order = held[np.argsort(-log_density[held], kind="stable")]
    fall = 2.0 * (log_density[order[0]] - log_density[order])
    low, high = np.minimum.accumulate(values[order]), np.maximum.accumulate(values[order])
    inside = np.concatenate([[0.0], below])
    first, last = np.searchsorted(x, low, "left"), np.searchsorted(x, high, "right")
    enough = np.searchsorted(inside[last] - inside[first], INTERVALS.level * below[-1])
    reach = fall[min(int(enough), len(fall) - 1)]
    reach = float(np.clip(reach, INTERVALS.least_fall, INTERVALS.most_fall))
    at = max(int(np.searchsorted(fall, reach, "right")) - 1, 0)
    ends = [min(float(low[at]), float(left)), max(float(high[at]), float(right))]
    if at_end is not None:
        cornered = values[order][at_end[order] & (fall <= INTERVALS.most_fall)]
        ends = [float(np.min([ends[0], *cornered])), float(np.max([ends[1], *cornered]))]
    scale = np.log if logarithmic else np.asarray
    if np.isfinite(bounds).all():
        near = INTERVALS.near_bound * float(scale(bounds[1]) - scale(bounds[0]))
        for i in range(2):
            if abs(float(scale(ends[i]) - scale(bounds[i]))) <= near:
                ends[i] = bounds[i]
    return float(middle), ends[0], ends[1]


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


def most_of_unit(width: float) -> bool:
    """Return whether an interval is more than half as wide as that of a flat prior on 0…1."""
    return width > INTERVALS.most_of_the_range * INTERVALS.level
