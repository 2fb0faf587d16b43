"""The list of this session's curves; moving the cursor looks at another one."""

from __future__ import annotations

from textual.widgets import DataTable

from skinlab.tui.board import Board
from skinlab.tui.words import row_texts

_COLUMNS = ("#", "program", "cycle", "X1 MPa", "X2 MPa", "nu", "E µm", "remarks")


class Curves(DataTable[str]):
    """One row a curve."""

    def __init__(self) -> None:
        super().__init__(id="curves", cursor_type="row", zebra_stripes=True)
        self._session = 0
        self._rows: dict[int, tuple[str, ...]] = {}
        self._cursor_at: int | None = None

    def on_mount(self) -> None:
        """Make the columns."""
        for name in _COLUMNS:
            self.add_column(name, key=name)

    def show(self, board: Board) -> None:
        """Add what is new, update what changed, and stand on the shown curve."""
        if board.session != self._session:
            self._session, self._cursor_at = board.session, None
            self._rows.clear()
            self.clear()
        for index, entry in board.entries.items():
            texts = row_texts(entry)
            if index not in self._rows:
                self.add_row(*texts, key=str(index))
            elif texts != self._rows[index]:
                for column, text in zip(_COLUMNS, texts, strict=True):
                    self.update_cell(str(index), column, text, update_width=True)
            self._rows[index] = texts
        if board.shown is not None and board.shown != self._cursor_at:
            self._cursor_at = board.shown
            self.move_cursor(row=self.get_row_index(str(board.shown)))
