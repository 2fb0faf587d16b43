"""What the plot draws, as pure functions: arrays and limits, no widget."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.tui.ui_state import Entry, Live

Array = NDArray[np.float64]

MOST_POINTS = 1500  # more than a terminal can tell apart
_STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


@dataclass(frozen=True, eq=False)
class Trace:
    """Points to draw (n,): pressure in mbar, deflection in mm."""

    pressure_mbar: Array
    deflection_mm: Array

    def __len__(self) -> int:
        return len(self.pressure_mbar)


def measured(curve: Live | Entry) -> Trace:
    """Return the measured points of a running or completed curve."""
    if isinstance(curve, Live):
        _, pressure_mbar, deflection_mm, _ = curve.curve.columns  # of one moment
        return thin(Trace(pressure_mbar, deflection_mm))
    return thin(Trace(curve.curve.pressure_mbar, curve.curve.deflection_mm))


def fitted(entry: Entry) -> Trace | None:
    """Return the fitted curve, by rising pressure where it was fitted, or None."""
    result = entry.result
    if result is None or result.model_mm is None:
        return None
    there = np.isfinite(result.model_mm)
    if not there.any():
        return None
    return thin(Trace(entry.curve.pressure_mbar[there], np.asarray(result.model_mm)[there]))


def thin(trace: Trace, most: int = MOST_POINTS) -> Trace:
    """Return at most about `most` of the points, the last one included."""
    n = len(trace)
    if n <= most:
        return trace
    keep = np.unique(np.append(np.arange(0, n, math.ceil(n / most)), n - 1))
    return Trace(trace.pressure_mbar[keep], trace.deflection_mm[keep])


def spaced(trace: Trace, box: Box, gap: float = 0.08) -> Trace:
    """Return points that are at least `gap` of the box apart, to be marked one by one."""
    keep: list[int] = []
    x = trace.pressure_mbar / (box.right_mbar - box.left_mbar)
    y = trace.deflection_mm / (box.top_mm - box.bottom_mm)
    for i in range(len(trace)):
        if not keep or math.hypot(x[i] - x[keep[-1]], y[i] - y[keep[-1]]) >= gap:
            keep.append(i)
    return Trace(trace.pressure_mbar[keep], trace.deflection_mm[keep])


@dataclass(frozen=True)
class Box:
    """Where the axes begin and end."""

    left_mbar: float
    right_mbar: float
    bottom_mm: float
    top_mm: float

    def inside(self, trace: Trace) -> Trace:
        """Return the points of a trace that lie inside."""
        there = (
            (trace.pressure_mbar >= self.left_mbar)
            & (trace.pressure_mbar <= self.right_mbar)
            & (trace.deflection_mm >= self.bottom_mm)
            & (trace.deflection_mm <= self.top_mm)
        )
        return Trace(trace.pressure_mbar[there], trace.deflection_mm[there])


def box_around(program_max_mbar: float | None, traces: list[Trace]) -> Box:
    """Return the axes for these traces; they begin at zero, unless a deflection is far below.

    In round steps, so that a growing curve moves the axes only now and then.
    """
    highest = max((float(t.pressure_mbar.max()) for t in traces if len(t)), default=0.0)
    deepest = max((float(t.deflection_mm.max()) for t in traces if len(t)), default=0.0)
    lowest = min((float(t.deflection_mm.min()) for t in traces if len(t)), default=0.0)
    mbar = max(program_max_mbar or 0.0, highest / 1.03)  # noise may go over the frame a little
    top = round_up(1.05 * deepest, least=0.1)
    bottom = -round_up(-lowest, least=0.1) if lowest < -0.03 * top else 0.0
    return Box(0.0, 1.05 * (mbar if mbar > 0 else 100.0), bottom, top)


def round_up(value: float, least: float) -> float:
    """Return the next round number that is not below `value` nor below `least`."""
    value = max(value, least)
    decade = 10.0 ** math.floor(math.log10(value))
    return next(s for s in _STEPS if s * decade >= value * (1 - 1e-12)) * decade


def nice_ticks(low: float, high: float, most: int) -> list[float]:
    """Return round numbers between two ends, evenly spaced, at most `most` of them (2 or more)."""
    span = high - low
    decade = 10.0 ** math.floor(math.log10(span))
    steps = (s * decade * scale for scale in (0.1, 1.0) for s in (1.0, 2.0, 5.0))
    for step in (*steps, 10 * decade):
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        if last - first < max(most, 2):
            return [k * step for k in range(first, last + 1)]
    return [low, high]
