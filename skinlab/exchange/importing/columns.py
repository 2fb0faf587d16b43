"""Which column is which channel, and in which unit: by headings, options, or questions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.errors import InputError
from skinlab.exchange.importing.clock import clock_s
from skinlab.exchange.importing.questions import Answers, Question
from skinlab.exchange.importing.table import Table
from skinlab.exchange.importing.units import Role, Unit, find_unit, units_of

Array = NDArray[np.float64]

_EXAMPLES: dict[Role, str] = {
    "time": "Time (s)",
    "pressure": "Pressure (mbar)",
    "deflection": "Deflection (mm)",
}


@dataclass(frozen=True, eq=False)
class Channel:
    """One channel: values (rows,) in s, mbar or mm, and what they were in the file."""

    values: Array
    name: str
    unit: str


def find_channels(table: Table, answers: Answers, *, pressure: bool) -> dict[Role, Channel]:
    """Return the channels; that of the pressure may be missing where `pressure` is False.

    Raises:
        InputError: a channel is missing, or it stays open which column or unit it is.
    """
    needed: list[Role] = ["time", "deflection"]
    known = any(heading.role == "pressure" for heading in table.headings) or _symbols(table)
    if pressure or known or answers.stated("pressure-column"):
        needed.insert(1, "pressure")
    chosen: dict[Role, int] = {}
    for role in needed:
        stated = answers.stated(f"{role}-column")
        if stated is not None:
            chosen[role] = _named(table, stated, role)
    for role in needed:
        if role not in chosen:
            chosen[role] = _found(table, role, tuple(chosen.values()), answers)
    if len(set(chosen.values())) < len(chosen):
        raise InputError("one column cannot be two channels; expected different columns")
    return {role: _channel(table, role, index, answers) for role, index in chosen.items()}


def _symbols(table: Table) -> list[int]:
    """Return the columns that are a pressure by their symbol; one that never moves is none."""
    each = enumerate(zip(table.headings, table.columns, strict=True))
    return [k for k, (h, values) in each if h.symbol and values is not None and np.ptp(values) > 0]


def _label(table: Table, index: int) -> str:
    return table.headings[index].text or str(index + 1)


def _named(table: Table, stated: str, role: Role) -> int:
    """Return the column that an option names, by its heading or its number from 1."""
    names = [heading.text.casefold() for heading in table.headings]
    stated = stated.strip()
    if names.count(stated.casefold()) == 1:
        index = names.index(stated.casefold())
    elif stated.isascii() and stated.isdigit() and 1 <= int(stated) <= len(names):
        index = int(stated) - 1
    else:
        raise InputError(
            f"--{role}-column {stated!r}: no such column; expected one of {_listed(table)}"
        )
    if table.columns[index] is None and not (role == "time" and index in table.clocks):
        raise InputError(f"--{role}-column {stated!r}: expected a column of numbers")
    return index


def _listed(table: Table) -> str:
    return ", ".join(_label(table, k) for k in range(len(table.headings)))


def _found(table: Table, role: Role, taken: tuple[int, ...], answers: Answers) -> int:
    """Return the one column whose heading says that it is this channel, or ask."""
    numeric = [k for k, column in enumerate(table.columns) if column is not None]
    kinds = (numeric, list(table.clocks)) if role == "time" else (numeric,)

    def having(said: Role | None) -> list[int]:
        """Return columns of this role: numbers, or where none are a clock's."""
        found = ([k for k in kind if table.headings[k].role == said] for kind in kinds)
        return next((left for some in found if (left := [k for k in some if k not in taken])), [])

    fitting = having(role)
    if role == "pressure" and not fitting:
        fitting = [k for k in _symbols(table) if k not in taken]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        left, open_question = (
            fitting,
            f"line {table.header_line}: several columns may be the {role}",
        )
    else:
        left = having(None)
        if len(left) == 1 and left[0] in table.clocks:
            return left[0]
        open_question = f"line {table.header_line}: nothing says which column is the {role}"
    for k, heading in enumerate(table.headings):
        if not fitting and heading.role == role and table.columns[k] is None:
            raise InputError(
                f"line {table.lines[0]}: the {role} (column {heading.text!r}) is not a "
                f"number in most rows; expected numbers{', or hh:mm:ss' * (role == 'time')}"
            )
    if not left:
        hint = "; or give the pressure program with --program" if role == "pressure" else ""
        raise InputError(
            f"line {table.header_line}: no column of the {role}; found {_listed(table)}, "
            f"expected a heading such as {_EXAMPLES[role]!r}{hint}"
        )
    labels = [_label(table, k) for k in left]
    if len(set(labels)) < len(labels):  # columns of one name: by number
        labels = [str(k + 1) for k in left]
    answer = answers.choose(Question(f"{role}-column", open_question, tuple(labels)))
    return left[labels.index(answer)] if answer in labels else _named(table, answer, role)


def _channel(table: Table, role: Role, index: int, answers: Answers) -> Channel:
    heading, values = table.headings[index], table.columns[index]
    if values is None:
        seconds = clock_s(table.clocks[index], table.lines)
        return Channel(seconds, _label(table, index), "hh:mm:ss")
    row = table.thousands.get(index)
    if row is not None and answers.stated("decimal") is None:
        sign = {".": "point", ",": "comma"}[table.decimal]
        raise InputError(
            f"line {table.lines[row]}: the {role} (column {_label(table, index)!r}) has a {sign} "
            "in it, and all below 1000 are whole numbers: it seems to separate thousands; expected "
            f"numbers without such separators, or --decimal {sign} if it is the decimal sign"
        )
    stated = answers.stated(f"{role}-unit")
    unit = heading.unit if heading.unit is not None and heading.unit.role == role else None
    if stated is not None:
        unit = _unit(stated, role)
    elif unit is None:
        unit = _unit(
            answers.choose(
                Question(
                    f"{role}-unit",
                    f"line {table.header_line}: the unit of the {role} (column "
                    f"{_label(table, index)!r}) is not known",
                    units_of(role),
                )
            ),
            role,
        )
    return Channel(values * unit.times / unit.over, _label(table, index), unit.name)


def _unit(text: str, role: Role) -> Unit:
    unit = find_unit(text)
    if unit is None or unit.role != role:
        raise InputError(f"{text!r} is not a unit of {role}; expected {', '.join(units_of(role))}")
    return unit
