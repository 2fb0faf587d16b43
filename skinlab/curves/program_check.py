"""Whether a curve's pressure is that of the program that is stated of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import Program
from skinlab.curves.settings import AS_STATED, SAMPLES
from skinlab.curves.suction import check_suction
from skinlab.errors import InputError

Array = NDArray[np.float64]


def check_program(curve: Curve) -> Curve:
    """Return `followed`.

    Raises:
        InputError: the pressure is another program's; names the curve.
    """
    try:
        return followed(curve)
    except InputError as error:
        raise InputError(f"{curve.name}: {error}") from None


def followed(curve: Curve) -> Curve:
    """Return a curve, refused if its pressure is another program's: its phases would be wrong.

    A rig may be late, begin late or early, overshoot, leak a little, or be cut short: it is the
    nearest of all these that counts. A rise until a height is left aside: when it ended is not
    stated. Where first samples are lost, and the clock tells, segments are by the clock.

    Raises:
        InputError: the pressure is far off all the same.
    """
    program = curve.program_as_run
    if program is None or program.max_pressure_mbar <= 0:
        return curve
    try:
        check_suction(curve)
    except InputError:
        return curve  # another mistake, of which whoever uses the curve speaks
    top = program.max_pressure_mbar
    some = slice(None, None, math.ceil(len(curve) / AS_STATED.most_samples))
    time, pressure = curve.time_s[some], curve.pressure_mbar[some]
    path = PressurePath.of_program(program)
    best_mbar, best = math.inf, pressure
    for lag in AS_STATED.lags_s:
        for asked in _ends(path.late_by(lag), path, lag):
            # The clock began with the first sample, or that is lost and the clock tells.
            for begin in sorted({float(time[0]), 0.0}):
                for late in AS_STATED.late_s:
                    expected = asked(time - begin - late)
                    off_mbar = _off_mbar(pressure, expected, top)
                    if off_mbar <= AS_STATED.off * _seen_mbar(pressure, expected, top):
                        return _by_the_clock(curve, program, path)
                    if off_mbar < best_mbar:
                        best_mbar, best = off_mbar, expected
    raise InputError(
        f"the pressure does not follow its program {program}: "
        f"{_where(time - time[0], pressure, best, top)}; correct or leave out `program`"
    )


def _by_the_clock(curve: Curve, program: Program, path: PressurePath) -> Curve:
    """Return a curve whose clock began before its first sample, if so, with its segments."""
    first = float(curve.time_s[0])
    if curve.segment is not None or first <= 0.0:
        return curve
    top = program.max_pressure_mbar

    def least_mbar(begin_s: float) -> float:
        return min(
            _off_mbar(curve.pressure_mbar, path.late_by(lag)(curve.time_s - begin_s), top)
            for lag in AS_STATED.lags_s
        )

    if least_mbar(0.0) >= least_mbar(first):
        return curve
    return replace(curve, segment=program.segment_at(curve.time_s))


def _ends(late: PressurePath, path: PressurePath, lag_s: float) -> list[PressurePath]:
    """Return what may come after a program's end: it stays where it is, or is vented."""
    if path.pressure_mbar[-1] <= 0:
        return [late]
    end = path.time_s[-1]
    vented = PressurePath((*path.time_s, end), (*path.pressure_mbar, 0.0))
    return [late, vented.late_by(lag_s)]


def _off_mbar(pressure: Array, expected: Array, top: float) -> float:
    """Return by how much readings (n,) are off where there is suction: rms without glitches."""
    suction = np.maximum(pressure, expected) > AS_STATED.suction * top
    if int(suction.sum()) < SAMPLES.fewest:
        return 0.0
    off = np.sort(np.abs(pressure - expected)[suction])
    kept = off[: math.ceil((1.0 - AS_STATED.glitches) * len(off))]
    return float(np.sqrt(np.mean(kept**2)))


def _seen_mbar(pressure: Array, expected: Array, top: float) -> float:
    """Return the highest suction that a curve, which may be cut short, could show of a program."""
    highest = float(np.quantile(pressure, 1.0 - AS_STATED.glitches))
    seen = max(highest, float(expected.max()), AS_STATED.least_seen * top)
    return min(seen, top)


def _where(time_s: Array, pressure: Array, expected: Array, top: float) -> str:
    highest = float(np.quantile(pressure, 1.0 - AS_STATED.glitches / 2.0))
    if abs(highest - top) > AS_STATED.other_top * top:
        return f"it goes to {highest:.0f} mbar"
    off = np.abs(pressure - expected)
    worst = int(np.argsort(off)[math.ceil((1.0 - AS_STATED.glitches) * len(off)) - 1])
    return (
        f"after {time_s[worst]:.3g} s it is at {pressure[worst]:.0f} mbar in the place of "
        f"{expected[worst]:.0f}"
    )
