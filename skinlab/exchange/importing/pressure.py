"""The pressure channel: suction counted positive, or computed from the program that ran."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.numbers import number_in
from skinlab.curves.curve import Curve
from skinlab.curves.lone_readings import lone_readings, white_noise, without_lone_readings
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import MOST_PRESSURE_MBAR
from skinlab.curves.program_check import followed
from skinlab.curves.settings import AS_STATED, SAMPLES
from skinlab.curves.suction import beyond_any_program
from skinlab.errors import InputError
from skinlab.exchange.importing.questions import Answers, Question
from skinlab.exchange.importing.table import Table
from skinlab.text import counted

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FINELY = 2001  # times of a program at which its suction is looked at
_BELOW = 1 / 3  # of the highest suction: no reading goes so far below zero
_GLITCHES, _FEW = 0.02, 4  # readings that may be glitches: a share of very many, else so many


def suction(time_s: Array, pressure_mbar: Array, table: Table) -> tuple[Array, list[str]]:
    """Return the pressure (rows,) with suction positive, and what was done to it.

    Raises:
        InputError: no suction of a probe; names the line.
    """
    notes = []
    lone = _lone(time_s, pressure_mbar)
    low, high = _range(pressure_mbar, lone)
    if -low > 3 * max(high, 0.0):
        pressure_mbar = 0.0 - pressure_mbar  # and not -x: a zero stays a plain one
        low, high = -high, -low
        notes.append("the pressure was negated: it is below that of the room, which is suction")
    glitches = lone & (beyond_any_program(pressure_mbar) | (-pressure_mbar > _BELOW * high))
    notes += [
        f"line {table.lines[k]}: a pressure of {pressure_mbar[k]:g} mbar stands alone: a glitch, "
        "which no fit uses"
        for k in np.flatnonzero(glitches)
    ]
    low, high = _range(pressure_mbar, glitches)
    far = np.flatnonzero(beyond_any_program(pressure_mbar) & ~glitches)
    if far.size:
        raise InputError(
            f"line {table.lines[int(far[0])]}: a pressure of {pressure_mbar[far[0]]:g} mbar; "
            f"expected a suction of 0-{MOST_PRESSURE_MBAR:g} mbar, below that of the room "
            "(is its unit right?)"
        )
    if high <= 0 or -low > _BELOW * high:
        raise InputError(f"the pressure goes from {low:g} to {high:g} mbar; expected a suction")
    return pressure_mbar, notes


def of_another_unit(curve: Curve) -> bool:
    """Return whether readings of the pressure are such that no program comes near them."""
    beyond = beyond_any_program(curve.pressure_mbar)
    return bool((beyond & ~_lone(curve.time_s, curve.pressure_mbar)).any())


def _lone(time_s: Array, pressure_mbar: Array) -> Mask:
    """Return which readings (rows,) may be glitches: a few, each alone or with one more."""
    found = lone_readings(time_s, pressure_mbar, white_noise(pressure_mbar))
    return found if found.sum() <= most_glitches(len(found)) else np.zeros_like(found)


def _range(pressure_mbar: Array, aside: Mask) -> tuple[float, float]:
    kept = pressure_mbar[~aside]
    return float(kept.min()), float(kept.max())


def most_glitches(count: int) -> int:
    """Return how many of so many readings of a channel may be glitches."""
    return max(int(_GLITCHES * count), min(_FEW, count // 5))


def follow_program(curve: Curve, answers: Answers) -> tuple[Curve, list[str]]:
    """Return the curve with the pressure and the segments that its program asked for.

    Samples behind the program's end are left out, as the vent that ends a measurement is.

    Raises:
        InputError: it is open when the program started, or too few samples are left.
    """
    program = curve.setup.program
    assert program is not None
    start_s = _start(curve.time_s, answers)
    since = curve.time_s - start_s
    interval = float(np.median(np.diff(curve.time_s)))
    inside = since <= program.duration_s + 1e-6 * interval
    _check_running(int((inside & (since >= -1e-6 * interval)).sum()), start_s)
    notes = [f"the pressure is computed from the program, which started at {start_s:g} s"]
    if not inside.all():
        notes.append(f"{counted(int((~inside).sum()), 'sample')} after the program's end left out")
    short = float(since[inside][-1]) < program.duration_s - 2 * interval
    if short:
        notes.append("the curve ends before its program: partial")
    since = since[inside]
    return replace(
        curve,
        time_s=curve.time_s[inside],
        pressure_mbar=program.pressure_mbar(since),
        deflection_mm=curve.deflection_mm[inside],
        segment=program.segment_at(since),
        partial=short,
    ), notes


def from_the_start(curve: Curve, answers: Answers) -> tuple[Curve, list[str]]:
    """Return a curve with readings of the pressure from where its program started, and what is out.

    A file may begin long before: its rest would be fitted as the program's loading.

    Raises:
        InputError: too few samples are left, or the pressure is another program's.
    """
    program = curve.setup.program
    assert program is not None
    stated = answers.stated("program-start-s")
    start_s = _start_shown(curve) if stated is None else _time_s(stated)
    if start_s is None:
        return followed(curve), []
    interval = float(np.median(np.diff(curve.time_s)))
    since = curve.time_s - start_s
    running = since >= -1e-6 * interval
    _check_running(int((running & (since <= program.duration_s)).sum()), start_s)
    since = since[running]
    kept = replace(
        curve,
        time_s=since,
        pressure_mbar=curve.pressure_mbar[running],
        deflection_mm=curve.deflection_mm[running],
        # When a rise until a height ended the clock does not tell.
        segment=None if program.stops_at_heights else program.segment_at(since),
    )
    kept = replace(followed(kept), time_s=curve.time_s[running])
    before = int((~running).sum())
    return kept, [
        f"the program started at {start_s:g} s{', as the pressure shows' * (stated is None)}"
        + (f": {counted(before, 'sample')} before it left out" if before else "")
    ]


def _start_shown(curve: Curve) -> float | None:
    """Return when the program began, by the suction; None if with the file, but for a delay."""
    program, time = curve.program_as_run, curve.time_s
    if program is None:
        return None
    least_mbar = AS_STATED.suction * program.max_pressure_mbar
    pressure = without_lone_readings(time, curve.pressure_mbar)
    above = pressure > least_mbar
    lasting = np.flatnonzero(above[:-1] & above[1:])  # one reading alone may be a glitch
    if not lasting.size or above[0] or least_mbar <= 0:
        return None
    path = PressurePath.of_program(program)
    finely = np.linspace(0.0, program.duration_s, _FINELY)
    asked_s = float(finely[np.argmax(path(finely) > least_mbar)])
    begin = slice(max(int(lasting[0]) - 1, 0), int(lasting[0]) + 1)
    felt_s = float(np.interp(least_mbar, pressure[begin], time[begin]))
    start_s = felt_s - asked_s
    return start_s if abs(start_s - float(time[0])) > max(AS_STATED.late_s) else None


def _check_running(samples: int, start_s: float) -> None:
    if samples < SAMPLES.fewest:
        raise InputError(
            f"{counted(samples, 'sample')} while the program ran, which started at {start_s:g} s; "
            f"expected at least {SAMPLES.fewest}"
        )


def _start(time_s: Array, answers: Answers) -> float:
    """Return the time in the file at which the program started."""
    stated = answers.stated("program-start-s")
    if stated is None:
        if 0 <= time_s[0] <= 2 * float(np.median(np.diff(time_s))):
            return 0.0
        stated = answers.choose(
            Question(
                "program-start-s",
                f"the first sample is at {time_s[0]:g} s, and it is not known at which of the "
                "file's times the program started",
                ("0", f"{float(time_s[0])!r}"),
            )
        )
    return _time_s(stated)


def _time_s(stated: str) -> float:
    try:
        start = number_in(stated)
    except ValueError:
        start = float("nan")
    if not np.isfinite(start):
        raise InputError(f"--program-start-s {stated!r}: expected a time in s")
    return start
