"""The panel under the fields: the armed settings once more, or what was identified."""

from __future__ import annotations

from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.widgets import Static

from skinlab.tui.text import CardText, card_text
from skinlab.tui.ui_state import Board

_USUAL_COLUMNS = 33  # before the first layout


class Card(VerticalScroll, can_focus=False):
    """A title and some lines; grey while they may still change."""

    _written: CardText | None = None

    def compose(self) -> ComposeResult:
        """Yield the text."""
        yield Static("", id="card-title", markup=False)
        yield Static("", id="card-text", markup=False)

    def show(self, board: Board) -> None:
        """Draw."""
        columns = self.query_one("#card-text").size.width or _USUAL_COLUMNS
        text = card_text(board, columns)
        if text != self._written:
            # The layout of the whole screen takes longer than a frame may
            same = self._written is not None and _shape(text, columns) == _shape(
                self._written, columns
            )
            self._written = text
            self.query_one("#card-title", Static).update(text.title, layout=False)
            self.query_one("#card-text", Static).update("\n".join(text.lines), layout=not same)
        self.set_class(board.review is not None or board.can_start, "-armed")
        self.set_class(not text.final, "-forming")

    def shows_whole(self, board: Board) -> bool:
        """Whether what is on the screen is what the board says, to the last line."""
        columns = self.query_one("#card-text").size.width or _USUAL_COLUMNS
        if card_text(board, columns) != self._written or not self.size.height:
            return False
        rows = self.virtual_size.height <= self.size.height
        return rows and self.screen.region.contains_region(self.region)


def _shape(text: CardText, columns: int) -> list[str]:
    """Return what decides where lines are broken: which there are, and the text of long ones."""
    return [line if len(line) > columns else "" for line in text.lines]
