"""The panel under the fields: the armed settings once more, or what was identified."""

from __future__ import annotations

from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.widgets import Static

from skinlab.tui.board import Board
from skinlab.tui.words import card_text


class Card(VerticalScroll, can_focus=False):
    """A title and a few lines."""

    _written = ("", "")

    def compose(self) -> ComposeResult:
        """Yield the text."""
        yield Static("", id="card-title", markup=False)
        yield Static("", id="card-text", markup=False)

    def show(self, board: Board) -> None:
        """Draw."""
        title, text = card_text(board)
        if (title, text) != self._written:
            self._written = (title, text)
            self.query_one("#card-title", Static).update(title)
            self.query_one("#card-text", Static).update(text)
        self.set_class(board.can_start, "-armed")
