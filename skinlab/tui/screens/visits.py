"""The visits in the folder of sessions: search, sort, look into, compare, follow over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from textual import on
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.widget import Widget
from textual.widgets import DataTable, Input, Static

from skinlab.errors import SkinlabError
from skinlab.io.log import log_exception
from skinlab.recording.visit_index import VisitRow, visits
from skinlab.text import inert
from skinlab.tui.screens.board_screen import BoardScreen
from skinlab.tui.typing_guard import CHECK_KEY
from skinlab.tui.ui_state import Board
from skinlab.tui.visits import (
    ORDERS,
    TITLES,
    at_control,
    cells,
    dated,
    found,
    series,
    trend_lines,
    when,
)
from skinlab.tui.widgets.field import Field
from skinlab.tui.widgets.table import Table

if TYPE_CHECKING:
    from skinlab.inference.identify import Identifier
    from skinlab.studies.comparison import Since

_NONE = "There is no visit here."


class VisitsScreen(BoardScreen):
    """A table of visits, and what was asked of them below."""

    SAYS = "#visits-says"
    AUTO_FOCUS = "#visits"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("b,q,f5", "back", "Back", key_display="b"),
        Binding("slash,f", "search", "Search", key_display="/", id="search"),
        Binding("o", "order", "Order", id="order"),
        Binding("enter", "look", "Look into", priority=True),
        Binding("m", "mark", "Mark", id="mark"),
        Binding("k", "control", "Control", id="control"),
        Binding("c", "compare", "Compare", id="compare"),
        Binding("t", "trend", "Trend", id="trend"),
        Binding(CHECK_KEY, "leave_search", show=False, priority=True, id="check"),
    ]

    def __init__(self, board: Board, folder: Path, identifier: Callable[[], Identifier]) -> None:
        super().__init__(board)
        self._folder = folder
        self._identifier = identifier
        self._rows: list[VisitRow] = []
        self._shown: list[VisitRow] = []
        self._order = 0
        self._marked: str | None = None
        self._control: tuple[str, str] | None = None  # subject and site that was left alone

    def parts(self) -> Iterator[Widget]:
        """Yield title, search, list and answer."""
        yield Static("Visits: reading …", id="visits-title", markup=False)
        line = Field(id="visits-search", compact=True, placeholder="words to search for")
        line.display = False
        yield line
        yield Table(id="visits", cursor_type="row", zebra_stripes=True)
        text = Static("", id="visits-text", markup=False)
        yield VerticalScroll(text, id="visits-says", can_focus=False)

    def show(self) -> None:
        """Draw nothing: what is listed changes with the folder and the keys."""

    def on_mount(self) -> None:
        """Read the folder, beside."""
        self.query_one(DataTable).add_columns("", *TITLES)

        def read() -> None:
            try:
                rows = visits(self._folder, self._tell)
            except (OSError, SkinlabError) as error:
                self._say(f"{self._folder}: {error}")
            else:
                self.app.call_from_thread(self._read, rows)

        self.run_worker(read, thread=True, exit_on_error=False)

    def _tell(self, done: int, of: int) -> None:
        title = f"Visits: reading {done + 1} of {of} …"
        self.app.call_from_thread(self.query_one("#visits-title", Static).update, title)

    def _read(self, rows: list[VisitRow]) -> None:
        self._rows = rows
        self._list()

    def _list(self) -> None:
        """Fill the table with what was searched for, in order."""
        name, key, backwards = ORDERS[self._order]
        text = self.query_one(Input).value
        self._shown = sorted(found(self._rows, text), key=key, reverse=backwards)
        table = self.query_one(DataTable)
        table.clear()
        for row in self._shown:
            alone = "○" if (row.subject, row.site) == self._control else ""
            mark = "●" if row.file == self._marked else alone
            table.add_row(mark, *map(inert, cells(row)), key=row.file)
        only = f" with “{text}”" if text else ""
        title = f"Visits in {self._folder}{only}: {len(self._shown)}, {name}"
        self.query_one("#visits-title", Static).update(title)

    @property
    def _chosen(self) -> VisitRow | None:
        at = self.query_one(DataTable).cursor_row
        return self._shown[at] if 0 <= at < len(self._shown) else None

    # ---- keys ---------------------------------------------------------------------------------

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Letters are text while something is searched for."""
        searching = isinstance(self.focused, Input)
        if action in {"search", "order", "mark", "control", "compare", "trend", "back"}:
            return not searching
        if action == "leave_search":
            return searching
        return super().check_action(action, parameters)

    def action_search(self) -> None:
        """Search: type words, Enter goes to the list."""
        line = self.query_one(Input)
        line.display = True
        self.set_focus(line)

    def action_leave_search(self) -> None:
        """Go back to the list; an empty search shows all."""
        line = self.query_one(Input)
        line.display = bool(line.value)
        self.set_focus(self.query_one(DataTable))

    @on(DataTable.RowSelected)
    def _clicked(self) -> None:
        self.action_look()

    @on(Input.Changed)
    def _searched(self, event: Input.Changed) -> None:
        event.stop()
        self._list()

    def action_order(self) -> None:
        """Sort otherwise."""
        self._order = (self._order + 1) % len(ORDERS)
        self._list()

    def action_mark(self) -> None:
        """Mark the visit that others are compared with."""
        row = self._chosen
        if row is None:
            self._write(_NONE)
            return
        self._marked = None if row.file == self._marked else row.file
        self._list_again()

    def action_control(self) -> None:
        """Take the change of a site that was left alone away from every comparison."""
        row = self._chosen
        if row is None:
            self._write(_NONE)
            return
        whose = (row.subject, row.site)
        self._control = None if whose == self._control else whose
        self._list_again()
        what = "None" if self._control is None else f"{row.site or 'no site'} of {row.subject}"
        self._write(f"Control site (left alone, measured on the same days): {what}.")

    def _list_again(self) -> None:
        at = self.query_one(DataTable).cursor_row
        self._list()
        self.query_one(DataTable).move_cursor(row=at)

    def action_look(self) -> None:
        """Say what is in a visit."""
        if isinstance(self.focused, Input):
            self.action_leave_search()
            return
        row = self._chosen
        if row is None:
            self._write(_NONE)
            return
        path = self._folder / row.file

        def look() -> str:
            from skinlab.recording.session import read_session
            from skinlab.report.session_text import describe_session

            return describe_session(path, read_session(path))

        self._compute("reading …", look)

    def action_compare(self) -> None:
        """Say whether the skin of a visit differs from the marked one."""
        row = self._chosen
        other = next((r for r in self._rows if r.file == self._marked), None)
        if row is None or other is None or row is other:
            self._write("Mark a visit (m), go to another one, then c compares.")
            return
        first, second = other, row  # where nobody says which was first, the marked one
        if len(dated((first, second))) == 2:
            first, second = sorted((first, second), key=lambda v: v.measured_utc)

        def compare() -> str:
            from skinlab.studies.change import in_words

            title = f"{when(first)} {first.file} and {when(second)} {second.file}:"
            compared = self._since(first, second)
            return "\n".join([title, *compared.notes, *in_words(compared.found)])

        self._compute("comparing …", compare)

    def action_trend(self) -> None:
        """Draw the values of a subject's site over its visits."""
        row = self._chosen
        if row is None:
            self._write(_NONE)
            return
        rows = series(self._rows, row)
        columns = self.query_one("#visits-text").size.width or 76

        def trend() -> str:
            over = dated(rows)
            changes = self._since(over[0], over[-1]).found if len(over) > 1 else None
            return "\n".join(trend_lines(rows, columns, changes))

        self._compute("following …", trend)

    # ---- what takes a while -------------------------------------------------------------------

    def _since(self, before: VisitRow, after: VisitRow) -> Since:
        """Return how two visits differ; that two people do is said, and nobody has to ask for it.

        A control is of one person.
        """
        from skinlab.studies.comparison import since
        from skinlab.studies.whose import differ

        paths = (self._folder / before.file, self._folder / after.file)
        whose = self._control
        two = differ(before.subject, after.subject)
        control = None
        if not two and whose is not None and whose[0] == before.subject and whose[1] != before.site:
            control = (
                self._folder / at_control(self._rows, before, whose[1]).file,
                self._folder / at_control(self._rows, after, whose[1]).file,
            )
        study = self._board.study
        return since(self._identifier(), *paths, control, study, between_people=two)

    def _compute(self, busy: str, call: Callable[[], str]) -> None:
        """Write what a call returns, or why it cannot, from a thread."""
        self._write(busy)

        def work() -> None:
            try:
                text = call()
            except SkinlabError as error:
                text = str(error)
            except Exception as error:  # noqa: BLE001 -- told in a sentence; details are logged
                text = f"failed ({error!r}); details are in {log_exception(error)}"
            self._say(text)

        self.run_worker(work, thread=True, exclusive=True, group="visits", exit_on_error=False)

    def _say(self, text: str) -> None:
        self.app.call_from_thread(self._write, text)

    def _write(self, text: str) -> None:
        if self.is_mounted:
            self.query_one("#visits-text", Static).update(text)
            self.query_one("#visits-says").scroll_home(animate=False)
