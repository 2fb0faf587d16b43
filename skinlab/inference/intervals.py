"""From weighted draws to intervals, correlations, and what the data do not fix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVEL = 0.9
_PLACES = 11
_NEAR_BOUND = 0.01  # of the range
_MOST_OF_THE_RANGE = 0.5  # of the prior's own interval, in the prior's scale


def interval(
    values: Array,
    weight: Array,
    best: float,
    bounds: tuple[float, float] = (-np.inf, np.inf),
    *,
    logarithmic: bool = False,
) -> tuple[float, float]:
    """Return the shortest interval that holds 90 % of the weight of values (n,), and the best fit.

    Of eleven that leave out 0, 1, … 10 % at the lower end; next to a bound it ends at the bound.
    Shortest in logarithms where the prior is flat in these.
    """
    order = np.argsort(values, kind="stable")
    x = values[order]
    below = np.cumsum(weight[order])
    middle = (below - 0.5 * weight[order]) / below[-1]
    starts = (1.0 - LEVEL) * np.linspace(0.0, 1.0, _PLACES)
    low, high = np.interp(starts, middle, x), np.interp(starts + LEVEL, middle, x)
    near = _NEAR_BOUND * (bounds[1] - bounds[0])
    if low[0] <= bounds[0] + near:
        low[0] = bounds[0]
    if high[-1] >= bounds[1] - near:
        high[-1] = bounds[1]
    low, high = np.minimum(low, best), np.maximum(high, best)
    width = np.log(high / low) if logarithmic else high - low
    shortest = int(np.argmin(width))
    return float(low[shortest]), float(high[shortest])


def is_logarithmic(prior: Array) -> bool:
    """Return whether values (n,) drawn from the prior are to be compared in logarithms."""
    return bool(prior.min() > 0.0 and prior.max() > 5.0 * prior.min())


def correlation(parameters: Array, weight: Array) -> tuple[tuple[float, ...], ...]:
    """Return the correlation matrix of weighted parameters (n, p)."""
    centred = parameters - weight @ parameters
    covariance = (centred * weight[:, None]).T @ centred
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    matrix = np.clip(covariance / np.outer(deviation, deviation), -1.0, 1.0)
    np.fill_diagonal(matrix, 1.0)
    return tuple(tuple(float(v) for v in row) for row in matrix)


def most_of_the_range(width: tuple[float, float], prior: Array) -> bool:
    """Return whether an interval is more than half as wide as that of the prior's draws (n,)."""
    low, high = interval(prior, np.full(len(prior), 1.0 / len(prior)), float(np.median(prior)))
    if is_logarithmic(prior):
        return bool(np.log(width[1] / width[0]) > _MOST_OF_THE_RANGE * np.log(high / low))
    return width[1] - width[0] > _MOST_OF_THE_RANGE * (high - low)
