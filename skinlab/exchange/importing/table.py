"""Find the table of numbers among the lines of an export: header lines, names, units, rows."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from skinlab.errors import InputError
from skinlab.exchange.importing.clock import is_clock
from skinlab.exchange.importing.headings import Heading, is_summary, is_unit, read_heading
from skinlab.exchange.importing.units import find_unit
from skinlab.text import counted

Cell = str | float  # a float comes from a spreadsheet

_NUMBERS = {
    ".": re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?"),
    ",": re.compile(r"[+-]?([0-9]+(,[0-9]+)?|,[0-9]+)([eE][+-]?[0-9]+)?"),
}
# In hundreds and, without a zero before them, in exact thousandths: 950 and 1.050
_HUNDREDS = re.compile(r"[+-]?[0-9]{1,3}")
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2}[.,][0-9]{3}")
# A word of a remark: a unit behind a number may be one letter. Or a date that stands alone
_WORD = re.compile(r"[^\W\d_]{2,}")
_DATE = re.compile(r"[0-9]{1,4}([-./])[0-9]{1,2}\1[0-9]{1,4}")
_GOES_ON = 0.1  # of what a column went through: no next row is further on
_SEPARATED = re.compile(r"[+-]?[0-9]{1,3}([.,'’\s][0-9]{3})+([.,][0-9]+)?")  # thousands: 1.000,0
_Kind = Literal["number", "clock"]
_FEWEST_ROWS = 2
_FEWEST_COLUMNS = 2


@dataclass(frozen=True)
class Line:
    """One line (or row of a sheet), cut into cells; `loose` is another way to cut it."""

    number: int  # in the file, from 1
    cells: tuple[Cell, ...]
    loose: tuple[Cell, ...] = ()


@dataclass(frozen=True, eq=False)
class Table:
    """The table: headings (n,), columns (n,) of values (rows,), None where one is not numeric.

    `clocks` are the cells (rows,) of columns that begin with a time of a clock, by index, and
    `constants` those of columns that tell of a whole curve. `thousands` are rows by column, where
    what was taken for the decimal sign may separate thousands.
    """

    headings: tuple[Heading, ...]
    columns: tuple[NDArray[np.float64] | None, ...]
    clocks: Mapping[int, tuple[str, ...]]
    constants: Mapping[int, tuple[Cell, ...]]
    thousands: Mapping[int, int]
    decimal: str
    lines: tuple[int, ...]  # (rows,) number of each row's line
    header_line: int  # that of the headings; of the first row where there are none
    before: int  # lines before the table that were not used
    after: int  # and after it


@dataclass(frozen=True, eq=False)
class Draft:
    """One way to read the lines, and how much speaks for it."""

    decimal: str
    width: int
    core: tuple[tuple[int, _Kind], ...]  # columns that are numbers; few, and those of a clock
    runs: tuple[tuple[int, int], ...]  # of rows that fit, as indices of lines
    chosen: int  # which run is the table
    header: tuple[Cell, ...]
    units: tuple[Cell, ...]
    used: int  # lines that the header takes
    roles: int  # channels that the header names
    second: int | None  # line of a second table

    @property
    def score(self) -> tuple[int, int, float]:
        """The more, the better: channels named, rows, share of the cells that are numbers."""
        rows = sum(end - begin for begin, end in self.runs)
        numbers = sum(kind == "number" for _, kind in self.core)
        return self.roles, rows, numbers / self.width


def number(cell: Cell, decimal: str) -> float | None:
    """Return the finite number in a cell, or None."""
    if isinstance(cell, float):
        return cell if math.isfinite(cell) else None
    text = cell.strip().replace("\u2212", "-")
    if not _NUMBERS[decimal].fullmatch(text):
        return None
    value = float(text.replace(",", "."))
    return value if math.isfinite(value) else None


def _kind(cell: Cell, decimal: str) -> _Kind | None:
    if number(cell, decimal) is not None:
        return "number"
    return "clock" if is_clock(cell) else None


def _core(kinds: Sequence[_Kind | None]) -> tuple[tuple[int, _Kind], ...]:
    """Return the columns that make a line a row: a clock counts beside one number alone."""
    numbers: list[tuple[int, _Kind]] = [(k, "number") for k, v in enumerate(kinds) if v == "number"]
    if len(numbers) != 1:
        return tuple(numbers)
    return tuple((k, kind) for k, kind in enumerate(kinds) if kind is not None)


def survey(lines: Sequence[Line], decimal: str) -> Draft | None:
    """Look for a table among lines (none of them empty); None where there is none."""
    kinds = [[_kind(cell, decimal) for cell in line.cells] for line in lines]
    cores = [_core(line) for line in kinds]
    patterns = Counter(
        (len(line), core)
        for line, core in zip(kinds, cores, strict=True)
        if len(core) >= _FEWEST_COLUMNS
    )
    if not patterns:
        return None
    (width, core), count = patterns.most_common(1)[0]
    if count < _FEWEST_ROWS:
        return None
    fits = [len(v) > core[-1][0] and all(v[k] == kind for k, kind in core) for v in kinds]
    rows = _without_summary(lines, fits, core, decimal)
    edges = np.flatnonzero(np.diff([0, *rows, 0]))
    runs = tuple((int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True))
    above = (lines[0 if k == 0 else runs[k - 1][1] : begin] for k, (begin, _) in enumerate(runs))
    heads = (_header(part, width) for part in above)
    first = next(heads)
    # The first table, and whether there is a second: a long file may have many runs
    all_named = ((k, h) for k, h in enumerate(chain([first], heads)) if h[3] >= _FEWEST_COLUMNS)
    named = list(islice(all_named, 2))
    chosen, (header, units, used, roles) = named[0] if named else (0, first)
    return Draft(
        decimal, width, core, runs, chosen, header, units, used, roles,
        second=lines[runs[named[1][0]][0]].number if len(named) > 1 else None,
    )  # fmt: skip


def _without_summary(
    lines: Sequence[Line], fits: Sequence[bool], core: Sequence[tuple[int, _Kind]], decimal: str
) -> list[bool]:
    """Return which lines are rows, less sums and means behind the last of these."""
    at = [k for k, fit in enumerate(fits) if fit]
    end = len(at)
    while end and (_is_summary(lines[at[end - 1]]) or _is_marked(lines[at[end - 1]], core)):
        end -= 1
    if not end:
        return list(fits)  # each row is a mean, of repeats
    rows, last = list(fits), lines[at[end - 1]]
    for k in at[end:]:
        # A sample that is marked, as the highest one, goes on where the rows ended.
        if _is_summary(lines[k]) or not _goes_on(lines[k], lines[at[0]], last, core, decimal):
            rows[k] = False
        else:
            last = lines[k]
    return rows


def _is_summary(line: Line) -> bool:
    """Whether a line begins with the name of a sum or a mean."""
    first = next((cell for cell in line.cells if str(cell).strip()), "")
    return isinstance(first, str) and is_summary(first)


def _is_marked(line: Line, core: Sequence[tuple[int, _Kind]]) -> bool:
    """Whether the name of a sum or a mean stands anywhere beside the numbers."""
    known = {k for k, _ in core}
    cells = (cell for k, cell in enumerate(line.cells) if k not in known)
    return any(isinstance(cell, str) and is_summary(cell) for cell in cells)


def _goes_on(
    line: Line, first: Line, last: Line, core: Sequence[tuple[int, _Kind]], decimal: str
) -> bool:
    """Whether the first number, mostly the time, is the next one behind that of the last row."""
    k, kind = core[0]
    if k >= len(line.cells):
        return False
    if kind == "clock":
        return _kind(line.cells[k], decimal) == "clock"
    here, begin, end = (number(row.cells[k], decimal) for row in (line, first, last))
    if here is None or begin is None or end is None:
        return False
    return 0.0 < (here - end) * (1.0 if end >= begin else -1.0) <= _GOES_ON * abs(end - begin)


def _header(
    above: Sequence[Line], width: int
) -> tuple[tuple[Cell, ...], tuple[Cell, ...], int, int]:
    """Return names, units, lines used and channels named, of the lines above a run of rows."""
    units: tuple[Cell, ...] = ()
    used = 0
    if len(above) > 1 and _all_units(above[-1].cells):
        units, above, used = above[-1].cells, above[:-1], 1
    if not above:
        return (), (), 0, 0
    candidates = [above[-1].cells]
    if above[-1].loose:  # cut at spaces: only the right number of names can be trusted
        candidates = [c for c in (above[-1].cells, above[-1].loose) if len(c) == width]
    for names in candidates:
        if len(names) < _FEWEST_COLUMNS:
            continue
        found = {heading.role for heading in _headings(names, units, len(names))} - {None}
        return names, units, used + 1, len(found)
    return (), (), 0, 0


def _all_units(cells: Sequence[Cell]) -> bool:
    texts = [str(cell) for cell in cells if str(cell).strip(" -[]()")]
    return len(texts) >= _FEWEST_COLUMNS and all(find_unit(text) for text in texts)


def _units_beside(names: Sequence[Cell], rows: Sequence[Line]) -> tuple[str, ...]:
    """Return the unit of each column behind which a column says one, the same in all rows."""
    units = [""] * len(names)
    for k in (k for k, name in enumerate(names) if k and is_unit(str(name))):
        cells = {str(row.cells[k]).strip() if k < len(row.cells) else "" for row in rows}
        if len(cells) == 1 and find_unit(unit := cells.pop()) is not None:
            units[k - 1] = unit
    return tuple(units)


def _headings(names: Sequence[Cell], units: Sequence[Cell], width: int) -> tuple[Heading, ...]:
    def at(cells: Sequence[Cell], k: int) -> str:
        return str(cells[k]) if k < len(cells) else ""

    return tuple(read_heading(at(names, k), at(units, k)) for k in range(width))


def finish(lines: Sequence[Line], draft: Draft) -> Table:
    """Return the table of a draft.

    Raises:
        InputError: a line between the rows is none, or there is a second table; names the line.
    """
    if draft.second is not None:
        raise InputError(
            f"line {draft.second}: a second table begins; expected one curve in a file"
        )
    begin, end = draft.runs[draft.chosen]
    headed = draft.roles > 0
    if headed and draft.width > len(draft.header):
        raise InputError(
            f"line {lines[begin].number}: {draft.width} fields under a header of "
            f"{len(draft.header)}; expected as many (is the decimal sign the separator too?)"
        )
    names = draft.header if headed or len(draft.header) == draft.width else ()
    width = max(draft.width, len(names))
    units = draft.units if names else ()
    headings = _headings(names, units or _units_beside(names, lines[begin:end]), width)
    for line in lines[begin:end]:
        if len(line.cells) > width:
            raise InputError(f"line {line.number}: {len(line.cells)} fields, expected {width}")
    ends = lines[begin], lines[end - 1]
    for line in lines[end:]:
        if draft.chosen + 1 < len(draft.runs) or _meant_as_row(line, ends, draft):
            raise InputError(f"line {line.number}: {_trouble(line, draft, headings)}")
    numbers = [k for k, kind in draft.core if kind == "number"]
    rows = [[number(line.cells[k], draft.decimal) for k in numbers] for line in lines[begin:end]]
    values = np.array(rows, dtype=float)
    columns: list[NDArray[np.float64] | None] = [None] * width
    for position, k in enumerate(numbers):
        columns[k] = values[:, position]
    cells = [line.cells + ("",) * (width - len(line.cells)) for line in lines[begin:end]]
    return Table(
        headings,
        tuple(columns),
        {
            k: tuple(str(row[k]) for row in cells)
            for k, cell in enumerate(cells[0])
            if is_clock(cell)
        },
        {
            k: tuple(row[k] for row in cells)
            for k, heading in enumerate(headings)
            if heading.constant is not None
        },
        {k: row for k in numbers if (row := _thousands([row[k] for row in cells])) is not None},
        draft.decimal,
        tuple(line.number for line in lines[begin:end]),
        header_line=lines[begin - draft.used if names else begin].number,
        before=begin - (draft.used if names else 0),
        after=len(lines) - end,
    )


def _thousands(cells: Sequence[Cell]) -> int | None:
    """Return the first row that may have a separator of thousands, as all others may; else None."""
    texts = [str(cell).strip() for cell in cells]
    if any(isinstance(cell, float) for cell in cells):
        return None
    whole = [_HUNDREDS.fullmatch(text) is not None for text in texts]
    if all(whole) or not any(whole):
        return None
    if not all(w or _THOUSANDS.fullmatch(text) for w, text in zip(whole, texts, strict=True)):
        return None
    return whole.index(False)


def _meant_as_row(line: Line, ends: tuple[Line, Line], draft: Draft) -> bool:
    """Whether a line behind the rows looks like a damaged row rather than a remark or a sum.

    `ends` are the first row and the last one.
    """
    goes_on = _goes_on(line, *ends, draft.core, draft.decimal)
    if _is_summary(line) or (not goes_on and _is_marked(line, draft.core)):
        return False
    numbers = sum(
        k < len(line.cells) and _kind(line.cells[k], draft.decimal) == kind
        for k, kind in draft.core
    )
    if len(line.cells) == draft.width and 2 * numbers >= len(draft.core):
        return True
    if goes_on:
        return True  # the last row of a record that was cut off, or without a reading
    texts = [str(cell).strip() for cell in line.cells]
    if any(_WORD.search(text) for text in texts) or (len(texts) == 1 and _DATE.fullmatch(texts[0])):
        return False  # as "2 curves excluded"
    return texts[0][:1] in set("0123456789-+.,")


def _trouble(line: Line, draft: Draft, headings: Sequence[Heading]) -> str:
    sign = {".": "a point", ",": "a comma"}[draft.decimal]
    for k, kind in draft.core:
        name = headings[k].text or f"column {k + 1}"
        if k >= len(line.cells):
            found = counted(len(line.cells), "field")
            return f"{found}, expected {draft.width}: {name} is missing"
        if _kind(line.cells[k], draft.decimal) != kind:
            shown = str(line.cells[k]).strip()[:40]
            expected = "a time" if kind == "clock" else f"a number (decimal sign: {sign})"
            if _SEPARATED.fullmatch(shown):
                expected += ", without separators of thousands"
            return f"{name} is {shown!r}, expected {expected}"
    return "numbers where the table had ended"
