"""What is drawn below the plot, as pure functions: layers of braille dots and their labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.tui.canvas import Bits, dots, share
from skinlab.tui.trace import round_up
from skinlab.tui.ui_state import Entry, Live

Array = NDArray[np.float64]

_NOISE = 2.0  # standard deviations: 19 of 20 residuals lie inside the band


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
    return Drawing(
        f"against {whole_s:.3g} s: to {deepest_mm:g} mm; dotted to {most_mbar:g} mbar",
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
    noise = f", noise ±{np.sqrt(np.mean(edge_um**2)):.2g} dotted" if widest_um else ""
    return Drawing(
        f"residual µm{noise}, rms {result.rms_um:.3g}",
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
    from skinlab.inference.noise import pressure_noise_mbar, slope_mm_per_mbar  # slow to import

    model_mm = np.asarray(result.model_mm)
    there = np.isfinite(model_mm)
    mbar = entry.curve.pressure_mbar[there]
    spread_mbar = pressure_noise_mbar(entry.curve.time_s[there], mbar)
    slope = slope_mm_per_mbar(mbar, model_mm[there])
    sd_um = np.hypot(result.noise_um, 1e3 * slope * spread_mbar)
    order = np.argsort(mbar)
    return mbar[order], sd_um[order]


def _line(
    x: Sequence[float] | np.ndarray, y: Sequence[float] | np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return points evenly spread along a polyline, at most `most` of them."""
    if len(x) < 2:
        return np.asarray(x), np.asarray(y)
    reach = float(x[-1]) - float(x[0])
    at = np.linspace(x[0], x[-1], max(int(most * min(reach, 1.0)), 2))
    return at, np.interp(at, x, y)
