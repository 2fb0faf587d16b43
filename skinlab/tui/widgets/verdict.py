"""The two lines that never scroll: whether the curve is good, and the one next step."""

from __future__ import annotations

import re

from textual import events
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.widgets import Static

from skinlab.report.verdict import Use
from skinlab.tui.card_text import VerdictText, verdict_text
from skinlab.tui.ui_state import Board

# A letter is a key where it begins a clause: "s, then j", "v vents", and no "2 s on"
_KEY = re.compile(r"\b(F[2-8])\b|(?:^|[;,(] ?)([dpsv])(?=,? [a-z])")
_SIGN = {Use.GOOD: "✔ ", Use.REPEAT: "↻ ", Use.NOT: "✘ "}  # not by colour alone


class VerdictLine(Vertical):
    """Good curve / Repeat: … / Do not use: …, and what to do next."""

    def __init__(self) -> None:
        super().__init__(id="verdict")
        self._drawn: VerdictText | None = None

    def compose(self) -> ComposeResult:
        """Yield both lines."""
        yield Static("", id="verdict-words", markup=False)
        yield Static("", id="verdict-next", markup=False)

    def on_click(self, event: events.Click) -> None:
        """Do what the line of the next step says first; never what starts suction."""
        event.stop()
        text = "" if self._drawn is None else self._drawn.following
        found = _KEY.search(text)
        if found is not None and event.widget is self.query_one("#verdict-next"):
            self.app.simulate_key((found[1] or found[2]).lower())

    def show(self, board: Board) -> None:
        """Draw."""
        text = verdict_text(board)
        if text == self._drawn:
            return
        self._drawn = text
        wraps = self.screen.has_class("-narrow")  # there a reason may need two lines
        sign = "" if text.use is None else _SIGN[text.use]
        self.query_one("#verdict-words", Static).update(sign + text.words, layout=wraps)
        self.query_one("#verdict-next", Static).update(f"Next: {text.following}", layout=wraps)
        self.set_classes("" if text.use is None else f"-{text.use}")
