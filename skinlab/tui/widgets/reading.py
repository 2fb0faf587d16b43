"""What the probe reads right now: in one line, or in large digits where there is room."""

from __future__ import annotations

import re

from textual import events
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.message import Message
from textual.widgets import Digits, Label, Static

from skinlab.tui.text import (
    TIMELINE,
    deflection_text,
    pressure_text,
    state_text,
)
from skinlab.tui.ui_state import Board


class Reading(Vertical):
    """Pressure, deflection and progress; the time line of a replay can be clicked."""

    class Pointed(Message):
        """A place on the time line was clicked, at this share of it."""

        def __init__(self, share: float) -> None:
            super().__init__()
            self.share = share

    _playing = False

    def on_click(self, event: events.Click) -> None:
        """Say where on the time line that was."""
        line = event.widget
        at = event.get_content_offset(line) if isinstance(line, Static) else None
        if not self._playing or at is None or not isinstance(line, Static):
            return
        bar = re.search(TIMELINE, str(line.content))
        if bar is not None and bar.start() <= at.x < bar.end():
            event.stop()
            self.post_message(self.Pointed((at.x - bar.start() + 0.5) / len(bar[0])))

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
        self._playing = board.playing is not None
        # Numbers only while they are those of now; else what was last, and when
        now = board.latest if board.streaming else None
        pressure, deflection = pressure_text(now), deflection_text(now)
        progress = state_text(board)
        # Of one width, so that no frame moves the layout
        self.query_one("#pressure-large", Digits).update(f"{pressure:>6}")
        self.query_one("#deflection-large", Digits).update(f"{deflection:>6}")
        self.query_one("#progress-large", Static).update(progress, layout=False)
        values = f"{pressure:>6} mbar  {deflection:>6} mm  " if board.streaming else ""
        self.query_one("#reading-line", Static).update(values + progress, layout=False)
