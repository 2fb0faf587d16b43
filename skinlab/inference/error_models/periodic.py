"""A sine of a found frequency, its amplitude and phase unknown: what breathing and pulse share.

The search begins at the frequency whose sine and cosine, less what the skin's unknowns absorb, take
most off the residuals' squares (a Lomb-Scargle periodogram with the model's slopes as nuisance:
Scargle 1982, Astrophys. J. 263:835). From there it is a parameter like others, integrated out:
sine and cosine are columns of the covariance, the model's size their common standard deviation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.error_models.base import Hyperparameter, Look, Part, Terms
from skinlab.inference.samples import Samples
from skinlab.inference.settings import KINDS

Array = NDArray[np.float64]

_NINE_TENTHS = 1.645
_KEPT = 16  # waves of frequencies


def spectrum(look: Look, frequencies_hz: Array) -> Array:
    """Return the share (f,) of the residuals' squares that a sine of each frequency takes away."""
    basis, _ = np.linalg.qr(look.slopes)
    left = look.residual_mm - basis @ (basis.T @ look.residual_mm)
    total = float(left @ left)
    found = np.zeros(len(frequencies_hz))
    for i, frequency in enumerate(frequencies_hz):
        waves = columns(look.samples, float(frequency))
        q, _ = np.linalg.qr(waves - basis @ (basis.T @ waves))
        found[i] = float(np.square(q.T @ left).sum()) / max(total, 1e-300)
    return found


def columns(samples: Samples, frequency_hz: float) -> Array:
    """Return sine and cosine (u, 2 × curves), of each curve alone: it has a phase of its own."""
    angle = 2.0 * np.pi * frequency_hz * samples.time_s
    if samples.curves == 1:
        return np.stack([np.sin(angle), np.cos(angle)], axis=1)
    one = samples.curve[:, None] == np.arange(samples.curves)
    return np.hstack([np.sin(angle)[:, None] * one, np.cos(angle)[:, None] * one])


@dataclass(frozen=True)
class Periodic:
    """A sine within a band of frequencies."""

    name: str
    low_hz: float
    high_hz: float
    median_um: float
    meaning: str
    what: str

    @property
    def prior(self) -> str:
        """What is known before the data."""
        hz = self._frequency()
        return (
            f"{self.median_um:g} µm, {KINDS.sine_sd:g}; {hz.median:.2g} Hz, {hz.log_sd:.2g}; "
            f"odds 1 : {1 / KINDS.unusual_odds:g}"
        )

    def _frequency(
        self, start_hz: float | None = None, lasts_s: float | None = None
    ) -> Hyperparameter:
        """Return the frequency's prior, which ends with the band."""
        median = math.sqrt(self.low_hz * self.high_hz)
        reach = 0.5 * math.log(self.high_hz / self.low_hz)
        name = f"{self.name}_hz"
        scale = 1.0 if lasts_s is None else min(KINDS.sine_apart / (lasts_s * median), 1.0)
        sd = reach / _NINE_TENTHS
        return Hyperparameter(name, median, sd, start=start_hz, reach=reach, scale=scale)

    def part(self, look: Look) -> Part | None:
        """Return its part where the record lasts a period and a frequency stands out."""
        samples = look.samples
        lasts = samples.longest_s
        spacing = lasts / max(len(samples) / max(samples.curves, 1) - 1, 1)
        sparse = spacing * self.low_hz * KINDS.sine_samples > 1.0
        if lasts * self.high_hz < KINDS.sine_periods or sparse:
            return None
        steps = (self.high_hz - self.low_hz) * lasts / KINDS.sine_finest
        count = int(np.clip(steps + 2, 3, KINDS.sine_most))
        grid = np.linspace(self.low_hz, self.high_hz, count)
        share = spectrum(look, grid)
        best = int(np.argmax(share))
        # White residuals: the largest of several shares, each of mean 2/u.
        if share[best] * 0.5 * len(samples) < KINDS.sine_stands_out * samples.curves:
            return None
        frequency = float(grid[best])
        size = Hyperparameter(f"{self.name}_um", self.median_um, KINDS.sine_sd)

        waves = lru_cache(maxsize=_KEPT)(partial(columns, samples))

        def terms(values: Sequence[float]) -> Terms:
            size_um, hz = values
            found = waves(hz)
            return Terms(columns_mm=found, sizes=np.full(found.shape[1], 1e-3 * size_um))

        return Part(
            self.name,
            (size, self._frequency(frequency, lasts)),
            terms,
            math.log(KINDS.unusual_odds),
            lasting=True,
            why=f"{self.what} at {frequency:.2g} Hz",
        )
