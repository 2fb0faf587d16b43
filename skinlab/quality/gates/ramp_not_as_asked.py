"""The pressure does not follow the program: too much, too late, or not as steep."""

from __future__ import annotations

import numpy as np

from skinlab.curves.program import Ramp, Until
from skinlab.quality.gates.base import Array, CurveSoFar, Finding, Gate, longest_run
from skinlab.quality.gates.expected import open_chamber, tolerance_mbar
from skinlab.quality.settings import ASKED

_ADVICE = "look at pump, tube and filter; repeat, with a slower ramp if the pump cannot follow"


def _check(view: CurveSoFar) -> Finding | None:
    view = view.tail
    return None if open_chamber(view) else _slope(view) or _outside(view)


def _outside(view: CurveSoFar) -> Finding | None:
    band = view.asked_mbar
    if band is None:
        return None
    low, high, high_before = band
    p = view.pressure_mbar
    # Down is a matter of the valve: what was asked for within its time still counts.
    most = high_before + tolerance_mbar(high_before)
    out = (p > most) | (p < low - tolerance_mbar(low))
    run = longest_run(out, view.time_s)
    if run is None:
        return None
    i, j = run
    if j - i < ASKED.fewest or view.time_s[j - 1] - view.time_s[i] < ASKED.shortest_s:
        return None
    k = j - 1
    asked = f"{low[k]:.0f}" if high[k] - low[k] < 1 else f"{low[k]:.0f}–{high[k]:.0f}"
    return Finding(
        GATE.name,
        f"at {view.time_s[k]:.1f} s the pressure is {p[k]:.0f} mbar, where {asked} mbar was asked",
        _ADVICE,
    )


def _slope(view: CurveSoFar) -> Finding | None:
    program = view.setup.program
    if program is None or view.segment is None:
        return None
    for k, segment in enumerate(program.segments):
        if not isinstance(segment, Ramp | Until) or segment.rate_mbar_per_s > ASKED.step_mbar_per_s:
            continue
        here = np.flatnonzero(view.segment == k)
        begun = dict(view.began_s).get(k)
        if not len(here) or begun is None:
            continue
        t, p = view.time_s[here], view.pressure_mbar[here]
        steady = t >= begun + ASKED.lag_s
        t, p = t[steady], p[steady]
        if (
            len(t) < ASKED.slope_fewest
            or segment.rate_mbar_per_s * (t[-1] - t[0]) < ASKED.slope_rise_mbar
        ):
            continue
        slope, error = _line(t, p)
        asked = segment.rate_mbar_per_s * (1.0 if program.phases[k] == "load" else -1.0)
        if abs(slope - asked) > ASKED.slope * abs(asked) + ASKED.slope_sigmas * error:
            return Finding(
                GATE.name,
                f"the pressure goes by {slope:.3g} mbar/s in part {k + 1} of the program, where "
                f"{asked:.3g} mbar/s was asked for",
                _ADVICE,
            )
    return None


def _line(t: Array, p: Array) -> tuple[float, float]:
    """Return the slope of a straight line through the samples, and its standard error."""
    x = t - t.mean()
    slope = float(x @ p / (x @ x))
    left = p - p.mean() - slope * x
    return slope, float(np.sqrt(left @ left / (len(t) - 2) / (x @ x)))


GATE = Gate(
    "ramp_not_as_asked",
    _check,
    meaning="the pressure rises at another rate, comes late or goes too far",
    threshold=f"{100 * ASKED.slope:g} % of the rate (and {ASKED.slope_sigmas:g} standard errors of "
    f"it); {ASKED.off_mbar:g} mbar or {100 * ASKED.off_part:g} % for {ASKED.shortest_s:g} s beyond "
    f"a pump's lag of {ASKED.lag_s:g} s ({ASKED.lag_of_steps_s:g} s after a step)",
)
