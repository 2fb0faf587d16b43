"""What the plot and the strip below it draw, as pure functions: arrays and limits, no widget."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.tui.canvas import Bits, dots, share
from skinlab.tui.shown import Entry, Live

Array = NDArray[np.float64]

_BAND_POINTS = 100
MOST_POINTS = 1500  # more than a terminal can tell apart
_NOISE = 2.0  # standard deviations: 19 of 20 residuals lie inside the band
_LABELS = 6  # columns left of the drawing that a caption may use as well
_STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


@dataclass(frozen=True, eq=False)
class Trace:
    """Points to draw (n,): pressure in mbar, deflection in mm."""

    pressure_mbar: Array
    deflection_mm: Array

    def __len__(self) -> int:
        return len(self.pressure_mbar)


def measured(curve: Live | Entry) -> Trace:
    """Return the measured points of a running or completed curve, without those left out."""
    if isinstance(curve, Live):
        _, pressure_mbar, deflection_mm, _ = curve.curve.columns  # of one moment
        return thin(Trace(pressure_mbar, deflection_mm))
    kept = ~_glitches(curve)
    return thin(Trace(curve.curve.pressure_mbar[kept], curve.curve.deflection_mm[kept]))


def left_out(entry: Entry) -> Trace | None:
    """Return the points that were left out as glitches, None where there are none."""
    out = _glitches(entry)
    if not out.any():
        return None
    return Trace(entry.curve.pressure_mbar[out], entry.curve.deflection_mm[out])


def _glitches(entry: Entry) -> NDArray[np.bool_]:
    result = entry.result
    if result is None or result.outliers is None:
        return np.zeros(len(entry.curve), dtype=bool)
    return result.outliers


def fitted(entry: Entry) -> Trace | None:
    """Return the fitted curve, by rising pressure where it was fitted, or None."""
    result = entry.result
    if result is None or result.model_mm is None:
        return None
    there = np.isfinite(result.model_mm)
    if not there.any():
        return None
    return thin(Trace(entry.curve.pressure_mbar[there], np.asarray(result.model_mm)[there]))


def fit_band(entry: Entry) -> tuple[Trace, ...]:
    """Return the lines between which 19 of 20 samples of the fitted curve are expected."""
    line = fitted(entry)
    mbar, sd_um = noise_band(entry)
    if line is None or not len(mbar):
        return ()
    order = np.argsort(line.pressure_mbar)
    at, w = line.pressure_mbar[order], line.deflection_mm[order]
    wide = _NOISE * 1e-3 * np.interp(at, mbar, sd_um)
    return tuple(thin(Trace(at, w + side * wide), _BAND_POINTS) for side in (-1.0, 1.0))


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
    value = max(value, least) or 1.0
    decade = 10.0 ** math.floor(math.log10(value))
    return next(s for s in _STEPS if s * decade >= value * (1 - 1e-12)) * decade


def round_down(value: float) -> float:
    """Return the round number that is not above `value`, which is positive."""
    decade = 10.0 ** math.floor(math.log10(value))
    return max(s for s in _STEPS if s * decade <= value * (1 + 1e-12)) * decade


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


# ---- the strip below the plot -----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Drawing:
    """Layers (rows, columns), the main one on top; labels at the first and the last row."""

    caption: str
    main: Bits
    second: Bits
    band: Bits
    top: str = ""
    bottom: str = ""

    def label(self, row: int) -> str:
        """Return the label of a row, or nothing."""
        if row == 0:
            return self.top
        return self.bottom if row == len(self.main) - 1 else ""


def against_time(live: Live, columns: int, rows: int) -> Drawing:
    """Return deflection (main) and pressure (second, dotted) against time."""
    program = live.setup.program
    time_s, pressure_mbar, deflection_mm, _ = live.curve.columns
    last_s = float(time_s[-1]) if len(time_s) else 0.0
    whole_s = max(program.duration_s if program else 0.0, last_s)
    most_mbar = max(
        program.max_pressure_mbar if program else 0.0, float(pressure_mbar.max(initial=0.0))
    )
    deepest_mm = round_up(float(deflection_mm.max(initial=0.0)), least=0.1)
    at = share(time_s, 0.0, whole_s)
    long = f"against {whole_s:.3g} s: to {deepest_mm:g} mm; dotted to {most_mbar:g} mbar"
    return Drawing(
        long if len(long) <= columns + _LABELS else f"{deepest_mm:g} mm; dotted {most_mbar:g} mbar",
        main=dots(*_line(at, share(deflection_mm, 0.0, deepest_mm), 4 * columns), columns, rows),
        second=dots(
            *_line(at, share(pressure_mbar, 0.0, 1.05 * most_mbar), columns // 2),
            columns,
            rows,
        ),
        band=dots([], [], columns, rows),
        bottom="0",
    )


def residual(entry: Entry, columns: int, rows: int) -> Drawing | None:
    """Return measured minus fitted against pressure, and the band of two standard deviations.

    None where nothing was fitted.
    """
    result = entry.result
    if result is None or result.model_mm is None:
        return None
    left_um = 1e3 * (entry.curve.deflection_mm - np.asarray(result.model_mm))
    there = np.isfinite(left_um)
    if not there.any():
        return None
    mbar = entry.curve.pressure_mbar
    edge_mbar, sd_um = noise_band(entry)
    edge_um = _NOISE * sd_um
    widest_um = float(edge_um.max(initial=0.0))
    most_um = round_up(1.05 * max(float(np.abs(left_um[there]).max()), widest_um), least=0.1)
    top_mbar = 1.05 * max(float(mbar.max()), 1.0)
    band = dots([], [], columns, rows)
    if widest_um:
        across = (np.arange(0, 2 * max(columns, 0), 2) + 0.5) / (2 * max(columns, 1))
        height_um = np.interp(across * top_mbar, edge_mbar, edge_um, np.nan, np.nan)
        for side in (-1.0, 1.0):
            at = share(side * height_um, -most_um, most_um)
            band = band | dots(across, at, columns, rows)
    noise = f"±{np.sqrt(np.mean(edge_um**2)):.2g}" if widest_um else ""
    long = f"residual µm{noise and f', noise {noise} dotted'}, rms {result.rms_um:.3g}"
    return Drawing(
        long if len(long) <= columns + _LABELS else f"residual µm{noise and f'; dotted {noise}'}",
        main=dots(
            share(entry.curve.pressure_mbar[there], 0.0, top_mbar),
            share(left_um[there], -most_um, most_um),
            columns,
            rows,
        ),
        second=dots([], [], columns, rows),
        band=band,
        top=f"+{most_um:g}",
        bottom=f"-{most_um:g}",
    )


def noise_band(entry: Entry) -> tuple[Array, Array]:
    """Return pressures (n,), mbar, rising, of what was fitted, and a sample's noise there, µm.

    One standard deviation: the noise of the deflection, and that of the pressure through the slope
    of the curve. Empty where the noise is unknown.
    """
    result = entry.result
    if result is None or result.model_mm is None or not result.noise_um:
        return np.zeros(0), np.zeros(0)
    from skinlab.inference.noise import sample_sd_mm  # slow to import

    model_mm = np.asarray(result.model_mm)
    there = np.isfinite(model_mm)
    mbar = entry.curve.pressure_mbar[there]
    known = result.uncertainty
    known_mbar = None if known is None else known.pressure_noise_mbar  # stated or found
    time_s = entry.curve.time_s[there]
    sd_mm = sample_sd_mm(time_s, mbar, model_mm[there], result.noise_um, known_mbar)
    order = np.argsort(mbar)
    return mbar[order], 1e3 * sd_mm[order]


def _line(
    x: Sequence[float] | np.ndarray, y: Sequence[float] | np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return points evenly spread along a polyline, at most `most` of them."""
    if len(x) < 2:
        return np.asarray(x), np.asarray(y)
    reach = float(x[-1]) - float(x[0])
    at = np.linspace(x[0], x[-1], max(int(most * min(reach, 1.0)), 2))
    return at, np.interp(at, x, y)
