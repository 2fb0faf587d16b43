"""A dome that rings: every rise of it swings about where it will be, and dies out."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from skinlab.mechanics.effects.base import Array, Parameter, Values
from skinlab.mechanics.effects.learned import LearnedEffect, Seen

_DAMPINGS = (0.1, 0.25, 0.5)  # of the critical one: those between are sums of them, nearly
_LOW_HZ, _HIGH_HZ = 0.1, 20.0
_LEAST_PERIODS = 1.0  # of the longest curve
_PER_PERIOD = 4.0  # samples, at least
_GRID = 1.1  # times the frequency before
_FINE = 9  # about the best of the grid
_PERIODS = 3.0  # that are drawn
_SOURCE = "response of a damped oscillator, as regulators and filters are; its form is learned"


class LearnedRinging(LearnedEffect):
    """See the module.

    `learned_creep` is a response that dies out without changing its sign; this one swings. What is
    learned is the response to a step, whatever damps it: a regulator that overshoots, a filter in
    the deflection channel, a probe that gives.
    """

    name = "learned_ringing"
    family = "time"
    meaning = "every rise of the dome swings about where it will be, as found from the data"
    formula = (
        "w + ∫ h(t − s) dw(s), h(u) = Σ exp(−d_k ω u) (s_k sin ω u + c_k cos ω u), ω = 2π f, d of "
        "0.1, 0.25 and 0.5"
    )
    source = "second-order systems: Ogata 2010, Modern Control Engineering, 5.3"
    physical = False
    range_name = "frequency_hz"
    parameters = (
        *(
            Parameter(
                f"{letter}{k}", "", f"{what} that is damped by {d:g} of the critical", -3.0, 3.0,
                0.0, 0.1, _SOURCE,
            )
            for letter, what in (("s", "sine"), ("c", "cosine"))
            for k, d in enumerate(_DAMPINGS, start=1)
        ),
        Parameter(
            "frequency_hz", "Hz", "at which it swings", _LOW_HZ, _HIGH_HZ, None, 1.0,
            "found in what the model leaves", "log", default=1.0,
        ),
    )  # fmt: skip
    x_name = "time_s"
    y_name = "share_beyond"

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Add what swings; as if the skin had been at rest before the first sample."""
        swings = _swings(since_s, deflection_mm, values["frequency_hz"])
        return np.asarray(deflection_mm + swings @ [values[name] for name in self.names])

    def range_of(self, seen: Seen) -> float:
        """Return the frequency whose swings take most off what is left of all curves together."""
        return _frequency(seen)

    def abscissa(self, seen: Seen) -> Array:
        """Return a few periods."""
        return np.linspace(0.0, _PERIODS / _frequency(seen), 61)

    def function(self, at: Array, values: Values) -> Array:
        """Return the share (m,) of a rise by which the dome is beyond it, so long after."""
        turned = 2.0 * np.pi * values["frequency_hz"] * at
        found = np.zeros_like(turned)
        for k, damping in enumerate(_DAMPINGS, start=1):
            swing = values[f"s{k}"] * np.sin(turned) + values[f"c{k}"] * np.cos(turned)
            found += np.exp(-damping * turned) * swing
        return found

    def sentence(self, x: Array, y: Array) -> str:
        """Say how fast it swings, and how far."""
        return (
            "depends on time, not on suction: after every change the dome swings to and fro in "
            f"{x[-1] / _PERIODS:.2g} s, by up to {100 * np.abs(y).max():.0f} % of the change"
        )


def _swings(time_s: Array, deflection_mm: Array, frequency_hz: float) -> Array:
    """Return what each coefficient adds (n, 6): sines, then cosines.

    Filters of w of first order whose rate is complex, exact where w is straight between samples.
    """
    from scipy.linalg import solve_banded  # slow to import

    w = deflection_mm - deflection_mm[:1]
    if len(w) < 2:
        return np.zeros((len(w), 2 * len(_DAMPINGS)))
    lasts, rises = np.maximum(np.diff(time_s), 1e-9), np.diff(w)
    found = []
    for damping in _DAMPINGS:
        turns = 2.0 * np.pi * frequency_hz * (damping - 1j) * lasts
        driven = np.concatenate([w[:1] + 0j, -np.expm1(-turns) / turns * rises])
        band = np.vstack([np.ones(len(w), complex), np.append(-np.exp(-turns), 0.0)])
        found.append(solve_banded((1, 0), band, driven, check_finite=False))
    every = np.array(found)
    return np.asarray(np.vstack([every.imag, every.real]).T)


@lru_cache(maxsize=8)
def _frequency(seen: Seen) -> float:
    """Return the frequency whose swings take most off what is left of all curves together."""
    longest = max((float(np.ptp(t)) for t, _ in seen.left), default=0.0)
    if longest <= 0.0 or not seen.model_mm:
        return 1.0
    spacing = max(float(np.median(np.diff(t))) for t, _ in seen.left)
    low = max(_LEAST_PERIODS / longest, _LOW_HZ)
    high = min(1.0 / (_PER_PERIOD * spacing), _HIGH_HZ)
    if high <= low:
        return low
    left = np.concatenate([r for _, r in seen.left])

    def gain(frequency_hz: float) -> float:
        # What is in proportion to the dome is a stiffer skin.
        columns = [
            np.column_stack([w, _swings(t, w, frequency_hz)])
            for (t, _), w in zip(seen.left, seen.model_mm, strict=True)
        ]
        q, _ = np.linalg.qr(np.vstack(columns))
        return float(np.sum((q.T @ left) ** 2))

    steps = int(np.ceil(np.log(high / low) / np.log(_GRID)))
    best = max(np.geomspace(low, high, steps + 1).tolist(), key=gain)
    fine = best * _GRID ** np.linspace(-1.0, 1.0, _FINE)
    return float(max(np.clip(fine, low, high).tolist(), key=gain))


EFFECT = LearnedRinging()
