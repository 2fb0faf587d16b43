"""What the model misses: where, which effect, what to measure next, before and after."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from rich.text import Text
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Static

from skinlab.tui.missing import hints, missing_rows
from skinlab.tui.screens.board_screen import BoardScreen
from skinlab.tui.shown import Missing
from skinlab.tui.ui_state import Board

_USUAL_COLUMNS = 76  # before the first layout
_STYLES = ("text", "strong", "quiet", "before", "after", "band")


class MissingAnswer(Static):
    """Words, bars and small pictures, one under the other."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {f"missing--{name}" for name in _STYLES}
    styled = 0  # how often the colours became others

    def notify_style_update(self) -> None:
        """Be drawn again in the colours of another theme."""
        super().notify_style_update()
        self.styled += 1

    def draw(self, missing: Missing | None) -> None:
        """Draw."""
        styles = {name: self.get_component_rich_style(f"missing--{name}") for name in _STYLES}
        text = Text()
        lines = self.screen.query_one("#missing-says").size.height
        for row in missing_rows(missing, self.size.width or _USUAL_COLUMNS, lines):
            for cells, style in row:
                text.append(cells, styles[style])
            text.append("\n")
        text.right_crop(1)
        self.update(text)


class MissingScreen(BoardScreen):
    """Shows the board's search; says what is wanted of it."""

    class Wanted(Message):
        """A key asked for something: begin, cancel, load, adopt or undo."""

        def __init__(self, what: str) -> None:
            super().__init__()
            self.what = what

    SAYS = AUTO_FOCUS = "#missing-says"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("b,q,s", "back", "Back", key_display="b"),
        Binding("f7", "want('load')", "Load next", key_display="F7", id="load"),
        Binding("a", "want('adopt')", "Adopt", id="adopt"),
        Binding("ctrl+z", "want('undo')", "Undo", key_display="^z", priority=True, id="undo"),
        Binding("delete", "want('cancel')", "Give up", key_display="Del", id="give_up"),
        Binding("d,D", "want('begin')", "Look again", key_display="d", id="missing"),
    ]

    def __init__(self, board: Board) -> None:
        super().__init__(board)
        self._keys: object = None

    def parts(self) -> Iterator[Widget]:
        """Yield title and answer."""
        yield Static("", id="missing-title", markup=False)
        yield VerticalScroll(MissingAnswer("", id="missing-text", markup=False), id="missing-says")

    def drawn_from(self) -> object:
        """Return what decides whether something else is to be drawn."""
        answer = self.query_one(MissingAnswer)
        return (self._board.version, answer.size.width, self.size.height, answer.styled)

    def show(self) -> None:
        """Draw the answer, or how far the search is."""
        board, answer = self._board, self.query_one(MissingAnswer)
        missing = board.missing
        state = "" if missing is None else "looking …" if missing.running else "done"
        title = f"What is missing in the model? {state}"
        self.query_one("#missing-title", Static).update(title)
        answer.draw(missing)
        keys = (missing and missing.running, missing and missing.adopted, hints(missing))
        if keys != self._keys:
            self._keys = keys
            self.refresh_bindings()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show the keys that mean something now."""
        if action != "want":
            return super().check_action(action, parameters)
        missing = self._board.missing
        running = missing is not None and missing.running
        load, adopt = hints(missing)
        undo = missing is not None and missing.adopted is not None
        allowed = {"load": load, "adopt": adopt, "cancel": running, "undo": undo}
        return allowed.get(str(parameters[0]), not running)

    def action_want(self, what: str) -> None:
        """Pass on what a key asked for."""
        self.post_message(self.Wanted(what))
