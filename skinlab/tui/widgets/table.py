"""A table that says where it goes on beyond its edges."""

from __future__ import annotations

from typing import TypeVar

from rich.segment import Segment
from textual.strip import Strip
from textual.widgets import DataTable

_Cell = TypeVar("_Cell")


class Table(DataTable[_Cell]):
    """Textual's, with … in each row where more is to the left or right.

    Without it a number that is cut (0.021–0.028 as 0.021–0.0) looks like another number.
    """

    def render_line(self, y: int) -> Strip:
        """Return one row."""
        strip = super().render_line(y)
        columns, left = self.size.width, self.scroll_offset.x
        if y >= self.virtual_size.height or columns < 2:
            return strip
        parts = [strip.crop(0, 1), strip.crop(1, columns - 1), strip.crop(columns - 1, columns)]
        if left > 0:
            parts[0] = _more(parts[0])
        if self.virtual_size.width - left > columns:
            parts[2] = _more(parts[2])
        return Strip.join(parts)


def _more(strip: Strip) -> Strip:
    """Return a sign in the style of this column."""
    return Strip([Segment("…", segment.style) for segment in strip][:1], 1)
