"""Intervals of the visit's curves side by side, where the terminal is wide enough."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from textual.containers import VerticalScroll
from textual.widgets import Static

from skinlab.mechanics.names import unit_of
from skinlab.tui.shown import Entry
from skinlab.tui.ui_state import Board
from skinlab.tui.value_text import meaning, name_of, scaled_bar, value_columns, value_scale

if TYPE_CHECKING:
    from textual.app import ComposeResult

    from skinlab.studies.reference import Range

_INDEX = 4


class Intervals(VerticalScroll, can_focus=False):
    """For each parameter a scale, and under it a bar a curve."""

    def __init__(self) -> None:
        super().__init__(id="intervals")
        self._drawn: object = None

    def compose(self) -> ComposeResult:
        """Yield the text."""
        yield Static("", id="intervals-text", markup=False)

    def show(self, board: Board) -> None:
        """Draw where something changed; a curve that grows changes nothing."""
        if not self.size.width:
            return
        entries = [] if board.elsewhere else list(board.entries.values())
        excluded = tuple(board.ledger.excluded)
        key = (board.session, len(entries), excluded, board.shown, self.size, board.reference)
        done = tuple(e.result is not None for e in entries)
        if (key, done) == self._drawn:
            return
        self._drawn = (key, done)
        ranges = {} if board.entry is None else board.ranges(board.entry)
        kept = [e for e in entries if e.index not in excluded]
        lines = interval_lines(kept, self.size.width - 1, ranges, board.shown)
        self.query_one("#intervals-text", Static).update("\n".join(lines))


def interval_lines(
    entries: Sequence[Entry], columns: int, ranges: dict[str, Range], shown: int | None
) -> list[str]:
    """Return the bars of all curves, on one scale for each parameter; the shown one is marked."""
    lines = []
    for name in value_columns(entries):
        values = {
            e.index: v
            for e in entries
            if e.result is not None
            and (v := (e.result.parameters or {}).get(name)) is not None
            and v.low is not None
            and v.high is not None
        }
        if not values:
            continue
        usual = ranges.get(name)
        behind = None if usual is None else usual.span
        numbers = [x for v in values.values() for x in (v.low, v.high) if x is not None]
        low, high, logarithmic = value_scale(name, [*numbers, *(behind or ())])
        width = columns - _INDEX
        unit = unit_of(name)
        lines.append(f"{name_of(name)}{unit and f' ({unit})'}  {meaning(name)}")
        ends = f"{low:g}", f"{high:g}"
        lines.append(f"{'':{_INDEX}}{ends[0]}{ends[1]:>{width - len(ends[0])}}")
        for index, value in values.items():
            bar = scaled_bar(value, low, high, width, behind, logarithmic=logarithmic)
            lines.append(f"{'►' if index == shown else ' '}{index:<{_INDEX - 1}}{bar}")
        lines.append("")
    if ranges:
        first = next(iter(ranges.values()))
        lines.append(f"░ usual: {first.words}")
    return lines or ["Intervals of the visit's curves come here."]
