"""The top of the screen: what goes on, with which probe, and whether it is simulated."""

from __future__ import annotations

from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.widgets import Static

from skinlab.tui.text import banner_text, where_text
from skinlab.tui.ui_state import Board

_CLASSES = {"ARMED": "-armed", "RUNNING": "-running", "FAULT": "-fault", "NO PROBE": "-fault"}


class Top(Vertical):
    """Phase, probe, and the SIMULATED banner."""

    def compose(self) -> ComposeResult:
        """Yield the parts."""
        with Horizontal(id="headline"):
            yield Static("", id="phase", markup=False)
            yield Static("", id="where", markup=False)
            yield Static("skinlab", id="brand", markup=False)
        yield Static("", id="banner", markup=False)

    def show(self, board: Board) -> None:
        """Draw."""
        phase = self.query_one("#phase", Static)
        phase.update(board.phase, layout=False)
        phase.set_classes(_CLASSES.get(board.phase, ""))
        self.query_one("#where", Static).update(where_text(board), layout=False)
        banner = self.query_one("#banner", Static)
        text = banner_text(board.hello)
        banner.display = bool(text)
        banner.update(text, layout=False)
