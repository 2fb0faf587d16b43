"""One table or figure: its numbers, its picture, its words."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cell = str | int | float | None


@dataclass(frozen=True)
class Table:
    """Named columns, which carry their unit, and rows."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def csv(self) -> str:
        """Return the table as CSV; numbers with nine digits, nothing where there is none."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([[_cell(value, 9) for value in row] for row in self.rows])
        return stream.getvalue()

    def markdown(self) -> str:
        """Return the table for a page; numbers with four digits."""
        lines = ["| " + " | ".join(self.columns) + " |", "|" + "---|" * len(self.columns)]
        lines += ["| " + " | ".join(_cell(v, 4) or "–" for v in row) + " |" for row in self.rows]
        return "\n".join(lines)


def _cell(value: Cell, digits: int) -> str:
    if value is None:
        return ""
    if isinstance(value, float | np.floating):
        return f"{value:.{digits}g}" if np.isfinite(value) else ""
    return str(value)


@dataclass(frozen=True)
class Comparison:
    """A statement of the paper beside ours."""

    what: str
    paper: str
    ours: str
    agrees: bool | None  # None: it cannot be tested here
    why: str = ""  # where they differ, agree for another reason than they seem to, or say nothing

    @property
    def verdict(self) -> str:
        """In words."""
        if self.agrees is None:
            return "cannot be tested here"
        return "yes" if self.agrees else "no"


@dataclass(frozen=True)
class Part:
    """One table or figure of the paper."""

    name: str  # of its files: figure_7
    title: str
    table: Table
    comparisons: tuple[Comparison, ...] = ()
    text: str = ""  # what a reader must know to read it
    shown: Table | None = None  # what the page shows of the table
    draw: Callable[[Figure], None] | None = None
    size: tuple[float, float] = (7.0, 4.5)  # inches
