"""The line at the bottom of every screen: what was said last, for as long as it is of use."""

from __future__ import annotations

from textual import events
from textual.widgets import Static

from skinlab.tui.ui_state import Board, Level

_FRAMES_PER_S = 10


class Note(Static):
    """The board's message; it draws itself. A click shows all messages.

    `later`: only what is said from now on, where something else is in view.
    """

    def __init__(self, board: Board, *, later: bool = False) -> None:
        super().__init__("", id="note", markup=False)
        self._board = board
        self._later = later
        self._old = board.note if later else ""
        self.display = not later
        self._drawn: tuple[str, Level] = ("", Level.INFO)

    def on_mount(self) -> None:
        """Begin to draw."""
        self.draw()
        self.set_interval(1 / _FRAMES_PER_S, self.draw)

    def on_click(self, event: events.Click) -> None:
        """Show all messages, where they can be shown."""
        event.stop()
        self.app.simulate_key("w")

    def draw(self) -> None:
        """Draw where it changed."""
        board = self._board
        text, level = (board.aside, Level.INFO) if board.aside else (board.note, board.level)
        if text == self._old:
            text = ""
        else:
            self._old = ""
        if (text, level) != self._drawn:
            self._drawn = (text, level)
            self.display = bool(text) or not self._later  # on a whole screen its row stays
            self.set_classes(f"-{level}")
            self.update(text)
