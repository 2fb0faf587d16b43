"""The Cutometer's own numbers for step curves (mode 1): Ue, Uv, Uf, Ur, Ua and R0 to R9.

They are readings of the deflection at a few moments, and ratios of those. Publications differ on
the moments, so each number carries the formula that it was computed by; docs/cutometer.md has the
sources. The elastic part is read twice: 0.1 s after a change of pressure, as the instrument does,
and at the bend of the curve ("inflection"), which J. Cosmet. Sci. 67:37 (2016) found at 0.11 to
0.19 s.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.curves.lone_readings import white_noise
from skinlab.curves.settings import STEP
from skinlab.errors import InputError

Array = NDArray[np.float64]

ELASTIC_S = 0.1  # the instrument's border between elastic and viscous


@dataclass(frozen=True)
class Pulse:
    """One step of suction; times in s, as the curve has them."""

    start_s: float  # the pressure leaves rest
    stop_s: float  # it leaves the step
    before_start_s: float  # the last sample at rest before
    before_stop_s: float  # the last sample at the step
    end_s: float  # the last sample of the off-time: before the next start, or of the record
    rise_s: float  # from rest to the step
    fall_s: float | None  # back; None where the record ends before
    pressure_mbar: float


@dataclass(frozen=True)
class Number:
    """One of the numbers: its value, or the reason why there is none."""

    formula: str
    unit: str  # mm or 1
    value: float | None
    sd: float | None  # from the noise of the deflection
    reason: str | None = None


@dataclass(frozen=True)
class StepNumbers:
    """What a step curve gives."""

    name: str
    pulses: tuple[Pulse, ...]
    noise_mm: float  # standard deviation of one sample of the deflection
    interval_s: float  # median time between samples
    numbers: Mapping[str, Number]  # by the 0.1 s rule
    bend_s: float | None  # after the start of suction
    bend_reason: str | None  # why there is none
    at_bend: Mapping[str, Number]  # the numbers that change with it; empty without one
    flags: tuple[str, ...]


# Readings: moments at which the deflection w is read. Names as in the formulas.
_WORDS = {
    "w0": "w(before start)",
    "we": "w(start + {t})",
    "wf": "w(before stop)",
    "wr": "w(stop + {t})",
    "wa": "w(end of off-time)",
    "wl": "w(before stop, last pulse)",
    "wm": "w(end of off-time, last pulse)",
}

# Name: (formula in words, unit, formula, the readings it needs).
_Formula = tuple[str, str, Callable[[Mapping[str, float]], float], tuple[str, ...]]


def _ue(r: Mapping[str, float]) -> float:
    return r["we"] - r["w0"]


def _uv(r: Mapping[str, float]) -> float:
    return r["wf"] - r["we"]


def _uf(r: Mapping[str, float]) -> float:
    return r["wf"] - r["w0"]


def _ur(r: Mapping[str, float]) -> float:
    return r["wf"] - r["wr"]


def _ua(r: Mapping[str, float]) -> float:
    return r["wf"] - r["wa"]


FORMULAS: dict[str, _Formula] = {
    "Ue": ("{we} - {w0}", "mm", _ue, ("we", "w0")),
    "Uv": ("Uf - Ue = {wf} - {we}", "mm", _uv, ("wf", "we")),
    "Uf": ("{wf} - {w0}", "mm", _uf, ("wf", "w0")),
    "Ur": ("{wf} - {wr}", "mm", _ur, ("wf", "wr")),
    "Ua": ("{wf} - {wa}", "mm", _ua, ("wf", "wa")),
    "R0": ("Uf", "mm", _uf, ("wf", "w0")),
    "R1": ("Uf - Ua = {wa} - {w0}", "mm", lambda r: r["wa"] - r["w0"], ("wa", "w0")),
    "R2": ("Ua / Uf", "1", lambda r: _ua(r) / _uf(r), ("wf", "wa", "w0")),
    "R3": ("{wl} - {w0}", "mm", lambda r: r["wl"] - r["w0"], ("wl", "w0")),
    "R4": ("{wm} - {w0}", "mm", lambda r: r["wm"] - r["w0"], ("wm", "w0")),
    "R5": ("Ur / Ue", "1", lambda r: _ur(r) / _ue(r), ("wf", "wr", "we", "w0")),
    "R6": ("Uv / Ue", "1", lambda r: _uv(r) / _ue(r), ("wf", "we", "w0")),
    "R7": ("Ur / Uf", "1", lambda r: _ur(r) / _uf(r), ("wf", "wr", "w0")),
    "R8": ("Ua", "mm", _ua, ("wf", "wa")),
    "R9": ("R3 - R0 = {wl} - {wf}", "mm", lambda r: r["wl"] - r["wf"], ("wl", "wf")),
}
CHANGE_WITH_BORDER = ("Ue", "Uv", "Ur", "R5", "R6", "R7")


def step_numbers(curve: Curve, noise_mm: float | None = None) -> StepNumbers:
    """Return the numbers of a step curve; its noise is estimated where it is not stated.

    The steps are found in the pressure channel, so that times are those of the suction that the
    skin felt; a program that is known must agree with them.

    Raises:
        InputError: the curve is no step; says in what.
    """
    pulses = find_pulses(curve)
    _check_program(curve, pulses)
    first, last = pulses[0], pulses[-1]
    noise = _noise_mm(curve, pulses) if noise_mm is None else noise_mm
    interval = float(np.median(np.diff(curve.time_s)))
    missing: dict[str, str] = {}
    if len(pulses) == 1:
        missing |= dict.fromkeys(("wl", "wm"), "needs several pulses; this curve has one")
    for pulse, names in ((first, ("wr", "wa")), (last, ("wm",))):
        if pulse.fall_s is None:
            missing |= {
                n: "the record ends before the suction does" for n in names if n not in missing
            }
    moments = {
        "w0": first.before_start_s,
        "wf": first.before_stop_s,
        "wa": first.end_s,
        "wl": last.before_stop_s,
        "wm": last.end_s,
    }
    numbers = _numbers(curve, moments, ELASTIC_S, noise, first, missing, FORMULAS)
    bend, reason = bend_after(curve, first, interval)
    at_bend: dict[str, Number] = {}
    if bend is not None:
        changed = {name: FORMULAS[name] for name in CHANGE_WITH_BORDER}
        at_bend = _numbers(curve, moments, bend, noise, first, missing, changed)
    flags = []
    if first.rise_s > ELASTIC_S:
        flags.append("slow_rise")  # the full suction comes after the moment of Ue
    if interval > 0.5 * ELASTIC_S + 1e-9:
        flags.append("coarse_sampling")  # Ue and Ur are interpolated
    if curve.partial:
        flags.append("partial_curve")
    return StepNumbers(
        curve.name, pulses, noise, interval, numbers, bend, reason, at_bend, tuple(flags)
    )


def find_pulses(curve: Curve) -> tuple[Pulse, ...]:
    """Return the steps of suction in the pressure channel.

    Raises:
        InputError: there is none, or what there is rises, stays or falls unlike a step.
    """
    p = curve.pressure_mbar
    top = float(p.max(initial=0.0))
    if top < 5.0:
        raise InputError(
            f"{curve.name}: the pressure stays below {top:.3g} mbar; expected a step of suction"
        )
    on = p >= 0.5 * top
    edges = np.flatnonzero(np.diff(on.astype(int)))
    begins = [int(e) + 1 for e in edges if not on[e]]
    ends = [int(e) + 1 for e in edges if on[e]]
    if on[0]:
        raise InputError(
            f"{curve.name}: the first sample is under {p[0]:.3g} mbar already; a step is measured "
            "from the rest before it"
        )
    pulses = []
    for number, begin in enumerate(begins):
        end = ends[number] if number < len(ends) else len(p)
        following = begins[number + 1] if number + 1 < len(begins) else len(p)
        pulses.append(_pulse(curve, begin, end, following, number + 1))
    # A pulse's off-time ends where the next suction starts.
    closed = [replace(q, end_s=n.before_start_s) for q, n in pairwise(pulses)]
    return (*closed, pulses[-1])


def _pulse(curve: Curve, begin: int, end: int, following: int, number: int) -> Pulse:
    """Return the pulse whose samples begin ≤ i < end are above half of the top."""
    t, p = curve.time_s, curve.pressure_mbar
    step = float(np.median(p[begin:end]))
    where = f"{curve.name}: pulse {number}"
    noise = white_noise(p)
    low = min(max(STEP.leaves * step, STEP.leaves_deviations * noise), 0.25 * step)
    high = step - low
    start, up = _crossing(curve, begin, low, -1), _crossing(curve, begin, high, 1)
    if start is None or up is None:
        raise InputError(f"{where}: the pressure never is at rest before it, or never at its step")
    stopped = end < len(p)
    stop = _crossing(curve, end, high, -1) if stopped else (float(t[-1]), len(t) - 1)
    down = _crossing(curve, end, low, 1) if stopped else None
    late = stopped and down is None and stop is not None and float(t[-1]) - stop[0] > STEP.slowest_s
    if stop is None or late or (down is None and following < len(p)):
        raise InputError(f"{where}: the pressure does not return to rest after it")
    rise, fall = up[0] - start[0], None if down is None else down[0] - stop[0]
    for what, seconds in (("rises", rise), ("falls", fall)):
        if seconds is not None and seconds > STEP.slowest_s:
            raise InputError(
                f"{where}: the pressure {what} over {seconds:.2g} s; expected a step (mode 1), "
                f"{STEP.slowest_s:g} s at most"
            )
    held = p[(t >= up[0]) & (t <= stop[0])]
    lasting = stop[0] - start[0]
    if held.size < 5 or lasting < 2 * ELASTIC_S:
        raise InputError(
            f"{where}: {held.size} samples at its pressure over {lasting:.2g} s; expected at "
            f"least 5 and {2 * ELASTIC_S:g} s"
        )
    # The median of neighbours: one noisy reading is no change of pressure.
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(held, min(5, held.size)), axis=-1)
    if float(np.abs(smooth - step).max()) > STEP.uneven * step:
        raise InputError(
            f"{where}: the pressure goes from {smooth.min():.3g} to {smooth.max():.3g} mbar; "
            f"expected a step (mode 1), held to {STEP.uneven:.0%}"
        )
    return Pulse(
        start[0], stop[0], float(t[start[1]]), float(t[stop[1]]), float(t[-1]), rise, fall, step
    )


def _crossing(curve: Curve, sample: int, level: float, direction: int) -> tuple[float, int] | None:
    """Return when the pressure passes a level, and the sample before that.

    The nearest time before (-1) or after (1) a sample; between two samples the pressure is a
    straight line. None where it never does.
    """
    t, p = curve.time_s, curve.pressure_mbar
    above = p > level
    changes = np.flatnonzero(above[1:] != above[:-1])
    chosen = changes[changes < sample][-1:] if direction < 0 else changes[changes >= sample - 1][:1]
    if not chosen.size:
        return None
    i = int(chosen[0])
    return float(t[i] + (t[i + 1] - t[i]) * (level - p[i]) / (p[i + 1] - p[i])), i


def _check_program(curve: Curve, pulses: tuple[Pulse, ...]) -> None:
    program = curve.setup.program
    if program is None:
        return
    asked = sum(1 for phase in program.phases if phase == "load")
    if asked != len(pulses) and not (curve.partial and len(pulses) < asked):
        raise InputError(
            f"{curve.name}: the program {program} has {asked} loadings, the pressure channel "
            f"{len(pulses)} pulses"
        )
    top = program.max_pressure_mbar
    if abs(pulses[0].pressure_mbar - top) > STEP.uneven * top:
        raise InputError(
            f"{curve.name}: the program {program} goes to {top:g} mbar, the pressure channel to "
            f"{pulses[0].pressure_mbar:.3g} mbar"
        )


def _noise_mm(curve: Curve, pulses: tuple[Pulse, ...]) -> float:
    """Return the standard deviation of one sample, from second differences while it is held.

    Creep is smooth, and has next to no second difference between neighbours.
    """
    found = []
    for pulse in pulses:
        late = pulse.start_s + 0.5 * (pulse.stop_s - pulse.start_s)
        held = curve.deflection_mm[(curve.time_s >= late) & (curve.time_s <= pulse.stop_s)]
        found.append(np.diff(held, n=2))
    seconds = np.concatenate(found)
    return float(np.sqrt(np.mean(seconds**2) / 6.0)) if seconds.size else 0.0


def bend_after(curve: Curve, pulse: Pulse, interval_s: float) -> tuple[float | None, str | None]:
    """Return where after the start of a pulse its curve bends, in s, or a reason why not.

    Two straight lines that meet at a sample are fitted to the first 0.5 s; the bend is where they
    meet if they fit best (least squares). It is known to about the time between two samples. The
    steepest loss of slope would not do: a thin skin stiffens while the pressure still rises.
    """
    if interval_s > 1.0 / STEP.rate_for_bend_hz + 1e-9:
        return None, (
            f"sampled every {interval_s:.3g} s; a bend between 0.1 and 0.2 s needs "
            f"{STEP.rate_for_bend_hz:g} samples a second"
        )
    t = curve.time_s - pulse.start_s
    near = (t >= 0.0) & (t <= min(STEP.bend_within_s, pulse.stop_s - pulse.start_s))
    t, w = t[near], curve.deflection_mm[near]
    best, least, loss = None, np.inf, 0.0
    for at in t[STEP.fewest_aside : -STEP.fewest_aside]:
        lines = np.column_stack([np.ones_like(t), t, np.maximum(t - at, 0.0)])
        found = np.linalg.lstsq(lines, w, rcond=None)[0]
        rest = w - lines @ found
        if (square := float(rest @ rest)) < least:
            best, least, loss = float(at), square, -float(found[2])
    if best is None or loss <= 0.0:
        return None, f"the curve does not bend within {STEP.bend_within_s:g} s of the start"
    return best, None


def _numbers(
    curve: Curve,
    moments: Mapping[str, float],
    border_s: float,
    noise_mm: float,
    first: Pulse,
    missing: Mapping[str, str],
    formulas: Mapping[str, _Formula],
) -> dict[str, Number]:
    times = {**moments, "we": first.start_s + border_s, "wr": first.stop_s + border_s}
    absent = dict(missing)
    for name, limit in (("we", first.stop_s), ("wr", first.end_s)):
        if times[name] > limit + 1e-9 and name not in absent:
            absent[name] = f"the pulse is over before {border_s:.3g} s"
    readings, noises = {}, {}
    for name, at in times.items():
        if name not in absent:
            readings[name], noises[name] = _read(curve, at, noise_mm)
    words = {name: text.format(t=f"{border_s:.3g} s") for name, text in _WORDS.items()}
    found = {}
    for name, (formula, unit, function, needs) in formulas.items():
        said = formula.format(**words)
        why = next((absent[n] for n in needs if n in absent), None)
        if why is None:
            value, sd = _with_noise(function, readings, noises, needs)
            if not np.isfinite(value):
                why = "divides by a deflection of zero"
        if why is None:
            found[name] = Number(said, unit, value, sd)
        else:
            found[name] = Number(said, unit, None, None, why)
    return found


def _read(curve: Curve, at: float, noise_mm: float) -> tuple[float, float]:
    """Return the deflection at a moment, on a straight line between two samples, and its noise."""
    t, w = curve.time_s, curve.deflection_mm
    i = int(np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2))
    share = float(np.clip((at - t[i]) / (t[i + 1] - t[i]), 0.0, 1.0))
    value = (1.0 - share) * w[i] + share * w[i + 1]
    return float(value), noise_mm * float(np.hypot(1.0 - share, share))


def _with_noise(
    function: Callable[[Mapping[str, float]], float],
    readings: Mapping[str, float],
    noises: Mapping[str, float],
    needs: tuple[str, ...],
) -> tuple[float, float]:
    """Return a number and its standard deviation to first order; readings err independently."""
    try:
        value = function(readings)
        square = 0.0
        for name in needs:
            slope = (
                function({**readings, name: readings[name] + 1e-6})
                - function({**readings, name: readings[name] - 1e-6})
            ) / 2e-6
            square += (slope * noises[name]) ** 2
    except ZeroDivisionError:
        return float("nan"), float("nan")
    return value, float(np.sqrt(square))
