"""The chamber leaks: the pump pulls, and the pressure stays behind or falls."""

from __future__ import annotations

import numpy as np

from skinlab.quality.gates.base import CurveSoFar, Finding, Gate, longest_run
from skinlab.quality.gates.expected import tolerance_mbar
from skinlab.quality.settings import ASKED


def _check(view: CurveSoFar) -> Finding | None:
    view = view.tail
    band = view.asked_mbar
    if band is None:
        return None
    low = band[0]
    p = view.pressure_mbar
    short = (
        (low >= ASKED.least_asked_mbar)
        & (p < low - tolerance_mbar(low))
        & (p > ASKED.some_suction * low)
    )
    run = longest_run(short, view.time_s)
    if run is None:
        return None
    i, j = run
    lasts_s = float(view.time_s[j - 1] - view.time_s[i])
    if j - i < ASKED.fewest or lasts_s < ASKED.shortest_s:
        return None
    asked_rise = float(low[j - 1] - low[i])
    if (
        asked_rise > tolerance_mbar(low[i:j]).max()
        and _rise(view, i, j) > ASKED.slower * asked_rise
    ):
        return None  # as steep as asked, and late: ramp_not_as_asked
    worst = i + int(np.argmax(low[i:j] - p[i:j]))
    return Finding(
        GATE.name,
        f"at {view.time_s[worst]:.1f} s the pressure is {p[worst]:.0f} mbar where {low[worst]:.0f} "
        "mbar was asked for",
        "press the probe evenly onto the skin, look at tape, tube and filter, and repeat",
    )


def _rise(view: CurveSoFar, i: int, j: int) -> float:
    slope = np.polyfit(view.time_s[i:j] - view.time_s[i], view.pressure_mbar[i:j], 1)[0]
    return float(slope * (view.time_s[j - 1] - view.time_s[i]))


GATE = Gate(
    "leak",
    _check,
    meaning="the pressure stays behind what was asked for, and does not catch up",
    threshold=f"{ASKED.off_mbar:g} mbar or {100 * ASKED.off_part:g} % for {ASKED.shortest_s:g} s: "
    "15 standard deviations of a pressure sensor (0.2 mbar), "
    "tighter than what makes the driver vent",
)
