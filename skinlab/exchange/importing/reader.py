"""One exported file to one curve, with a sentence on how it was understood."""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.reading import read_whole
from skinlab.curves.csv import COLUMNS, read_curve
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program_check import check_program
from skinlab.curves.settings import SAMPLES
from skinlab.curves.suction import check_outward, check_suction
from skinlab.errors import InputError
from skinlab.exchange.importing.columns import Channel, find_channels
from skinlab.exchange.importing.decode import decode
from skinlab.exchange.importing.one_curve import check_one_curve
from skinlab.exchange.importing.pressure import (
    follow_program,
    from_the_start,
    most_glitches,
    of_another_unit,
    suction,
)
from skinlab.exchange.importing.questions import Answers, OpenError, Question
from skinlab.exchange.importing.table import Table
from skinlab.exchange.importing.text import table_from_text
from skinlab.exchange.importing.units import Role, find_unit
from skinlab.exchange.importing.xlsx import table_from_workbook
from skinlab.text import counted

Array = NDArray[np.float64]

MOST_BYTES = 64 << 20
_HEAD_BYTES = 4096
_SHORT_S = 0.1  # no suction comes and goes in so short a time
_ZERO_MM = 0.02  # a zero may be off by it
_ZIP, _OLE = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"


@dataclass(frozen=True, eq=False)
class Imported:
    """A curve, where it came from, and how it was understood, in words."""

    curve: Curve
    file: str  # its name, without folders
    sha256: str
    understood: tuple[str, ...]


def read_any(path: Path, setup: Setup, answers: Answers) -> Curve:
    """Return the curve in a file with our own heading, or in one that other software exported.

    A file with our heading is imported, too, where its numbers contradict the heading: a suction
    below zero, another unit, a dome that goes inwards.

    Raises:
        InputError: as `import_file`.
    """
    if path.suffix.lower() == ".csv" and _has_our_heading(path):
        curve = read_curve(path, setup)
        if _as_the_heading_says(curve):
            return check_program(curve)
    return replace(import_file(path, setup, answers).curve, name=str(path))


def _has_our_heading(path: Path) -> bool:
    """Return whether a CSV begins with our heading, and then numbers, not a line of units."""
    try:
        with path.open("rb") as file:
            lines = [file.readline(_HEAD_BYTES).decode("utf-8-sig", "replace") for _ in range(2)]
        head, first = (next(csv.reader([line]), []) for line in lines)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; expected one curve") from None
    except csv.Error:
        return False
    names = [name.strip() for name in head]
    if any(names.count(column) != 1 for column in COLUMNS):
        return False
    cells = dict(zip(names, first, strict=False))
    return any(find_unit(cells.get(column, "")) is None for column in COLUMNS)


def _as_the_heading_says(curve: Curve) -> bool:
    try:
        check_suction(curve)
    except InputError:
        return False
    inside = max(_reaches(curve.deflection_mm)) <= curve.setup.aperture_mm
    return inside and not (_inward(curve.deflection_mm) or of_another_unit(curve))


def import_file(path: Path, setup: Setup, answers: Answers) -> Imported:
    """Return the curve in a file that other software exported.

    Raises:
        InputError: it cannot be read or understood, or its pressure is another program's than the
            one stated; names the file, the line or column, and what was expected.
    """
    try:
        data = read_whole(path, MOST_BYTES)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; expected one curve") from None
    return import_bytes(path, data, setup, answers)


def import_bytes(path: Path, data: bytes, setup: Setup, answers: Answers) -> Imported:
    """Return the curve in these bytes, which are those of `path`.

    Raises:
        InputError: as `import_file`.
    """
    try:
        return _import(path, data, setup, answers)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _import(path: Path, data: bytes, setup: Setup, answers: Answers) -> Imported:
    if len(data) > MOST_BYTES:
        raise InputError(f"larger than {MOST_BYTES >> 20} MB; expected one curve")
    if not data.strip():
        raise InputError("empty; expected a table of time, pressure and deflection")
    answers.begin()
    if data.startswith(_OLE):
        raise InputError("an old Excel file (.xls); expected .xlsx or text")
    if data.startswith(_ZIP):
        table, form = table_from_workbook(data, answers)
    else:
        text, encoding = decode(data, answers)
        table, form = table_from_text(text, answers)
        form = f"{encoding}, {form}"
    if len(table.lines) < SAMPLES.fewest:
        with suppress(OpenError):  # a missing column is said first; nobody is asked for so few rows
            find_channels(table, answers.unasked(), pressure=setup.program is None)
        raise InputError(
            f"{counted(len(table.lines), 'sample')}; expected at least {SAMPLES.fewest}"
        )
    answers.begin([heading.text for heading in table.headings])
    check_one_curve(table, setup)
    channels = find_channels(table, answers, pressure=setup.program is None)
    curve, notes = _curve(path.name, setup, table, channels, answers)
    understood = (form, *_columns(table, channels), *_lines(table), *notes, *answers.recalled)
    return Imported(curve, path.name, hashlib.sha256(data).hexdigest(), understood)


