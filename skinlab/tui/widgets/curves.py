"""The list of this session's curves; moving the cursor looks at another one."""

from __future__ import annotations

from skinlab.tui.card_text import ROW_AFTER, ROW_BEFORE, row_texts
from skinlab.tui.ui_state import Board
from skinlab.tui.value_text import column_title, value_columns
from skinlab.tui.widgets.table import Table

# Widths of columns whose cells are filled later: a table does not always make room.
_WIDTHS = {"whose": 20, "time": 5, "use": 6, "rms µm": 7, "remarks": 60}
_VALUE = 14


def _widths(names: tuple[str, ...]) -> dict[str, int | None]:
    values = dict.fromkeys(map(column_title, names), _VALUE)
    return {
        **{title: _WIDTHS.get(title) for title in ROW_BEFORE},
        **values,
        **{title: _WIDTHS.get(title) for title in ROW_AFTER},
    }


class Curves(Table[str]):
    """One row a curve."""

    def __init__(self) -> None:
        super().__init__(id="curves", cursor_type="row", zebra_stripes=True)
        self._shown = (0, False)
        self._rows: dict[int, tuple[str, ...]] = {}
        self._cursor_at: int | None = None
        self._names: tuple[str, ...] = ()

    def on_mount(self) -> None:
        """Make the columns."""
        self._make_columns(value_columns(()))

    def _make_columns(self, names: tuple[str, ...]) -> None:
        self._names = names
        for title, width in _widths(names).items():
            self.add_column(title, key=title, width=width)

    def show(self, board: Board) -> None:
        """Add what is new, update what changed, and stand on the shown curve."""
        # Under the name of somebody else nothing stands
        shown = (board.session, board.elsewhere)
        if shown != self._shown:
            self._shown, self._cursor_at = shown, None
            self._rows.clear()
            self.clear()
        names = value_columns(board.entries.values())
        if names != self._names:  # of another law
            self._rows.clear()
            self.clear(columns=True)
            self._make_columns(names)
        for index, entry in () if board.elsewhere else board.entries.items():
            texts = row_texts(entry, names)
            if index not in self._rows:
                self.add_row(*texts, key=str(index))
            elif texts != self._rows[index]:
                for column, text in zip(_widths(names), texts, strict=True):
                    self.update_cell(str(index), column, text)
            self._rows[index] = texts
        if board.entry is not None and board.shown != self._cursor_at:
            self._cursor_at = board.shown
            self.move_cursor(row=self.get_row_index(str(board.shown)))
