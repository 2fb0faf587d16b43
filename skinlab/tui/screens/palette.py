"""All that can be done, by searching for it: nothing here starts anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.widgets import Input, OptionList, Static
from textual.widgets.option_list import Option

from skinlab.tui.screens.over import ChoosingScreen
from skinlab.tui.ui_state import Board
from skinlab.tui.widgets.field import Field
from skinlab.tui.widgets.hints import Hints


@dataclass(frozen=True)
class Command:
    """Something to do: an action of the app or of the main screen, in words, and its key."""

    action: str
    words: str
    key: str = ""


class PaletteScreen(ChoosingScreen):
    """A line to search with, and the commands that fit; gives the chosen action, or None."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("ctrl+p,f8", "dismiss(None)", "Close", priority=True),
        Binding("up", "move(-1)", show=False, priority=True),
        Binding("down", "move(1)", show=False, priority=True),
    ]

    def __init__(self, board: Board, commands: Sequence[Command]) -> None:
        super().__init__(board)
        self._commands = commands

    def compose_box(self) -> ComposeResult:
        """Yield the line and the list."""
        with Vertical(id="palette"):
            yield Static("What do you want to do?", classes="title", markup=False)
            yield Field(id="palette-line", compact=True, placeholder="type to search")
            yield OptionList(id="palette-list", markup=False)
            yield Hints(("Enter chooses", "enter"), ("F8 closes", "f8"))

    def on_mount(self) -> None:
        """Begin with all."""
        self._list("")
        self.set_focus(self.query_one(Input))

    def _list(self, text: str) -> None:
        words = text.casefold().split()
        found = self.query_one(OptionList)
        found.clear_options()
        for command in self._commands:
            if all(word in command.words.casefold() for word in words):
                found.add_option(Option(f"{command.key:<6} {command.words}", id=command.action))
        if found.option_count:
            found.highlighted = 0

    @on(Input.Changed)
    def _searched(self, event: Input.Changed) -> None:
        event.stop()
        self._list(event.value)

    @on(Input.Submitted)
    def _submitted(self, event: Input.Submitted) -> None:
        event.stop()
        found = self.query_one(OptionList)
        if found.highlighted is not None:
            self.dismiss(found.get_option_at_index(found.highlighted).id)
