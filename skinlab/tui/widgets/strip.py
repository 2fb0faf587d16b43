"""The plot below the plot: both channels against time while a curve runs, then the residual."""

from __future__ import annotations

from typing import ClassVar

from rich.style import Style

from skinlab.tui.canvas import runs
from skinlab.tui.plot_data import Drawing, against_time, residual
from skinlab.tui.shown import Entry, Live
from skinlab.tui.ui_state import Board
from skinlab.tui.widgets.rows import BoardRows

_LEFT = 7  # as the plot above


class Strip(BoardRows):
    """A caption and a few rows of dots."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {"strip--main", "strip--second", "strip--band"}

    def __init__(self) -> None:
        super().__init__("strip")

    def show(self, board: Board) -> None:
        """Draw what the board shows, only where that changed."""
        super().show(board)
        shown = board.live or board.entry
        n = len(shown.curve) if isinstance(shown, Live) else 0
        done = isinstance(shown, Entry) and shown.result is not None
        key = (board.session, type(shown), shown and shown.index, n, done, self.size)
        if key == self._drawn:
            return
        self._drawn = key
        columns, rows = self.size.width - _LEFT - 1, self.size.height - 1
        drawing = _drawing(shown, columns, rows)
        self.set_rows([] if drawing is None else self._styled(drawing))

    def _styled(self, drawing: Drawing) -> list[list[tuple[str, Style]]]:
        plain = Style.null()
        rows = [[(" " + drawing.caption, plain)]]
        styles = [
            self.get_component_rich_style(f"strip--{layer}") for layer in ("main", "second", "band")
        ]
        for number, row in enumerate(runs((drawing.main, drawing.second, drawing.band))):
            label = (drawing.label(number).rjust(_LEFT - 1) + " ", plain)
            rows.append([label, *((cells, styles[layer]) for cells, layer in row)])
        return rows


def _drawing(shown: Live | Entry | None, columns: int, rows: int) -> Drawing | None:
    if columns < 1 or rows < 1:
        return None
    if isinstance(shown, Live):
        return against_time(shown, columns, rows)
    return None if shown is None else residual(shown, columns, rows)
