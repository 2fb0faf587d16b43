"""The smooth course of a noisy pressure.

A model that is evaluated at noisy pressures follows their noise by dw/dp. What fits the deflection
best then has a smaller dw/dp than the skin, since the true deflection does not follow it: the known
attenuation of regression on a noisy variable (Fuller 1987, Measurement Error Models). A hundred
samples hardly show it; a thousand did, where errors that last leave the smooth part open: skins
came out stiffer by more than their interval, and the errors ten times too large.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.settings import NOISE

Array = NDArray[np.float64]


def smooth_course(
    time_s: Array, pressure_mbar: Array, sd_mbar: float, *, apart: float = NOISE.course_apart
) -> Array:
    """Return the pressure (n,) without its noise, by the widest straight line that noise allows.

    At each sample lines are fitted to more and more neighbours, as long as each agrees with all
    narrower ones within the noise (Lepski's rule; Goldenshluger and Nemirovski 1997, Math. Methods
    Stat. 6:135): corners and steps of a program stay. A smaller `apart` (standard deviations)
    keeps more of them, and more noise.
    """
    n = len(time_s)
    found = pressure_mbar.copy()
    if sd_mbar <= 0.0 or n < 2 * NOISE.course_half_widths[0] + 1:
        return found
    # What all lines so far allow, and whether any line still does
    low, high = found - apart * sd_mbar, found + apart * sd_mbar
    open_ = np.ones(n, dtype=bool)
    for half in NOISE.course_half_widths:
        width = 2 * half + 1
        if width > n:
            break
        begin = np.clip(np.arange(n) - half, 0, n - width)
        t = np.lib.stride_tricks.sliding_window_view(time_s, width)
        p = np.lib.stride_tricks.sliding_window_view(pressure_mbar, width)
        middle, mean = t.mean(axis=1), p.mean(axis=1)
        off = t - middle[:, None]
        square = np.maximum(np.square(off).sum(axis=1), 1e-300)
        slope = (off * p).sum(axis=1) / square
        at = time_s - middle[begin]
        line = mean[begin] + slope[begin] * at
        sd = sd_mbar * np.sqrt(1.0 / width + at**2 / square[begin])
        low, high = np.maximum(low, line - apart * sd), np.minimum(high, line + apart * sd)
        open_ &= low <= high
        found = np.where(open_, line, found)
    return found
