"""The alarm: over everything, until it is acknowledged."""

from __future__ import annotations

from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.widgets import Static

from skinlab.tui.screens.over import AskingScreen
from skinlab.tui.typing_guard import CONFIRM_KEY, TypingGuard
from skinlab.tui.ui_state import Board


class AlarmScreen(AskingScreen):
    """Lift the probe. Only F9 takes it away; v and Esc vent again."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(CONFIRM_KEY, "answer_yes", "Acknowledge", priority=True, id="confirm"),
    ]
    _keys: tuple[tuple[str, str], ...] = (("v vents again", "v"), ("F9 acknowledges", "f9"))
    _box = "alarm"

    def __init__(self, board: Board, guard: TypingGuard, text: str) -> None:
        super().__init__(board, guard, "ALARM: LIFT THE PROBE", text)
        if board.read_only or board.out_of_reach:  # v ends no suction
            self._keys = self._keys[1:]

    def on_mount(self) -> None:
        """Be heard as well."""
        self.app.bell()

    def tell(self, text: str) -> None:
        """Say something newer."""
        if text != self._text:
            self._text = text
            for line in self.query("#alarm-text").results(Static):  # none before it is composed
                line.update(text)
            self.on_screen_resume()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Stay: an alarm cannot be declined."""
        return action != "answer_no" and super().check_action(action, parameters)
