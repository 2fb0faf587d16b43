"""What the probe reads right now: in one line, or in large digits where there is room."""

from __future__ import annotations

from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.widgets import Digits, Label, Static

from skinlab.tui.text import deflection_text, link_text, pressure_text, progress_text
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
        pressure, deflection = pressure_text(board.latest), deflection_text(board.latest)
        progress = f"{progress_text(board)}  {link_text(board)}".strip()
        # Of one width, so that no frame moves the layout
        self.query_one("#pressure-large", Digits).update(f"{pressure:>6}")
        self.query_one("#deflection-large", Digits).update(f"{deflection:>6}")
        self.query_one("#progress-large", Static).update(progress, layout=False)
        self.query_one("#reading-line", Static).update(
            f"{pressure:>6} mbar  {deflection:>6} mm  {progress}", layout=False
        )
