"""A motion that comes again and again, in a form that nobody knows."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from skinlab.mechanics.effects.base import Array, Parameter, Values
from skinlab.mechanics.effects.learned import LearnedEffect, Seen, harmonics, roughness

_HARMONICS = 4
_LOW_HZ, _HIGH_HZ = 0.05, 20.0
_LEAST_PERIODS = 2.0  # of the longest curve: what comes less often does not come again
_PER_PERIOD = 5.0  # samples, at least
_GRID = 0.15  # of a period over the longest curve
_FINE = 11  # about the best of the grid
_AS_GOOD = 0.9  # of the power: half a frequency takes up what the frequency does


class LearnedPeriodic(LearnedEffect):
    """See the module.

    The library's `periodic_motion` is one sine that begins with the curve. This has any phase, and
    harmonics: a pump's strokes, a regulator that hunts.
    """

    name = "learned_periodic"
    family = "periodic"
    meaning = "the probe moves to and fro, in step with the beginning of the curve, in any form"
    formula = "w + Σ s_k sin(2π k f t) + c_k cos(2π k f t), t from the curve's first sample"
    source = "vibration of pump and regulator; Fourier series"
    physical = False
    range_name = "frequency_hz"
    parameters = (
        *(
            Parameter(
                f"{letter}{k}_um", "µm", f"{what} of {k} times the frequency", -300.0, 300.0, 0.0,
                10.0 * roughness(k), "a smooth function of unknown form, learned from the data",
            )
            for letter, what in (("s", "sine"), ("c", "cosine"))
            for k in range(1, _HARMONICS + 1)
        ),
        Parameter(
            "frequency_hz", "Hz", "how often in a second", _LOW_HZ, _HIGH_HZ, None, 1.0,
            "found in what the model leaves", "log", default=1.0,
        ),
    )  # fmt: skip
    x_name = "time_s"
    y_name = "moves_by_um"

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Add the motion."""
        return deflection_mm + 1e-3 * self.function(since_s, values)

    def range_of(self, seen: Seen) -> float:
        """Return the frequency that what is left has most of."""
        return _frequency(seen)

    def abscissa(self, seen: Seen) -> Array:
        """Return one period."""
        return np.linspace(0.0, 1.0 / _frequency(seen), 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return the motion (m,), µm, at these times."""
        return harmonics(2.0 * np.pi * values["frequency_hz"] * at, values, _HARMONICS)

    def sentence(self, x: Array, y: Array) -> str:
        """Say how often, and how far."""
        return (
            "comes again and again, whatever the suction: the probe moves by "
            f"{np.ptp(y):.0f} µm every {x[-1]:.2g} s, in step with the beginning of the curve"
        )


@lru_cache(maxsize=8)
def _frequency(seen: Seen) -> float:
    """Return the frequency whose harmonics take most off what is left of all curves together."""
    longest = max((float(np.ptp(t)) for t, _ in seen.left), default=0.0)
    if longest <= 0.0:
        return 1.0
    time = np.concatenate([t - t[0] for t, _ in seen.left])
    left = np.concatenate([r - r.mean() for _, r in seen.left])
    spacing = max(float(np.median(np.diff(t))) for t, _ in seen.left)
    low = max(_LEAST_PERIODS / longest, _LOW_HZ)
    high = min(1.0 / (_PER_PERIOD * spacing), _HIGH_HZ)
    if high <= low:
        return low
    step = _GRID / longest
    grid = np.arange(low, high, step)
    power = _power(time, left, grid, high)
    best = float(grid[np.flatnonzero(power >= _AS_GOOD * power.max())[-1]])
    fine = best + np.linspace(-step, step, _FINE)
    return float(fine[int(np.argmax(_power(time, left, fine, high)))])


def _power(time_s: Array, left: Array, frequencies_hz: Array, high_hz: float) -> Array:
    """Return the sum of the squares (f,) at a frequency and its harmonics up to the highest."""
    found = np.zeros(len(frequencies_hz))
    for k in range(1, _HARMONICS + 1):
        at = k * frequencies_hz
        power = np.abs(np.exp(-2j * np.pi * np.outer(at, time_s)) @ left) ** 2
        found += power if k == 1 else np.where(at <= high_hz, power, 0.0)
    return found


EFFECT = LearnedPeriodic()
