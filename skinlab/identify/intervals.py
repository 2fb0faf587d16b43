"""From weighted draws to intervals, correlations, and what the data do not fix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.identify.posterior import Draws

Array = NDArray[np.float64]

LEVEL = 0.9
_MOST_OF_THE_RANGE = 0.5  # of the prior's own interval, in the prior's scale


def interval(values: Array, weight: Array, best: float) -> tuple[float, float]:
    """Return the interval that holds 90 % of the weight of values (n,), and the best fit.

    5 % are left out at either end; where the best fit is out there itself (at a bound, say), the
    interval begins at it.
    """
    order = np.argsort(values, kind="stable")
    x = values[order]
    below = np.cumsum(weight[order])
    middle = (below - 0.5 * weight[order]) / below[-1]
    place = float(np.interp(best, x, middle, left=0.0, right=1.0))
    start = min(max(0.5 * (1.0 - LEVEL), place - LEVEL), place)
    low, high = (float(np.interp(q, middle, x)) for q in (start, start + LEVEL))
    return min(low, best), max(high, best)


def correlation(parameters: Array, weight: Array) -> tuple[tuple[float, ...], ...]:
    """Return the correlation matrix of weighted parameters (n, p)."""
    centred = parameters - weight @ parameters
    covariance = (centred * weight[:, None]).T @ centred
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    matrix = np.clip(covariance / np.outer(deviation, deviation), -1.0, 1.0)
    np.fill_diagonal(matrix, 1.0)
    return tuple(tuple(float(v) for v in row) for row in matrix)


def not_identifiable(draws: Draws, prior: Array, names: tuple[str, ...]) -> list[str]:
    """Return the names whose interval covers more than half of the one before the measurement.

    `prior` (n, p) are parameters drawn from the prior; positive ones are compared in logarithms
    where the prior spreads over more than a factor of 5.
    """
    found = []
    even = np.full(len(prior), 1.0 / len(prior))
    for i, name in enumerate(names):
        before, after = prior[:, i], draws.parameters[:, i]
        if before.min() > 0.0 and before.max() > 5.0 * before.min():
            before, after = np.log(before), np.log(after)
        widths = []
        for values, weight in ((after, draws.weight), (before, even)):
            low, high = interval(values, weight, float(weight @ values))
            widths.append(high - low)
        if widths[0] > _MOST_OF_THE_RANGE * widths[1]:
            found.append(name)
    return found
