"""A sheet of an .xlsx workbook to a table."""

from __future__ import annotations

import io
import warnings
from itertools import islice

from skinlab.errors import InputError
from skinlab.exchange.importing.questions import Answers, Question
from skinlab.exchange.importing.table import Cell, Draft, Line, Table, finish, survey
from skinlab.text import needs

_MOST_ROWS = 1_000_000
_MOST_COLUMNS = 200
_MOST_EMPTY = 10_000  # in a row: what stands behind them, at the end of the sheet perhaps, is none


def table_from_workbook(data: bytes, answers: Answers) -> tuple[Table, str]:
    """Return the table of the one sheet that has one, and what was understood.

    Raises:
        InputError: the workbook cannot be read, holds no table, or several sheets do.
    """
    sheets = _sheets(data)
    stated = answers.stated("sheet")
    if stated is not None:
        if stated not in sheets:
            raise InputError(f"--sheet {stated!r}: expected one of {', '.join(sheets)}")
        sheets = {stated: sheets[stated]}
    found: dict[str, tuple[Draft, list[Line]]] = {}
    for name, lines in sheets.items():
        drafts = [draft for sign in ".," if (draft := survey(lines, sign)) is not None]
        if drafts:
            found[name] = max(drafts, key=lambda draft: draft.score), lines
    if not found:
        raise InputError("no table in any sheet; expected rows of at least two numbers")
    name = next(iter(found))
    if len(found) > 1:
        question = Question("sheet", "several sheets hold a table", tuple(found))
        name = answers.choose(question)
    draft, lines = found[name]
    return finish(lines, draft), f"sheet {name!r}"


def _sheets(data: bytes) -> dict[str, list[Line]]:
    try:
        import openpyxl
    except ImportError:
        raise InputError(needs(".xlsx needs", "openpyxl", "excel")) from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of styles and extensions: they do not concern us
            book = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True)
            return {sheet.title: _lines(sheet) for sheet in book.worksheets}
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 -- a damaged workbook fails in too many ways to name
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        raise InputError(f"not a workbook that can be read ({reason})") from None


def _lines(sheet: object) -> list[Line]:
    # A sheet may state dimensions that are wrong; then only reading tells.
    sheet.reset_dimensions()  # type: ignore[attr-defined]
    rows = sheet.iter_rows(max_col=_MOST_COLUMNS, values_only=True)  # type: ignore[attr-defined]
    lines = []
    for number, row in enumerate(islice(rows, _MOST_ROWS + 1), start=1):
        if number > _MOST_ROWS:
            raise InputError(f"more than {_MOST_ROWS} rows; expected one curve")
        cells = [_cell(value) for value in row]
        while cells and cells[-1] == "":
            cells.pop()
        if cells:
            lines.append(Line(number, tuple(cells)))
        elif number - (lines[-1].number if lines else 0) > _MOST_EMPTY:
            break
    return lines


def _cell(value: object) -> Cell:
    if value is None:
        return ""
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            return str(value)
    return str(value).strip()
