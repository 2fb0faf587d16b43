"""Times of a clock to seconds: hh:mm:ss or mm:ss.fff, with AM or PM, behind a date."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from datetime import date

import numpy as np
from numpy.typing import NDArray

from skinlab.errors import InputError

_CLOCK = re.compile(
    r"""(?:(?P<date>[0-9]{1,4}([-./])(?:[0-9]{1,2}|[a-z]{3})\2[0-9]{1,4})(?:[T,]\s*|\s+))?
    (?:(?P<hour>[0-9]{1,2}):)?(?P<minute>[0-5]?[0-9]):(?P<second>[0-5][0-9])
    (?P<fraction>[.,][0-9]+)?
    (?:\s*(?P<half>[ap])\.?\s?m\.?)?
    (?P<zone>Z|\s?[+-][0-9]{2}:?[0-9]{2})?""",
    re.VERBOSE | re.IGNORECASE,
)
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
# Which part is the year, the month, the day: as it is said with each sign, else either way
_YEAR_FIRST, _DAY_FIRST, _MONTH_FIRST = (0, 1, 2), (2, 1, 0), (2, 0, 1)
_DAY_S, _HOUR_S = 86_400.0, 3600.0
_EXPECTED = "expected hh:mm:ss, or mm:ss with a fraction, in each row"


def is_clock(cell: str | float) -> bool:
    """Return whether a cell is a time of a clock, which one with two parts may be."""
    return isinstance(cell, str) and ":" in cell and _CLOCK.fullmatch(cell.strip()) is not None


def clock_s(cells: Sequence[str], lines: Sequence[int]) -> NDArray[np.float64]:
    """Return the seconds (rows,) of a column since midnight, or the full hour where there is none.

    They go on past midnight, without hours past the full hour.

    Raises:
        InputError: a cell is no time, or may be hours and minutes; names the line.
    """
    found = [_CLOCK.fullmatch(cell.strip()) for cell in cells]
    some_hours = any(match and match["hour"] for match in found)
    some_fractions = any(match and match["fraction"] for match in found)
    seconds, dates = [], []
    form = None
    for line, cell, match in zip(lines, cells, found, strict=True):
        if match is None:
            raise InputError(f"line {line}: the time is {cell.strip()[:40]!r}; {_EXPECTED}")
        told = match["hour"] is not None or match["date"] is None is match["half"]
        if not told or _may_be_hours(match, some_hours or not some_fractions):
            why = "may be hours and minutes, or minutes and seconds" if told else "has no seconds"
            raise InputError(f"line {line}: the time {cell.strip()!r} {why}; {_EXPECTED}")
        this = tuple(match[name] is not None for name in ("date", "half", "zone"))
        form = form or this
        if this != form:
            raise InputError(
                f"line {line}: the time {cell.strip()!r} is of another form than that of line "
                f"{lines[0]}; {_EXPECTED}"
            )
        seconds.append(_of_the_day(match, line))
        dates.append(match["date"])
    values = np.array(seconds)
    if dates[0] is not None:
        return values + _DAY_S * _days(dates, lines)
    round_s = _DAY_S if some_hours else _HOUR_S
    back = np.flatnonzero(np.diff(values) < -0.5 * round_s)
    if back.size:  # once: a curve takes minutes
        values[back[0] + 1 :] += round_s
    return values


def _may_be_hours(match: re.Match[str], others_are: bool) -> bool:
    return match["hour"] is None and match["fraction"] is None and others_are


def _of_the_day(match: re.Match[str], line: int) -> float:
    """Return the seconds since midnight, or the full hour; those of UTC where a zone is given."""
    hour, half, zone = int(match["hour"] or 0), match["half"], match["zone"]
    if half is not None:
        if not 1 <= hour <= 12:
            raise InputError(f"line {line}: the time is {match[0]!r}; {_EXPECTED}")
        hour = hour % 12 + 12 * (half.lower() == "p")
    if match["date"] is not None and hour > 23:
        raise InputError(f"line {line}: the time is {match[0]!r}; {_EXPECTED}")
    whole = 3600 * hour + 60 * int(match["minute"]) + int(match["second"])
    if zone is not None and zone.upper() != "Z":
        digits = zone.strip().replace(":", "")
        whole -= (60 * int(digits[1:3]) + int(digits[3:])) * (-60 if digits[0] == "-" else 60)
    return whole + float((match["fraction"] or ".0").replace(",", "."))


def _days(dates: Sequence[str], lines: Sequence[int]) -> NDArray[np.float64]:
    """Return the days (rows,) since the first date; 01/02 is read as what makes the curve shorter.

    Raises:
        InputError: a date is none; names the line.
    """
    if all(text == dates[0] for text in dates) and _readings(dates[0]):
        return np.zeros(len(dates))
    ways: list[dict[tuple[int, int, int], date]] = []
    for line, text in zip(lines, dates, strict=True):
        ways.append(_readings(text))
        if not ways[-1]:
            raise InputError(f"line {line}: there is no date {text!r}; expected one as 2026-03-01")
    orders = set(ways[0]).intersection(*ways)
    if not orders:
        raise InputError(f"line {lines[0]}: the dates are of several forms; expected one")
    spans = [
        np.array([(way[order] - ways[0][order]).days for way in ways], dtype=float)
        for order in sorted(orders)
    ]
    return min(spans, key=np.ptp)


def _readings(text: str) -> dict[tuple[int, int, int], date]:
    """Return the dates that a text may be, by the order of its parts."""
    parts = re.split(r"[-./]", text.lower())
    orders = [_YEAR_FIRST] if len(parts[0]) == 4 else [_DAY_FIRST]
    if "/" in text and len(parts[0]) < 3:
        orders.append(_MONTH_FIRST)
    numbers = [_MONTHS.index(part) + 1 if part in _MONTHS else part for part in parts]
    found = {}
    for order in orders:
        with suppress(ValueError):  # 31 February, or a month that is none
            year, month, day = (int(numbers[k]) for k in order)
            found[order] = date(year + 2000 * (year < 100), month, day)
    return found
