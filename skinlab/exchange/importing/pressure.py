"""The pressure channel: suction counted positive, or computed from the program that ran."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.curves.program import MOST_PRESSURE_MBAR
from skinlab.curves.settings import SAMPLES
from skinlab.errors import InputError
from skinlab.exchange.importing.questions import Answers, Question
from skinlab.exchange.importing.table import Table
from skinlab.text import counted

Array = NDArray[np.float64]

_BEYOND = 1.2  # times the highest pressure of any program: no reading that is a little off


def suction(pressure_mbar: Array, table: Table) -> tuple[Array, list[str]]:
    """Return the pressure (rows,) with suction positive, and what was done to it.

    Raises:
        InputError: no suction of a probe; names the line.
    """
    notes = []
    if -pressure_mbar.min() > 3 * max(pressure_mbar.max(), 0.0):
        pressure_mbar = 0.0 - pressure_mbar  # and not -x: a zero stays a plain one
        notes.append("the pressure was negated: it is below that of the room, which is suction")
    far = np.flatnonzero(beyond_any_program(pressure_mbar))
    if far.size:
        raise InputError(
            f"line {table.lines[int(far[0])]}: a pressure of {pressure_mbar[far[0]]:g} mbar; "
            f"expected a suction of 0-{MOST_PRESSURE_MBAR:g} mbar, below that of the room "
            "(is its unit right?)"
        )
    if pressure_mbar.max() <= 0 or -pressure_mbar.min() > pressure_mbar.max() / 3:
        raise InputError(
            f"the pressure goes from {pressure_mbar.min():g} to {pressure_mbar.max():g} mbar; "
            "expected a suction"
        )
    return pressure_mbar, notes


def beyond_any_program(pressure_mbar: Array) -> NDArray[np.bool_]:
    """Return which readings (rows,) no program asks for, nor comes near: their unit is another."""
    return np.asarray(np.abs(pressure_mbar) > _BEYOND * MOST_PRESSURE_MBAR)


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
    running = int((inside & (since >= -1e-6 * interval)).sum())
    if running < SAMPLES.fewest:
        raise InputError(
            f"{counted(running, 'sample')} while the program ran, which started at {start_s:g} s; "
            f"expected at least {SAMPLES.fewest}"
        )
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
    try:
        start = float(stated)
    except ValueError:
        start = float("nan")
    if not np.isfinite(start):
        raise InputError(f"--program-start-s {stated!r}: expected a time in s")
    return start
