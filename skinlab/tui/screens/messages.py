"""All that was said in this program, to be read again."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.widgets import Static

from skinlab.tui.screens.over import OverScreen
from skinlab.tui.widgets.hints import Hints


class MessagesScreen(OverScreen[None]):
    """The messages, the latest first."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter,space,f8,b,q,w", "dismiss", "Close", priority=True),
    ]

    def compose_box(self) -> ComposeResult:
        """Yield the text."""
        lines = [f"{level}: {note}" for note, level in reversed(self._board.told)]
        with VerticalScroll(id="help"):
            yield Static("Messages, the latest first", classes="title", markup=False)
            yield Hints(("Enter closes", "enter"))
            yield Static("\n".join(lines) or "No messages yet.", markup=False)
