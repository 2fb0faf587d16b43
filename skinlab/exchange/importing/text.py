"""Text to a table: the separator and the decimal sign are found by trying them."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence

from skinlab.errors import InputError
from skinlab.exchange.importing.questions import Answers, Question
from skinlab.exchange.importing.table import Draft, Line, Table, finish, survey

# In the order in which they are believed where two would do: a comma may be a decimal sign.
SEPARATORS = {"tab": "\t", "semicolon": ";", "comma": ",", "space": " "}
DECIMALS = {"point": ".", "comma": ","}

_LONGEST_LINE = 10_000
_SAMPLE_LINES = 2_000
_CELL_LINES = 12  # over which the headings of a table may go
_DIGITS = re.compile(r"[0-9]+")
_HALF_DAY = re.compile(r"(?<=[0-9]) +(?=[AP]M\b)", re.IGNORECASE)  # of a time: 1:02:03 PM


def table_from_text(text: str, answers: Answers) -> tuple[Table, str]:
    """Return the table in the text, and what was understood of its form.

    Raises:
        InputError: there is none, a row in it is damaged, or its form is ambiguous.
    """
    raw = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    for number, line in enumerate(raw, start=1):
        if len(line) > _LONGEST_LINE:
            raise InputError(f"line {number}: {len(line)} characters; expected rows of a table")
    raw = _whole_cells(raw)
    separator, decimal = answers.stated("separator"), answers.stated("decimal")
    separators = [separator] if separator else list(SEPARATORS)
    signs = [decimal] if decimal else list(DECIMALS)
    if len(raw) > _SAMPLE_LINES:  # the beginning of a long file tells the separator
        begun = _best(raw[:_SAMPLE_LINES], separators, signs)
        separators = separators if begun is None else [begun[2]]
    best = _best(raw, separators, signs)
    if best is None:
        raise InputError(
            "no table found; expected rows of at least two numbers, separated by tabs, "
            "semicolons, commas or spaces"
        )
    draft, lines, name = best
    if _pairs(draft, name):
        return _paired(draft, lines, answers), "separator comma, decimal comma"
    sign = "comma" if draft.decimal == "," else "point"
    return finish(lines, draft), f"separator {name}, decimal {sign}"


def _whole_cells(raw: list[str]) -> list[str]:
    """Return the lines, where a quoted cell goes over several, with all of it in the first one."""
    lines = list(raw)
    for k, line in enumerate(lines):
        if line.count('"') % 2 == 0:
            continue
        for end in range(k + 1, min(k + 1 + _CELL_LINES, len(lines))):
            if lines[end].count('"') % 2:
                lines[k : end + 1] = [" ".join(lines[k : end + 1]), *[""] * (end - k)]
                break
    return lines


def _best(
    raw: Sequence[str], separators: Sequence[str], signs: Sequence[str]
) -> tuple[Draft, list[Line], str] | None:
    """Return the form that explains most, the lines cut by it, and its separator."""
    best: tuple[Draft, list[Line], str] | None = None
    for name in separators:
        lines = _cut(raw, name)
        for sign in signs:
            draft = survey(lines, DECIMALS[sign])
            if draft is not None and (best is None or draft.score > best[0].score):
                best = draft, lines, name
    return best


def _cut(raw: Sequence[str], separator: str) -> list[Line]:
    """Return the lines that hold something, cut into cells."""
    lines = []
    for number, text in enumerate(raw, start=1):
        loose: list[str] = []
        if separator == "space":
            # "Time (s)" is one name; where names have spaces, two of them may separate
            bare = text.lstrip(" \t#%")
            cells = _HALF_DAY.sub("", re.sub(r"\s+(?=[(\[])", "", bare)).split()
            loose = re.split(r"\s{2,}|\t", bare.strip())
        else:
            try:
                cells = next(
                    csv.reader([text], delimiter=SEPARATORS[separator], skipinitialspace=True), []
                )
            except csv.Error as error:
                raise InputError(f"line {number}: {error}; expected rows of a table") from None
        while cells and not cells[-1].strip():
            cells.pop()
        if cells:
            lines.append(Line(number, tuple(cells), tuple(loose)))
    return lines


# ---- comma as separator and as decimal sign, without quotes --------------------------------------


def _pairs(draft: Draft, separator: str) -> bool:
    """Whether every value may be two fields: twice as many as the header has names."""
    return separator == "comma" and draft.roles > 0 and draft.width == 2 * len(draft.header)


def _paired(draft: Draft, lines: Sequence[Line], answers: Answers) -> Table:
    begin, _ = draft.runs[draft.chosen]
    if answers.stated("decimal") != "comma":
        answers.choose(
            Question(
                "decimal",
                f"line {lines[begin].number}: twice as many fields as the header has names; "
                "the comma seems to be the separator and the decimal sign too",
                ("comma",),
            )
        )
    joined = [_join(line, draft.width) for line in lines]
    again = survey(joined, ",")
    if again is None:
        raise InputError(
            f"line {lines[begin].number}: commas separate the fields and the decimals, and they "
            "cannot be told apart; expected quoted values or another separator"
        )
    return finish(joined, again)


def _join(line: Line, width: int) -> Line:
    cells = [str(cell).strip() for cell in line.cells]
    if len(cells) != width or not all(_DIGITS.fullmatch(cell) for cell in cells[1::2]):
        return line
    return Line(
        line.number, tuple(f"{a},{b}" for a, b in zip(cells[::2], cells[1::2], strict=True))
    )