def _columns(table: Table, channels: Mapping[Role, Channel]) -> list[str]:
    said = [f"{role}: column {c.name!r} in {c.unit}" for role, c in channels.items()]
    used = {c.name for c in channels.values()}
    left = [h.text for h in table.headings if h.text and h.text not in used]
    return [*said, f"columns not used: {', '.join(map(repr, left))}"] if left else said


def _lines(table: Table) -> list[str]:
    said = [f"{len(table.lines)} samples, lines {table.lines[0]}-{table.lines[-1]}"]
    gaps = np.flatnonzero(np.diff(table.lines) > 1)
    if gaps.size:
        said.append(f"empty lines among them, the first behind line {table.lines[int(gaps[0])]}")
    if table.before or table.after:
        said.append(f"other lines not used: {table.before} before, {table.after} after")
    return said


def _curve(
    name: str,
    setup: Setup,
    table: Table,
    channels: Mapping[Role, Channel],
    answers: Answers,
) -> tuple[Curve, list[str]]:
    time = channels["time"].values
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        k = int(late[0])
        raise InputError(
            f"line {table.lines[k + 1]}: time {time[k + 1]:g} s does not increase "
            f"(before it: {time[k]:g} s)"
        )
    deflection, notes = _outward(channels["deflection"].values, answers)
    if setup.program is None:  # else the program tells
        notes += _odd_times(time, table)
    _check_deflection(deflection, setup, table)
    curve = Curve(name, setup, time, np.zeros(len(time)), deflection)
    if "pressure" in channels:
        pressure, more = suction(time, channels["pressure"].values, table)
        curve = _checked_outward(replace(curve, pressure_mbar=pressure), answers)
        if setup.program is not None:
            curve, started = from_the_start(curve, answers)
            more += ["the pressure is the file's, not the program's", *started]
        return curve, [*notes, *more]
    curve, more = follow_program(curve, answers)
    return _checked_outward(curve, answers), [*notes, *more]


def _odd_times(time_s: Array, table: Table) -> list[str]:
    """Return a question where times are likely to be of another unit: a slow rig may have them.

    Or where the last one is likely to be no time: a sum that nothing names.
    """
    step_s, whole_s = float(np.median(np.diff(time_s))), float(time_s[-1] - time_s[0])
    if (rest_s := float(time_s[-2] - time_s[0])) < 0.5 * whole_s:
        return [
            f"line {table.lines[-1]}: {whole_s - rest_s:g} s behind the sample before it, and all "
            f"before are of {rest_s:g} s: is it a sum, and no sample?"
        ]
    if step_s >= SAMPLES.slow_s:
        every = f"a sample every {step_s:g} s, and {whole_s:.0f} s in all"
        return [f"{every}: is the time in milliseconds?"]
    if whole_s < _SHORT_S:
        return [f"{whole_s:.2g} s in all: is the time in minutes, or in days as of a spreadsheet?"]
    return []


def _checked_outward(curve: Curve, answers: Answers) -> Curve:
    try:
        check_outward(curve)
    except InputError as error:
        said = str(error).removeprefix(f"{curve.name}: ")
        if answers.stated("deflection-sign") == "-":  # its advice was taken, and was wrong here
            said = said.partition(": change its sign")[0] + ": leave out --deflection-sign -"
        raise InputError(said) from None
    return curve


def _outward(deflection: Array, answers: Answers) -> tuple[Array, list[str]]:
    """Return the deflection with the dome positive."""
    sign = answers.stated("deflection-sign")
    if sign is None and _inward(deflection):
        sign = answers.choose(
            Question(
                "deflection-sign",
                f"the deflection goes to {-_reaches(deflection)[0]:g} mm, and a dome is positive "
                "here; - if the file counts the dome as negative, + if not",
                ("-", "+"),
            )
        )
    if sign == "-":
        return 0.0 - deflection, ["the deflection was negated"]
    return deflection, []


def _inward(deflection: Array) -> bool:
    """Return whether most of the deflection (rows,) is below zero, and more than a zero is off."""
    below, above = _reaches(deflection)
    return below > max(_ZERO_MM, above)


def _reaches(deflection: Array) -> tuple[float, float]:
    """Return how far a deflection (rows,) goes below and above zero, mm, glitches aside."""
    ordered, aside = np.sort(deflection), most_glitches(len(deflection))
    return -float(ordered[aside]), float(ordered[-1 - aside])


def _check_deflection(deflection: Array, setup: Setup, table: Table) -> None:
    """Refuse a deflection that is higher than its opening is wide; single readings may be glitches.

    Raises:
        InputError: names the line.
    """
    if max(_reaches(deflection)) <= setup.aperture_mm:
        return
    far = np.flatnonzero(np.abs(deflection) > setup.aperture_mm)
    raise InputError(
        f"line {table.lines[int(far[0])]}: a deflection of {deflection[far[0]]:g} mm under an "
        f"opening of {setup.aperture_mm:g} mm; expected less (is its unit right?)"
    )
