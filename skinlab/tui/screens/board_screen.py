"""What the screens beside the main one have in common."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.widget import Widget

from skinlab.tui.screens.closing import ClosingScreen
from skinlab.tui.ui_state import Board
from skinlab.tui.widgets.header import Top
from skinlab.tui.widgets.keys import Keys
from skinlab.tui.widgets.note import Note

_FRAMES_PER_S = 8


class BoardScreen(ClosingScreen[None]):
    """Shows the board between the top and the keys; page keys scroll its text.

    `SAYS` selects what they scroll.
    """

    SAYS: ClassVar[str]
    AUTO_FOCUS = ""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("v", "app.vent_probe", "Vent", priority=True, id="vent"),
        # Of the curve, where Del gives a search up
        Binding("v", "app.give_up_probe", "Give curve up", priority=True, id="vent"),
        Binding("pageup", "page(-1)", show=False, priority=True),
        Binding("pagedown", "page(1)", show=False, priority=True),
    ]

    def __init__(self, board: Board) -> None:
        super().__init__()
        self._board = board
        self._drawn: object = None

    def compose(self) -> ComposeResult:
        """Yield the parts, from top to bottom."""
        yield Top(self._board)
        yield from self.parts()
        yield Note(self._board)
        yield Keys()

    @abstractmethod
    def parts(self) -> Iterable[Widget]:
        """Yield what stands between the top and the message."""

    @abstractmethod
    def show(self) -> None:
        """Draw."""

    def drawn_from(self) -> object:
        """Return what decides whether something else is to be drawn."""
        return self._board.version

    def on_mount(self) -> None:
        """Begin to draw."""
        self.draw()
        self.set_interval(1 / _FRAMES_PER_S, self.draw)

    def draw(self) -> None:
        """Draw where something changed; nothing once the screen is being taken down."""
        if not self.display:
            return
        drawn = self.drawn_from()
        if drawn != self._drawn:
            self._drawn = drawn
            self.show()

    def action_page(self, by: int) -> None:
        """Show more."""
        says = self.query_one(self.SAYS)
        if not says.max_scroll_y:
            self._board.tell("there is no more than this")
        says.scroll_relative(y=by * max(says.size.height - 1, 1), animate=False, immediate=True)

    def action_back(self) -> None:
        """Go back."""
        self.dismiss()
