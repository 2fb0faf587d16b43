"""Time is missing between two samples, or the instrument's clock went back."""

from __future__ import annotations

import numpy as np

from skinlab.quality.gates.base import CurveSoFar, Finding, Gate
from skinlab.quality.settings import TIMES
from skinlab.text import counted


def _check(view: CurveSoFar) -> Finding | None:
    advice = "repeat; if it stays so, look at cable and computer load"
    if view.steps_back:
        return Finding(
            GATE.name,
            f"the instrument's clock went back {counted(view.steps_back, 'time')}",
            advice,
        )
    view = view.tail
    if len(view.time_s) < 3:
        return None
    gaps = np.diff(view.time_s)
    k = int(np.argmax(gaps))
    if gaps[k] <= TIMES.longest_gap * view.interval_s:
        return None
    return Finding(
        GATE.name,
        f"{gaps[k]:.3g} s without a sample after {view.time_s[k]:.2f} s, where one was due every "
        f"{view.interval_s:.3g} s",
        advice,
    )


GATE = Gate(
    "time_gaps",
    _check,
    meaning="time is missing between samples, or the instrument's clock went back",
    threshold=f"{TIMES.longest_gap:g} intervals: one lost frame makes 2",
)
