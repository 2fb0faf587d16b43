"""The top of every screen: what goes on, whether there is suction, whose visit, and SIMULATED."""

from __future__ import annotations

from textual import events
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.widgets import Static

from skinlab.tui.text import banner_text, suction_text, where_text
from skinlab.tui.ui_state import Board

_CLASSES = {"ARMED": "-armed", "RUNNING": "-running", "FAULT": "-fault", "NO PROBE": "-fault"}
_FRAMES_PER_S = 10
_USUAL_COLUMNS = 46  # before the first layout


class Top(Vertical):
    """State, suction with its key, whose visit, probe, and the SIMULATED banner.

    It draws itself: whichever screen it is on, it says what is.
    """

    def __init__(self, board: Board) -> None:
        super().__init__(classes="top")
        self._board = board
        self._seen = (-1, 0)  # version of the board, and how wide it was drawn
        self._drawn: tuple[str, ...] = ()

    def compose(self) -> ComposeResult:
        """Yield the parts."""
        with Horizontal(id="headline"):
            yield Static("", id="phase", markup=False)
            yield Static("", id="suction", markup=False)
            yield Static("", id="where", markup=False)
        yield Static("", id="banner", markup=False)

    def on_click(self, event: events.Click) -> None:
        """Vent where the line says that something vents."""
        vents = self._board.suction and not self._board.read_only
        if event.widget is self.query_one("#suction") and vents:
            event.stop()
            self.app.simulate_key("escape")

    def on_mount(self) -> None:
        """Begin to draw."""
        self.draw()
        self.set_interval(1 / _FRAMES_PER_S, self.draw)

    def draw(self) -> None:
        """Draw where something changed."""
        board = self._board
        columns = self.query_one("#where", Static).content_size.width if self.is_mounted else 0
        if (board.version, columns) == self._seen or not self.is_mounted:
            return
        self._seen = (board.version, columns)
        where = where_text(board, columns or _USUAL_COLUMNS)
        drawn = (board.phase, suction_text(board), where, banner_text(board))
        if drawn == self._drawn:
            return
        self._drawn = drawn
        phase, suction, where, banner = drawn
        self.query_one("#phase", Static).update(phase, layout=False)
        self.query_one("#phase").set_classes(_CLASSES.get(phase, ""))
        self.query_one("#suction", Static).update(suction, layout=False)
        self.query_one("#suction").set_class(board.suction, "-on")
        self.query_one("#suction").set_class(board.suction and board.read_only, "-by-hand")
        self.query_one("#where", Static).update(where, layout=False)
        line = self.query_one("#banner", Static)
        line.display = bool(banner)
        line.update(banner, layout=False)
