"""What the list of visits says, as pure functions: rows, search, order, trend."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from datetime import datetime
from typing import TYPE_CHECKING

from skinlab.errors import InputError
from skinlab.inference.result import Value
from skinlab.mechanics.names import of_law, unit_of
from skinlab.recording.visit_index import VisitRow
from skinlab.report.rounding import interval_words
from skinlab.text import counted
from skinlab.tui.value_text import meaning, name_of, scaled_bar, value_scale

if TYPE_CHECKING:
    from skinlab.studies.change import Changes

ORDERS: tuple[tuple[str, Callable[[VisitRow], tuple[str, ...]], bool], ...] = (
    ("latest first", lambda v: (v.measured_utc, v.file), True),
    ("by subject and site", lambda v: (v.subject, v.site, v.measured_utc), False),
    ("by site", lambda v: (v.site, v.subject, v.measured_utc), False),
)
TITLES = ("when", "subject", "site", "curves", "X1 MPa", "measured", "file")
_WHEN, _DAY = 16, 10  # characters of day and minute, of the day


def when(row: VisitRow) -> str:
    """Return day and minute in local time; a day alone, or that it was imported, as it is."""
    if not row.measured_utc:
        return f"imported {row.created_utc[:_DAY]}" if row.created_utc else ""
    if len(row.measured_utc) == _DAY:
        return row.measured_utc
    try:
        return f"{datetime.fromisoformat(row.measured_utc).astimezone():%Y-%m-%d %H:%M}"
    except ValueError:
        return row.measured_utc[:_WHEN]


def cells(row: VisitRow) -> tuple[str, ...]:
    """Return the cells of a visit, in the order of `TITLES`."""
    if row.problem:
        _, of_file, why = row.problem.rpartition(f"{row.file}: ")  # the folder is in the title
        return ("", "", "", "", "", f"{of_file}{why}", row.file)
    first = next(iter(of_law([row.parameters])), "")
    value = row.parameters.get(first)
    words = "" if value is None else interval_words(Value(*value))
    simulated = "simulated, " if row.simulated else ""
    measured = simulated + "; ".join(row.alike)
    return (when(row), row.subject, row.site, str(row.curves), words, measured, row.file)


def found(rows: Iterable[VisitRow], text: str) -> list[VisitRow]:
    """Return the visits in which all words of a search occur, upper and lower case alike."""
    words = text.casefold().split()
    return [row for row in rows if all(w in " ".join(cells(row)).casefold() for w in words)]


def series(rows: Iterable[VisitRow], of: VisitRow) -> list[VisitRow]:
    """Return the visits of the same subject and site that can be compared, the oldest first.

    Those that nobody says the day of come last: they have no place over time.
    """
    same = [
        row
        for row in rows
        if (row.subject, row.site, row.simulated, row.alike)
        == (of.subject, of.site, of.simulated, of.alike)
        and row.parameters
    ]
    return sorted(same, key=lambda v: (not v.measured_utc, v.measured_utc, v.file))


def dated(rows: Iterable[VisitRow]) -> list[VisitRow]:
    """Return the visits that have a place over time."""
    return [row for row in rows if row.measured_utc]


def at_control(rows: Sequence[VisitRow], visit: VisitRow, site: str) -> VisitRow:
    """Return the visit of the same subject at a site that was left alone, on the same day.

    Raises:
        InputError: there is none, or nobody says on which day the visit was.
    """
    day = visit.measured_utc[:_DAY]
    if not day:
        raise InputError(
            f"{visit.file}: imported, and nobody said when it was measured: no control; k takes it "
            "back"
        )
    same = [
        row
        for row in rows
        if (row.subject, row.site, row.simulated) == (visit.subject, site, visit.simulated)
        and row.measured_utc[:_DAY] == day
        and row.parameters
    ]
    if not same:
        raise InputError(
            f"{site or 'no site'} of {visit.subject or 'no subject'} was not measured on {day}: no "
            "control; k takes it back"
        )
    return max(same, key=lambda row: row.measured_utc)


def trend_lines(rows: Sequence[VisitRow], columns: int, changes: Changes | None) -> list[str]:
    """Return the values over visits, with the smallest change that could be shown since the first.

    That reach is drawn behind the bars (░), around the first visit's value.
    """
    rows, without = dated(rows), len(rows) - len(dated(rows))
    left_out = (
        [
            f"{counted(without, 'imported visit')} left out: no day of the measurement is stated "
            "(skinlab import --measured)."
        ]
        if without
        else []
    )
    if len(rows) < 2:
        needs = "A trend needs two visits of the same subject and site, measured alike."
        return [needs, *left_out]
    whose = f"{rows[0].subject or 'no subject'}, {rows[0].site}"
    lines = [f"{whose}: {counted(len(rows), 'visit')}", *left_out]
    smallest = {} if changes is None else {c.name: c for c in changes.parameters}
    width = max(columns - _WHEN - 2, 8)
    for name in of_law(row.parameters for row in rows):
        values = [(row, Value(*row.parameters[name])) for row in rows if name in row.parameters]
        if not values:
            continue
        first, behind = values[0][1].value, None
        change = smallest.get(name)
        if change is not None:
            if change.scale == "log":
                factor = math.exp(change.smallest)
                behind = (first / factor, first * factor)
            else:
                behind = (first - change.smallest, first + change.smallest)
        numbers = [x for _, v in values for x in (v.low, v.high) if x is not None]
        low, high, logarithmic = value_scale(name, [*numbers, *(behind or ())])
        unit = unit_of(name)
        lines += ["", f"{name_of(name)}{unit and f' ({unit})'}  {meaning(name)}"]
        ends = f"{low:g}", f"{high:g}"
        lines.append(f"{'':{_WHEN + 2}}{ends[0]}{ends[1]:>{width - len(ends[0])}}")
        for row, value in values:
            bar = scaled_bar(value, low, high, width, behind, logarithmic=logarithmic)
            lines.append(f"{when(row):{_WHEN}}  {bar}")
    if changes is not None:
        from skinlab.studies.change import in_words

        lines += ["", "░ no change could be shown within it. The last visit against the first:"]
        lines += [f"  {line}" for line in in_words(changes)]
    return lines
