"""What opens over another screen: a box, under the line that stands on every screen."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import OptionList, Static

from skinlab.tui.screens.closing import Answer, ClosingScreen
from skinlab.tui.typing_guard import CHECK_KEY, CONFIRM_KEY, TypingGuard
from skinlab.tui.ui_state import Board
from skinlab.tui.widgets.header import Top
from skinlab.tui.widgets.hints import Hints
from skinlab.tui.widgets.keys import Keys
from skinlab.tui.widgets.note import Note


class OverScreen(ModalScreen[Answer], ClosingScreen[Answer]):  # styles are of the first
    """Shows state, suction and SIMULATED above what it yields in `compose_box`."""

    def __init__(self, board: Board) -> None:
        super().__init__()
        self._board = board

    def compose(self) -> ComposeResult:
        """Yield the top, and the box."""
        yield Top(self._board)
        yield from self.compose_box()
        with Vertical(classes="bottom"):  # over the keys of the screen below: not theirs now
            yield Note(self._board, later=True)
            yield Keys()

    @abstractmethod
    def compose_box(self) -> ComposeResult:
        """Yield the box."""


class ChoosingScreen(OverScreen[str | None]):
    """A list to choose from, by Enter, or with the left hand alone; gives the name of a choice."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(CONFIRM_KEY, "choose", "Choose", key_display="Enter", priority=True, id="confirm"),
        Binding("tab", "move(1)", show=False, priority=True),
        Binding("shift+tab", "move(-1)", show=False, priority=True),
    ]

    def action_move(self, by: int) -> None:
        """Go up or down in the list."""
        found = self.query_one(OptionList)
        (found.action_cursor_down if by > 0 else found.action_cursor_up)()

    def action_choose(self) -> None:
        """Choose what stands out."""
        self.query_one(OptionList).action_select()

    @on(OptionList.OptionSelected)
    def _chosen(self, event: OptionList.OptionSelected) -> None:
        self.dismiss(event.option.id)


class AskingScreen(OverScreen[bool]):
    """A question that stays until F9 (yes) or F8 (no); no letter, Enter or Space answers it.

    `_keys` are its keys in words.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(CONFIRM_KEY, "answer_yes", "Yes", priority=True, id="confirm"),
        Binding(CHECK_KEY, "answer_no", "No", priority=True, id="check"),
    ]
    _keys: tuple[tuple[str, str], ...] = (("F9 yes", "f9"), ("F8 no", "f8"))
    _box = "question"

    def __init__(self, board: Board, guard: TypingGuard, title: str, text: str) -> None:
        super().__init__(board)
        self._guard = guard
        self._title = title
        self._text = text
        guard.hidden()

    def compose_box(self) -> ComposeResult:
        """Yield the question."""
        with Vertical(id=self._box):
            yield Static(self._title, classes="title", markup=False)
            yield Static(self._text, id=f"{self._box}-text", markup=False)
            yield Hints(*self._keys)
            yield Static("", id=f"{self._box}-why", classes="hint", markup=False)

    def on_screen_resume(self) -> None:
        """Count from when it can be read, also where something lay over it."""
        self._guard.hidden()
        self.call_after_refresh(self._guard.asked)

    def action_answer_yes(self) -> None:
        """Answer yes, unless somebody types, or nobody can have read it."""
        why = self._guard.refusal()
        if why is None:
            self.dismiss(True)
        else:
            self.query_one(f"#{self._box}-why", Static).update(f"({why})")

    def action_answer_no(self) -> None:
        """Answer no."""
        self.dismiss(False)


class ConfirmScreen(AskingScreen):
    """Asks before something is done that is not only looking."""
