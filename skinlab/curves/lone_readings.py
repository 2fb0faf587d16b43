"""Readings of a pressure that stand alone: no pump goes there and back from sample to sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.settings import GLITCHES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def white_noise(values: Array) -> float:
    """Return the standard deviation of one reading of a smooth course (n,), in its unit.

    By the median of second differences, so that corners do not count; 0 below three readings.
    """
    if len(values) < 3:
        return 0.0
    return float(np.median(np.abs(np.diff(values, n=2))) / (0.6745 * np.sqrt(6.0)))


def least_alone_mbar(pressure_mbar: Array, noise_mbar: float) -> float:
    """Return by how much a reading is off that stands alone among these (n,), mbar."""
    top = float(np.quantile(pressure_mbar, GLITCHES.top))
    return max(GLITCHES.least_mbar, GLITCHES.deviations * noise_mbar, GLITCHES.of_top * top)


def lone_readings(time_s: Array, pressure_mbar: Array, noise_mbar: float) -> Mask:
    """Return which readings (n,) stand out of their neighbours to one side, one or two in a row.

    They are on the line from neither side: corners and steps of a program are on one.
    """
    time, p = time_s, pressure_mbar
    found = np.zeros(len(p), dtype=bool)
    if len(p) < GLITCHES.fewest:
        return found
    least = least_alone_mbar(p, noise_mbar)
    for width in (1, 2):
        first = np.arange(1, len(p) - width)
        last = first + width - 1
        left, right = p[first - 1], p[last + 1]
        inside = np.stack([p[first + k] for k in range(width)])
        above = (inside - np.maximum(left, right)).min(axis=0) > least
        below = (np.minimum(left, right) - inside).min(axis=0) > least
        off = (above | below) & (_off_line(time, p, first, -1) > least)
        off &= _off_line(time, p, last, 1) > least
        for k in range(width):
            found[first[off] + k] = True
    return found


def _off_line(time: Array, p: Array, at: NDArray[np.intp], side: int) -> Array:
    """Return how far readings are off the line through the two before (-1) or behind (1), mbar."""
    near, far = at + side, np.clip(at + 2 * side, 0, len(p) - 1)
    apart = time[far] - time[near]
    slope = np.divide(p[far] - p[near], apart, out=np.zeros(len(at)), where=apart != 0.0)
    return np.asarray(np.abs(p[at] - p[near] - slope * (time[at] - time[near])))
