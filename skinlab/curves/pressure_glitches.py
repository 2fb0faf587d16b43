"""Readings of the pressure that the suction cannot have come to: a glitch of the channel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.settings import GLITCHES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def pressure_glitches(curve: Curve, noise_mbar: float) -> Mask:
    """Return which samples (n,) have a pressure that is none: one alone, or two in a row.

    They stand out of their neighbours to one side, and are on the line from neither side: corners
    and steps of a program are on one. What a program asks for is none. `noise_mbar` is the standard
    deviation of the channel. As a deflection such a sample is off by dw/dp times as much, which may
    pass for a placement.
    """
    time, p = curve.time_s, curve.pressure_mbar
    found = np.zeros(len(p), dtype=bool)
    if len(p) < GLITCHES.fewest:
        return found
    top = float(np.quantile(p, GLITCHES.top))
    least = max(GLITCHES.least_mbar, GLITCHES.deviations * noise_mbar, GLITCHES.of_top * top)
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
    program = curve.program_as_run
    if found.any() and program is not None:
        asked = PressurePath.of_program(program)(time - time[0])
        found &= np.abs(p - asked) > least
    return found


def _off_line(time: Array, p: Array, at: NDArray[np.intp], side: int) -> Array:
    """Return how far readings are off the line through the two before (-1) or behind (1), mbar."""
    near, far = at + side, np.clip(at + 2 * side, 0, len(p) - 1)
    apart = time[far] - time[near]
    slope = np.divide(p[far] - p[near], apart, out=np.zeros(len(at)), where=apart != 0.0)
    return np.asarray(np.abs(p[at] - p[near] - slope * (time[at] - time[near])))
