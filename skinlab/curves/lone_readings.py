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

    They are on the line from neither side: corners and steps of a program are on one. Of the first
    and the last ones only one side is known: see `_first_ones` and `_last_ones`.
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
        found[:width] |= _first_ones(p, width, least)
        top = p[:-width][~found[:-width]].max(initial=0.0)
        found[len(p) - width :] |= _last_ones(p, width, least, float(top))
    return found


def _first_ones(p: Array, width: int, least: float) -> bool:
    """Return whether so many first readings are none: far above a course that does not fall.

    Or far below it and below zero: a program begins without suction, and with a step perhaps.
    """
    ones, near, far = p[:width], p[width], p[width + 1]
    above = ones.min() - max(near, far) > least and far > near - least
    return bool(above or ones.max() < min(near, far, 0.0) - least)


def _last_ones(p: Array, width: int, least: float, top: float) -> bool:
    """Return whether so many last readings are none: far above all others, which go elsewhere.

    Or far below them and below zero: what only falls may be a vent. `top` is the highest of the
    others.
    """
    ones, near, far = p[-width:], p[-width - 1], p[-width - 2]
    goes_to = near + max(near - far, 0.0) * np.arange(1, width + 1)
    above = (ones - np.maximum(goes_to, top)).min() > least
    return bool(above or ones.max() < min(near, far, 0.0) - least)


def without_lone_readings(time_s: Array, pressure_mbar: Array) -> Array:
    """Return the readings (n,) with a straight course in the place of those that stand alone."""
    lone = lone_readings(time_s, pressure_mbar, white_noise(pressure_mbar))
    if not lone.any() or lone.all():
        return pressure_mbar
    return np.interp(time_s, time_s[~lone], pressure_mbar[~lone])


def _off_line(time: Array, p: Array, at: NDArray[np.intp], side: int) -> Array:
    """Return how far readings are off the line through the two before (-1) or behind (1), mbar."""
    near, far = at + side, np.clip(at + 2 * side, 0, len(p) - 1)
    apart = time[far] - time[near]
    slope = np.divide(p[far] - p[near], apart, out=np.zeros(len(at)), where=apart != 0.0)
    return np.asarray(np.abs(p[at] - p[near] - slope * (time[at] - time[near])))
