"""The list of this session's curves; moving the cursor looks at another one."""

from __future__ import annotations

from textual.widgets import DataTable

from skinlab.tui.text import row_texts
from skinlab.tui.ui_state import Board

# Columns, and the widths of those whose cells are filled later: a table does not always make room.
_WIDTHS = {
    "#": None,
    "whose": 14,
    "time": 5,
    "program": None,
    "cycle": None,
    "X1 MPa": 7,
    "X2 MPa": 7,
    "nu": 6,
    "E µm": 6,
    "remarks": 60,
}


class Curves(DataTable[str]):
    """One row a curve."""

    def __init__(self) -> None:
        super().__init__(id="curves", cursor_type="row", zebra_stripes=True)
        self._shown = (0, False)
        self._rows: dict[int, tuple[str, ...]] = {}
        self._cursor_at: int | None = None

    def on_mount(self) -> None:
        """Make the columns."""
        for name, width in _WIDTHS.items():
            self.add_column(name, key=name, width=width)

    def show(self, board: Board) -> None:
        """Add what is new, update what changed, and stand on the shown curve."""
        # Under the name of somebody else nothing stands
        shown = (board.session, board.elsewhere)
        if shown != self._shown:
            self._shown, self._cursor_at = shown, None
            self._rows.clear()
            self.clear()
        for index, entry in () if board.elsewhere else board.entries.items():
            texts = row_texts(entry)
            if index not in self._rows:
                self.add_row(*texts, key=str(index))
            elif texts != self._rows[index]:
                for column, text in zip(_WIDTHS, texts, strict=True):
                    self.update_cell(str(index), column, text)
            self._rows[index] = texts
        if board.entry is not None and board.shown != self._cursor_at:
            self._cursor_at = board.shown
            self.move_cursor(row=self.get_row_index(str(board.shown)))
