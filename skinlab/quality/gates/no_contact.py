"""The probe is not on the skin: no suction builds up, or nothing follows it."""

from __future__ import annotations

import numpy as np

from skinlab.quality.gates.base import Array, CurveSoFar, Finding, Gate, longest_run
from skinlab.quality.gates.expected import least_deflection_mm
from skinlab.quality.settings import ASKED, SKIN

_ADVICE = "put the probe onto the skin, without gap, and repeat"


def _check(view: CurveSoFar) -> Finding | None:
    return _no_suction(view.tail) or _nothing_follows(view)


def _no_suction(view: CurveSoFar) -> Finding | None:
    band = view.asked_mbar
    if band is None:
        return None
    low = band[0]
    none = (low >= ASKED.least_asked_mbar) & (view.pressure_mbar <= ASKED.some_suction * low)
    run = longest_run(none, view.time_s)
    if run is None or view.time_s[run[1] - 1] - view.time_s[run[0]] < ASKED.shortest_s:
        return None
    last = run[1] - 1
    return Finding(
        GATE.name,
        f"the pressure is {view.pressure_mbar[last]:.0f} mbar where {low[last]:.0f} mbar was asked "
        "for: the chamber is open",
        _ADVICE,
    )


def _nothing_follows(view: CurveSoFar) -> Finding | None:
    n = len(view.time_s)
    if n < 2 * SKIN.few:
        return None
    # Growing: is it still now; complete: was it still at the highest suction.
    top = n if not view.complete else int(np.argmax(view.pressure_mbar))
    first = max(min(top, n - SKIN.few), 0)
    at = slice(first, first + SKIN.few)
    suction = _middle(view.pressure_mbar[at]) - _middle(view.pressure_mbar[: SKIN.few])
    least_mm = least_deflection_mm(view.setup, suction)
    if least_mm < SKIN.telling_mm:
        return None
    moved_mm = _middle(view.deflection_mm[at]) - _middle(view.deflection_mm[: SKIN.few])
    if abs(moved_mm) >= SKIN.still * least_mm:
        return None
    here = _middle(view.pressure_mbar[at])
    return Finding(
        GATE.name,
        f"at {here:.0f} mbar the skin has moved by no more than {1e3 * abs(moved_mm):.0f} µm",
        _ADVICE,
    )


def _middle(values: Array) -> float:
    """Return the median of a few values; numpy's is slow for them."""
    return float(sorted(values.tolist())[len(values) // 2])


GATE = Gate(
    "no_contact",
    _check,
    meaning="no suction builds up, or the skin does not move with it",
    threshold="20 % of the suction asked for; a quarter of what a skin three times as stiff as "
    "the stiffest of the paper's database would move",
)
