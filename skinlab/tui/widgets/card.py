"""The panel under the fields: the armed settings once more, or what was identified."""

from __future__ import annotations

from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.widgets import Static

from skinlab.tui.card_text import CardText, card_text
from skinlab.tui.ui_state import Board

_USUAL_COLUMNS = 33  # before the first layout
_MORE = "▼ PgDn"


class Card(VerticalScroll, can_focus=False):
    """A title and some lines; grey while they may still change. Page keys scroll it."""

    _written: CardText | None = None
    _titled = ""

    def compose(self) -> ComposeResult:
        """Yield the text."""
        yield Static("", id="card-text", markup=False)

    def show(self, board: Board) -> None:
        """Draw."""
        columns = self._columns
        text = card_text(board, columns)
        if text != self._written:
            # The layout of the whole screen takes longer than a frame may
            same = self._written is not None and _shape(text, columns) == _shape(
                self._written, columns
            )
            if self._written is None or text.title != self._written.title:
                self.scroll_home(animate=False)
            self._written = text
            self.query_one("#card-text", Static).update("\n".join(text.lines), layout=not same)
            self.call_after_refresh(self._title)
        self._title()
        self.set_class(board.review is not None or board.can_start, "-armed")
        self.set_class(not text.final, "-forming")

    def watch_scroll_y(self, old_value: float, new_value: float) -> None:
        """Say whether there still is more."""
        super().watch_scroll_y(old_value, new_value)
        self._title()

    def turn(self) -> None:
        """Show the next page; after the last comes the first."""
        if self.scroll_offset.y >= self.max_scroll_y:
            self.scroll_home(animate=False)
        else:
            self.scroll_relative(y=max(self.size.height - 1, 1), animate=False)

    @property
    def _columns(self) -> int:
        return self.query_one("#card-text").size.width or _USUAL_COLUMNS

    def _title(self) -> None:
        """Write the title, with a sign where there is more below."""
        if self._written is None or not self.is_mounted:
            return
        title = self._written.title
        if self.virtual_size.height - self.size.height > self.scroll_offset.y:
            title = f"{title:<{max(self._columns - len(_MORE) - 2, 0)}} {_MORE}"
        if title != self._titled:
            self._titled = title
            for line in self.screen.query("#card-title").results(Static):
                line.update(title, layout=False)

    def shows_whole(self, board: Board) -> bool:
        """Whether what is on the screen is what the board says, to the last line."""
        if card_text(board, self._columns) != self._written or not self.size.height:
            return False
        rows = self.virtual_size.height <= self.size.height
        return rows and self.screen.region.contains_region(self.region)


def _shape(text: CardText, columns: int) -> list[str]:
    """Return what decides where lines are broken: which there are, and the text of long ones."""
    return [line if len(line) > columns else "" for line in text.lines]
