"""A sensor gives one and the same reading."""

from __future__ import annotations

from skinlab.quality.gates.base import CurveSoFar, Finding, Gate
from skinlab.quality.gates.expected import tolerance_mbar
from skinlab.quality.gates.standstill import deflection_standstills, long_runs

_ADVICE = "switch the probe off and on; if it stays so, have the sensor looked at"


def _check(view: CurveSoFar) -> Finding | None:
    for still in deflection_standstills(view.tail):
        if still.at_top and still.clipped:
            continue  # it came back where it went: saturated
        return Finding(
            GATE.name,
            f"the deflection reads {still.reading:.3f} mm from {still.begin_s:.1f} to "
            f"{still.end_s:.1f} s, all the while the pressure goes from {still.low_mbar:.0f} to "
            f"{still.high_mbar:.0f} mbar",
            _ADVICE,
        )
    return _pressure(view.tail)


def _pressure(view: CurveSoFar) -> Finding | None:
    band = view.asked_mbar
    if band is None or len(view.time_s) < 2:
        return None
    p, t = view.pressure_mbar, view.time_s
    for i, j in long_runs(p, t):
        low, high = band[0][i:j], band[1][i:j]
        # Asked for: first clearly less than later, or the other way round.
        slack = float(tolerance_mbar(high).max())
        if low.max() - high.min() > slack:
            return Finding(
                GATE.name,
                f"the pressure reads {p[i]:.1f} mbar from {t[i]:.1f} to {t[j - 1]:.1f} s, where "
                f"{high.min():.0f} to {low.max():.0f} mbar were asked for",
                _ADVICE,
            )
    return None


GATE = Gate(
    "frozen",
    _check,
    meaning="a reading stands still while the suction changes",
    threshold="0.5 s, as the driver's limit; only where such a stiff skin would have moved three "
    "steps of the sensor",
)
