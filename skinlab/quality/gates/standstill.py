"""A deflection reading that stands still while the suction changes: stuck, or out of range."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from skinlab.quality.gates.base import Array, CurveSoFar
from skinlab.quality.gates.expected import least_deflection_mm
from skinlab.quality.settings import STILL

_UNIT_MM = 1e-4  # in which readings are counted to see that


@dataclass(frozen=True)
class Standstill:
    """One run of identical readings."""

    begin_s: float
    end_s: float
    reading: float  # in the channel's unit
    low_mbar: float
    high_mbar: float
    at_top: bool  # nothing above it was ever read
    clipped: bool | None  # whether it ended as a range does; None: it lasts to the end


def long_runs(readings: Array, time_s: Array) -> list[tuple[int, int]]:
    """Return begin and end of the runs of one and the same reading (n,) that last too long."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(readings)) + 1, [len(readings)]])
    lasts_s = time_s[edges[1:] - 1] - time_s[edges[:-1]]
    long = np.flatnonzero(lasts_s >= STILL.slack * STILL.longest_s)
    return list(zip(edges[long].tolist(), edges[long + 1].tolist(), strict=True))


def deflection_standstills(view: CurveSoFar) -> Iterator[Standstill]:
    """Yield the runs in which even a very stiff skin would have moved visibly."""
    w, p, t = view.deflection_mm, view.pressure_mbar, view.time_s
    if len(w) < STILL.fewest:
        return
    runs = long_runs(w, t)
    resolution = _resolution_mm(w) if runs else 0.0
    for i, j in runs:
        if j - i < STILL.fewest:
            continue
        levels = [float(np.median(part)) for part in np.array_split(p[i:j], STILL.fewest)]
        low, high = min(levels), max(levels)  # of the suction, not of its noise
        change = high - low
        if (
            change < STILL.least_mbar
            or least_deflection_mm(view.setup, change) < STILL.steps * resolution
        ):
            continue
        clipped = None
        if j < len(w):
            # A range's end is left where it was met: at about the same suction, downwards.
            clipped = bool(w[j] < w[i] and abs(p[j] - p[i]) < 0.25 * (high - low) + 1.0)
        fell = p[j - 1] < p[i] - 0.1 * (high - low) - 1.0
        at_top = bool(w[i] >= w.max()) and not fell
        yield Standstill(float(t[i]), float(t[j - 1]), float(w[i]), low, high, at_top, clipped)


def _resolution_mm(w: Array) -> float:
    """Return the step of which all differences of the readings are multiples, or the usual one."""
    counts = np.rint(np.clip(w, -1e6, 1e6) / _UNIT_MM).astype(np.int64)
    return max(float(np.gcd.reduce(np.diff(counts))) * _UNIT_MM, STILL.resolution_mm)
