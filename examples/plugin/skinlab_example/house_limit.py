"""The suction was more than this house allows."""

from __future__ import annotations

from skinlab.quality.gates.base import CurveSoFar, Finding, Gate

_MOST_MBAR = 150.0


def _check(view: CurveSoFar) -> Finding | None:
    highest = float(view.pressure_mbar.max(initial=0.0))
    if highest <= _MOST_MBAR:
        return None
    return Finding(
        GATE.name,
        f"the suction reached {highest:.0f} mbar, and {_MOST_MBAR:.0f} is this house's limit",
        "look at the site, and measure with a lower program",
    )


GATE = Gate(
    "house_limit",
    _check,
    meaning="the suction is more than this house allows",
    threshold="150 mbar, by this house's rules",
)
