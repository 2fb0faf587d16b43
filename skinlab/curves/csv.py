"""Curves as CSV: `time_s,pressure_mbar,deflection_mm`, one row a sample in time order.

An exported session has the segment of its program beside them, which a clock tells only nearly.
"""

from __future__ import annotations

import csv
import hashlib
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from drivers.numbers import number_in
from drivers.reading import read_whole
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.settings import SAMPLES
from skinlab.errors import InputError
from skinlab.plugins import warn
from skinlab.text import counted

COLUMNS = ("time_s", "pressure_mbar", "deflection_mm")
SEGMENT = "segment"
APERTURE = "aperture_mm"
IMPORT = "`skinlab import` makes a session of what other software exported"
_COMMA = f"; is the decimal sign a comma? Use a point; {IMPORT}"
_LARGEST = {"time_s": 1e10, "pressure_mbar": 1e4, "deflection_mm": 100.0}  # beyond, no reading


def read_curve(path: Path, setup: Setup) -> Curve:
    """Return the curve in this file.

    With the indices of a column `segment`, if it has one and the setup the program that it is of.
    Warns of times that seem to be milliseconds.

    Raises:
        InputError: no such file, no UTF-8, a missing column, a value that is no finite number, a
            time that does not increase, another opening, or fewer than 5 samples; names the line.
    """
    try:
        content = read_whole(path)
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not UTF-8 text; expected a curve CSV; {IMPORT}") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    try:
        rows, more = _rows(path, text, setup.aperture_mm)
    except csv.Error as error:
        raise InputError(f"{path}: {error}; expected a curve CSV") from None
    if len(rows) < SAMPLES.fewest:
        raise InputError(
            f"{path}: {counted(len(rows), 'sample')}; expected at least {SAMPLES.fewest}"
        )
    data = np.array(rows)
    source = "sha256:" + hashlib.sha256(content).hexdigest()
    segment = None if setup.program is None else _segments(more, len(setup.program.segments))
    if setup.program is None:  # else the program tells
        _ask_about_clock(path, data[:, 0])
    return Curve(str(path), setup, data[:, 0], data[:, 1], data[:, 2], segment, source=source)


def _ask_about_clock(path: Path, time_s: NDArray[np.float64]) -> None:
    """Warn of times that are likely to be milliseconds: a slow rig may have such a clock."""
    step, whole = float(np.median(np.diff(time_s))), float(time_s[-1] - time_s[0])
    if step >= SAMPLES.slow_s:
        warn(
            f"{path}: time_s has a sample every {step:g} s, and {whole:.0f} s in all; is it in "
            "milliseconds?"
        )


def _segments(texts: Sequence[str], count: int) -> NDArray[np.intp] | None:
    """Return indices of segments, the end (`count`) included; None where these are none."""
    if not texts or not all(text.isascii() and text.isdigit() for text in texts):
        return None
    found = np.array([min(int(text), count + 1) for text in texts], dtype=np.intp)
    return found if found[-1] <= count and (np.diff(found) >= 0).all() else None


def _rows(path: Path, text: str, aperture_mm: float) -> tuple[list[tuple[float, ...]], list[str]]:
    """Return the rows, and what their column `segment` says; one of the opening has to agree."""
    lines = csv.reader(text.splitlines())
    header = [name.strip() for name in next(lines, [])]
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise InputError(
            f"{path}: line 1: missing column {', '.join(missing)}; "
            f"expected the header {','.join(COLUMNS)}{_separator_hint(header)}; {IMPORT}"
        )
    twice = [name for name in COLUMNS if header.count(name) > 1]
    if twice:
        raise InputError(
            f"{path}: line 1: column {', '.join(twice)} is there twice; "
            f"expected the header {','.join(COLUMNS)}"
        )
    where = [header.index(name) for name in COLUMNS]
    rows: list[tuple[float, ...]] = []
    segment = header.index(SEGMENT) if header.count(SEGMENT) == 1 else None
    opening = header.index(APERTURE) if header.count(APERTURE) == 1 else None
    segments: list[str] = []
    for fields in lines:
        line = lines.line_num
        if not any(field.strip() for field in fields):
            continue
        if len(fields) != len(header):
            hint = _COMMA if len(fields) > len(header) else ""
            raise InputError(
                f"{path}: line {line}: {counted(len(fields), 'field')}, expected "
                f"{len(header)}{hint}"
            )
        if opening is not None:
            _check_opening(path, line, fields[opening], aperture_mm)
        values = tuple(
            _number(path, line, name, fields[k]) for name, k in zip(COLUMNS, where, strict=True)
        )
        if rows and values[0] <= rows[-1][0]:
            raise InputError(
                f"{path}: line {line}: time_s {values[0]:g} does not increase "
                f"(before it: {rows[-1][0]:g})"
            )
        rows.append(values)
        if segment is not None:
            segments.append(fields[segment].strip())
    return rows, segments


def _check_opening(path: Path, line: int, text: str, aperture_mm: float) -> None:
    """Refuse a row of another opening than the curve's: it would be one curve in silence.

    Raises:
        InputError: it is; names the line.
    """
    try:
        other = abs(number_in(text) - aperture_mm) > 1e-6
    except ValueError:
        return
    if other:
        raise InputError(
            f"{path}: line {line}: {APERTURE} is {text.strip()}, and the curve is stated to be of "
            f"{aperture_mm:g}; expected one curve of one opening in a file"
        )


def _number(path: Path, line: int, name: str, text: str) -> float:
    try:
        value = number_in(text)
    except ValueError:
        hint = _COMMA if "," in text else ""
        raise InputError(
            f"{path}: line {line}: {name} is {text.strip()!r}, expected a number{hint}"
        ) from None
    if not math.isfinite(value):
        raise InputError(f"{path}: line {line}: {name} is {text.strip()}, expected a finite number")
    if abs(value) > _LARGEST[name]:
        raise InputError(
            f"{path}: line {line}: {name} is {text.strip()}, expected at most {_LARGEST[name]:g}"
        )
    return value


def _separator_hint(header: list[str]) -> str:
    if len(header) == 1 and any(sign in header[0] for sign in ";\t"):
        return ", separated by commas"
    return ""


def write_curve(stream: TextIO, curve: Curve) -> None:
    """Write the curve; 9 digits, so that nothing that a sensor can tell is lost.

    Of times that begin late (the clock of a computer) as many more.
    """
    stream.write(",".join(COLUMNS) + "\n")
    span_s = float(np.ptp(curve.time_s)) if len(curve) else 0.0
    late = float(np.abs(curve.time_s).max()) / span_s if span_s > 0 else 1.0
    digits = min(9 + max(math.floor(math.log10(late)), 0), 15)
    columns: Iterable[tuple[float, float, float]] = zip(
        curve.time_s.tolist(),
        curve.pressure_mbar.tolist(),
        curve.deflection_mm.tolist(),
        strict=True,
    )
    for t, p, w in columns:
        stream.write(f"{t:.{digits}g},{p:.9g},{w:.9g}\n")
