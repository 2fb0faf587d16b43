"""One line to be typed: a time to go to."""

from __future__ import annotations

import re
from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.widgets import Input, Static

from skinlab.tui.screens.over import OverScreen
from skinlab.tui.ui_state import Board
from skinlab.tui.widgets.field import Field
from skinlab.tui.widgets.hints import Hints


def seconds(text: str) -> float | None:
    """Return a time in s, typed as 12.5, 12,5 or 1:30; None: it is none."""
    found = re.fullmatch(r"(?:([0-9]{1,4}):)?([0-9]{1,6}(?:[.,][0-9]*)?)", text.strip())
    if found is None:
        return None
    return 60.0 * float(found[1] or 0) + float(found[2].replace(",", "."))


class LineScreen(OverScreen[str | None]):
    """A question and a line; gives what was typed, or None."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f8", "dismiss(None)", "Close", priority=True),
        Binding("tab,shift+tab", "nothing", show=False, priority=True),
    ]

    def __init__(self, board: Board, question: str) -> None:
        super().__init__(board)
        self._question = question

    def compose_box(self) -> ComposeResult:
        """Yield the question and the line."""
        with Vertical(id="palette"):
            yield Static(self._question, classes="title", markup=False)
            yield Field(id="line", compact=True, max_length=20)
            yield Hints(("Enter answers", "enter"), ("F8 closes", "f8"))

    def on_mount(self) -> None:
        """Take what is typed."""
        self.set_focus(self.query_one(Input))

    def action_nothing(self) -> None:
        """Stay in the line."""

    @on(Input.Submitted)
    def _answered(self, event: Input.Submitted) -> None:
        event.stop()
        if event.value.strip():
            self.dismiss(event.value)
