"""The pressure does not follow the program: too much, too late, or not as steep."""

from __future__ import annotations

import numpy as np

from skinlab.curves.program import Ramp, Until
from skinlab.quality.gates.asked import LAG_S, STEP_MBAR_PER_S
from skinlab.quality.gates.base import Array, CurveSoFar, Finding, Gate, longest_run
from skinlab.quality.gates.expected import (
    FEWEST_SAMPLES,
    SHORTEST_S,
    open_chamber,
    tolerance_mbar,
)

_SLOPE = 0.1  # relative: the loading rate matters to a skin that creeps
_SIGMAS = 4.0  # of the slope's own error, so that noise over a short ramp is no finding
_LEAST_RISE_MBAR = 10.0
_FEWEST = 6

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
    if j - i < FEWEST_SAMPLES or view.time_s[j - 1] - view.time_s[i] < SHORTEST_S:
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
        if not isinstance(segment, Ramp | Until) or segment.rate_mbar_per_s > STEP_MBAR_PER_S:
            continue
        here = np.flatnonzero(view.segment == k)
        begun = dict(view.began_s).get(k)
        if not len(here) or begun is None:
            continue
        t, p = view.time_s[here], view.pressure_mbar[here]
        steady = t >= begun + LAG_S
        t, p = t[steady], p[steady]
        if len(t) < _FEWEST or segment.rate_mbar_per_s * (t[-1] - t[0]) < _LEAST_RISE_MBAR:
            continue
        slope, error = _line(t, p)
        asked = segment.rate_mbar_per_s * (1.0 if program.phases[k] == "load" else -1.0)
        if abs(slope - asked) > _SLOPE * abs(asked) + _SIGMAS * error:
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
    threshold="10 % of the rate (and 4 standard errors of it); 3 mbar or 3 % for 0.3 s beyond a "
    "pump's lag of 0.25 s (0.5 s after a step)",
)
