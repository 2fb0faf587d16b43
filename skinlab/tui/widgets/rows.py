"""Rows of styled text of which only those are drawn again that changed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest

from rich.segment import Segment
from rich.style import Style
from rich.text import Text
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from skinlab.tui.ui_state import Board

Row = tuple[tuple[str, Style], ...]


class Rows(Widget):
    """A drawing in rows. A growing curve changes a few of them: the others are not rendered."""

    def __init__(self, identity: str) -> None:
        super().__init__(id=identity)
        self._rows: tuple[Row, ...] = ()

    def set_rows(self, rows: Sequence[Sequence[tuple[str, Style]]]) -> None:
        """Draw these, from the top."""
        new = tuple(tuple(row) for row in rows)
        both = zip_longest(self._rows, new)
        changed = [y for y, (before, after) in enumerate(both) if before != after]
        self._rows = new
        if changed:
            self.refresh(*(Region(0, y, self.size.width, 1) for y in changed))

    def render(self) -> Text:
        """Return all rows."""
        return Text("\n").join(Text.assemble(*row) for row in self._rows)

    def render_line(self, y: int) -> Strip:
        """Return one row."""
        columns, base = self.size.width, self.rich_style  # slow to find: once a line
        if y >= len(self._rows):
            return Strip.blank(columns, base)
        segments = [Segment(cells, base + style) for cells, style in self._rows[y]]
        return Strip(segments).adjust_cell_length(columns, base)


class BoardRows(Rows):
    """Rows that show what is on the board; `_drawn` is what they were drawn of."""

    def __init__(self, identity: str) -> None:
        super().__init__(identity)
        self._drawn: object = None
        self._board: Board | None = None

    def show(self, board: Board) -> None:
        """Draw what the board shows, only where that changed."""
        self._board = board

    def on_resize(self) -> None:
        """Draw again: what stands above or below has grown."""
        if self._board is not None:
            self.show(self._board)

    def notify_style_update(self) -> None:
        """Draw again in the colours of another theme, with what is drawn next."""
        super().notify_style_update()
        self._drawn = None
