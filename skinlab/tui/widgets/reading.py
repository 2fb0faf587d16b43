"""What the probe reads right now: in one line, or in large digits where there is room."""

from __future__ import annotations

from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.widgets import Digits, Label, Static

from skinlab.tui.text import (
    deflection_text,
    last_text,
    link_text,
    pressure_text,
    progress_text,
)
from skinlab.tui.ui_state import Board


class Reading(Vertical):
    """Pressure, deflection and progress."""

    def compose(self) -> ComposeResult:
        """Yield both forms; the style sheet shows one."""
        with Horizontal(id="reading-large"):
            yield Digits("", id="pressure-large")
            yield Label("mbar")
            yield Digits("", id="deflection-large")
            yield Label("mm")
            yield Static("", id="progress-large", markup=False)
        yield Static("", id="reading-line", markup=False)

    def show(self, board: Board) -> None:
        """Draw."""
        # Numbers only while they are those of now; else what was last, and when
        now = board.latest if board.streaming else None
        pressure, deflection = pressure_text(now), deflection_text(now)
        texts = (last_text(board), progress_text(board), link_text(board))
        progress = "  ".join(text for text in texts if text)
        # Of one width, so that no frame moves the layout
        self.query_one("#pressure-large", Digits).update(f"{pressure:>6}")
        self.query_one("#deflection-large", Digits).update(f"{deflection:>6}")
        self.query_one("#progress-large", Static).update(progress, layout=False)
        values = f"{pressure:>6} mbar  {deflection:>6} mm  " if board.streaming else ""
        self.query_one("#reading-line", Static).update(values + progress, layout=False)
