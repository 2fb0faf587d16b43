"""Pick instead of typing: an opening, a program by its name, a site on the body, a goal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from textual import events, on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from skinlab.tui.choices import body_map, nearest_site
from skinlab.tui.screens.over import ChoosingScreen
from skinlab.tui.ui_state import Board
from skinlab.tui.widgets.hints import Hints


class PickScreen(ChoosingScreen):
    """A list; gives what was chosen, or None. With a map where `body` says so."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f4,f8", "dismiss(None)", "Close", priority=True),
    ]

    def __init__(
        self, board: Board, title: str, choices: Sequence[tuple[str, str]], *, body: bool = False
    ) -> None:
        super().__init__(board)
        self._title = title
        self._choices = choices
        self._body = body

    def compose_box(self) -> ComposeResult:
        """Yield the list, and the map."""
        with Vertical(id="pick"):
            yield Static(self._title, classes="title", markup=False)
            with Horizontal(id="pick-middle"):
                yield OptionList(
                    *(Option(_line(text, words), id=text) for text, words in self._choices),
                    markup=False,
                )
                if self._body:
                    yield BodyMap(body_map(""), id="body", markup=False)
            how = "Enter, or a click on the map, chooses" if self._body else "Enter chooses"
            yield Hints((how, "enter"), ("F4 closes", "f4"))

    @on(OptionList.OptionHighlighted)
    def _mark(self, event: OptionList.OptionHighlighted) -> None:
        for body in self.query(BodyMap):
            body.update(body_map(event.option.id or ""))


class BodyMap(Static):
    """The body, front and back; a click chooses the nearest site."""

    def on_click(self, event: events.Click) -> None:
        """Choose."""
        event.stop()
        screen = self.screen
        assert isinstance(screen, PickScreen)
        screen.dismiss(nearest_site(event.x, event.y).name)


def _line(text: str, words: str) -> str:
    return words if text == words or words.startswith(text) else f"{words}: {text}"
