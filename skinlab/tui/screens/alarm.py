"""The alarm: over everything, until it is acknowledged."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Static


class AlarmScreen(ModalScreen[None]):
    """Lift the probe. Only `a` takes it away; v and Esc vent again."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("a", "dismiss", "Acknowledge", priority=True),
    ]

    def __init__(self, text: str) -> None:
        super().__init__()
        self._text = text

    def compose(self) -> ComposeResult:
        """Yield the text."""
        with Vertical(id="alarm"):
            yield Static("ALARM: LIFT THE PROBE", classes="title", markup=False)
            yield Static(self._text, id="alarm-text", markup=False)
            yield Static("v vents again      a acknowledges", classes="hint", markup=False)

    def on_mount(self) -> None:
        """Be heard as well."""
        self.app.bell()

    def tell(self, text: str) -> None:
        """Say something newer."""
        if text != self._text:
            self._text = text
            for line in self.query("#alarm-text").results(Static):  # none before it is composed
                line.update(text)
