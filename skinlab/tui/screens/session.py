"""The session: all curves, what they say together, and what the operator decides about them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import ClassVar

from rich.text import Text
from textual import on
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.message import Message
from textual.widget import Widget
from textual.widgets import DataTable, Input, Static

from skinlab.errors import InputError
from skinlab.recording.curve_selection import Deed
from skinlab.recording.pseudonym import check_note
from skinlab.text import counted
from skinlab.tui.card_text import ROW_AFTER, ROW_BEFORE, result_lines, row_texts
from skinlab.tui.screens.board_screen import BoardScreen
from skinlab.tui.summary import left_out, repeats, repeats_lines
from skinlab.tui.text import clock, who_text
from skinlab.tui.typing_guard import CHECK_KEY
from skinlab.tui.ui_state import Board, Level
from skinlab.tui.value_text import column_title, value_columns
from skinlab.tui.widgets.field import Field
from skinlab.tui.widgets.table import Table


class SessionScreen(BoardScreen):
    """Shows the board's session; says what was decided, and what is to be computed."""

    class Decided(Message):
        """The operator decided something that belongs into the audit trail."""

        def __init__(self, deed: Deed, *, undone: bool = False) -> None:
            super().__init__()
            self.deed = deed
            self.undone = undone

    class Wanted(Message):
        """A joint fit of the curves that are used, a comparison, or what the model misses."""

        def __init__(self, what: str, path: str = "") -> None:
            super().__init__()
            self.what = what
            self.path = path

    SAYS = "#session-says"
    AUTO_FOCUS = "#session-curves"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("s,b,q", "back", "Back", key_display="s"),
        Binding("delete", "exclude", "Leave out", key_display="Del", id="exclude"),
        Binding("j", "joint", "Joint", id="joint"),
        Binding("c", "compare", "Compare", id="compare"),
        Binding("n", "note", "Note", id="note"),
        Binding("d,D", "missing", "Missing", key_display="d", id="missing"),
        Binding("ctrl+z", "undo", "Undo", key_display="^z", priority=True, id="undo"),
        Binding(CHECK_KEY, "cancel", "Cancel", key_display="F8", priority=True, id="check"),
        Binding("tab,shift+tab", "stay", show=False, priority=True),
    ]

    def __init__(self, board: Board) -> None:
        super().__init__(board)
        self._names: tuple[str, ...] = ()  # of the parameters that have a column
        self._then: Callable[[str], None] | None = None  # what the line that is typed is for
        self._needed = True  # an answer to it
        self._said = ""  # while it is asked

    def parts(self) -> Iterator[Widget]:
        """Yield title, curves, what they say together, and the line for an answer."""
        yield Static("", id="session-title", markup=False)
        yield Table(id="session-curves", cursor_type="row", zebra_stripes=True)
        text = Static("", id="session-text", markup=False)
        yield VerticalScroll(text, id="session-says", can_focus=False)
        line = Field(id="session-line", compact=True, max_length=200)
        line.display = False
        yield line

    def show(self) -> None:
        """Draw the curves, and what they say together."""
        board = self._board
        since = f", since {clock(board.begun_at)}" if board.begun_at else ""
        self.query_one("#session-title", Static).update(
            f"Session: {who_text(board.visit)}{since}, {counted(len(board.entries), 'curve')}"
        )
        table = self.query_one(DataTable)
        at = table.cursor_row
        names = value_columns(board.entries.values())
        table.clear(columns=names != self._names)
        if names != self._names:
            table.add_columns("used", *ROW_BEFORE, *map(column_title, names), *ROW_AFTER)
            self._names = names
        for index, entry in board.entries.items():
            reason = board.ledger.excluded.get(index)
            if reason is None and entry.curve.partial:
                reason = "cut short"  # in no mean and no joint fit
            used = Text("yes" if reason is None else f"no: {reason}")
            table.add_row(used, *row_texts(entry, names), key=str(index))
        if board.entries:
            table.move_cursor(row=min(at, len(board.entries) - 1))
        self.query_one("#session-text", Static).update("\n".join(self._lines()))

    def _lines(self) -> list[str]:
        board = self._board
        entries, excluded = board.entries.values(), board.ledger.excluded
        lines = repeats_lines(repeats(entries, excluded), left_out(entries, excluded))
        if board.joint is not None:
            used = board.joint.files or (board.joint.file,)
            how = "Together" if len(used) > 1 else "One curve alone"
            aside = [e.curve.name for e in board.entries.values() if e.curve.name not in used]
            later = f"; without {', '.join(aside)}: cut, left out, or later loadings"
            lines += [f"{how} ({', '.join(used)}{later if aside else ''}):"]
            lines += [f"  {line}" for line in result_lines(board.joint, 50)]
        lines += board.compared
        lines += [f"Note: {note}" for note in board.ledger.notes]
        return lines or ["Nothing yet: repeats are averaged here; j fits openings together."]

    # ---- keys ---------------------------------------------------------------------------------

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Letters are text while a line is typed, until it is answered or cancelled."""
        if action in {"exclude", "joint", "compare", "note", "undo", "back", "missing"}:
            return self._then is None
        if action in {"cancel", "stay"}:
            return self._then is not None
        return super().check_action(action, parameters)

    @property
    def _index(self) -> int | None:
        numbers = list(self._board.entries)
        row = self.query_one(DataTable).cursor_row
        return numbers[row] if 0 <= row < len(numbers) else None

    def action_exclude(self) -> None:
        """Leave the curve out, with a reason, or take it in again."""
        index = self._index
        if index is None:
            self._board.tell("there is no curve yet")
            return
        if index in self._board.ledger.excluded:
            self._decided(self._board.ledger.include(index))
        else:
            self._ask(
                f"why is curve {index} left out?",
                lambda text: self._decided(self._board.ledger.exclude(index, check_note(text))),
            )

    def action_note(self) -> None:
        """Write something down."""
        self._ask(
            "what is to be noted?",
            lambda text: self._decided(self._board.ledger.note(check_note(text))),
        )

    def action_compare(self) -> None:
        """Compare with another session."""
        self._ask(
            "compare with which session?",
            lambda text: self._want(self.Wanted("compare", text)),
            without="takes the visit before of this site",
        )

    def action_joint(self) -> None:
        """Fit the curves that are used together."""
        self._want(self.Wanted("joint"))

    def action_missing(self) -> None:
        """Ask what the model misses in the curves that are used."""
        self._want(self.Wanted("missing"))

    def action_undo(self) -> None:
        """Take the last decision back."""
        deed = self._board.ledger.undo()
        if deed is None:
            self._board.answer(Level.INFO, "there is nothing to undo")
            return
        self._board.touch()
        self.post_message(self.Decided(deed, undone=True))

    def _want(self, message: Wanted) -> None:
        self.post_message(message)

    def _decided(self, deed: Deed) -> None:
        self._board.touch()
        self.post_message(self.Decided(deed))

    # ---- a line of text -----------------------------------------------------------------------

    def _ask(self, what: str, then: Callable[[str], None], *, without: str = "") -> None:
        """Ask, and do `then` with the answer; `without` says what Enter alone does."""
        self._then, self._needed = then, not without
        enter = f"type its file, Enter alone {without}" if without else "Enter answers"
        self._said = f"{what} {enter}, F8 cancels"  # below: what is typed hides what was asked
        self._board.ask(self._said)
        line = self.query_one(Input)
        line.value, line.placeholder, line.display = "", what, True
        self.query_one(DataTable).disabled = True  # a click there would make letters keys again
        self.set_focus(line)  # at once: what is typed behind the key belongs here
        self.refresh_bindings()

    def leave_line(self) -> None:
        """Ask no more."""
        self._then = None
        if self._board.note == self._said:
            self._board.answer(Level.INFO, "")
        self.query_one(Input).display = False
        table = self.query_one(DataTable)
        table.disabled = False
        self.set_focus(table)
        self.refresh_bindings()

    def action_cancel(self) -> None:
        """Leave the line without an answer."""
        self.leave_line()

    def action_stay(self) -> None:
        """Stay in the line."""

    @on(Input.Submitted)
    def _answered(self, event: Input.Submitted) -> None:
        event.stop()
        text, then = event.value.strip(), self._then
        if then is None or (self._needed and not text):
            self._board.refuse(f"{event.input.placeholder}: type an answer, or F8 leaves it")
            return
        self.leave_line()
        try:
            then(text)
        except InputError as error:
            self._board.refuse(str(error))
