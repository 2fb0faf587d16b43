"""Text on the screen, made inert as it is drawn: in every widget, wherever it is from."""

from __future__ import annotations

from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

from skinlab.text import inert, is_inert


class InertText(LineFilter):
    """Shows what a terminal would obey as symbols; a line stays as wide as it was laid out."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Return the segments of a line."""
        if all(is_inert(segment.text) for segment in segments):
            return segments
        width = sum(segment.cell_length for segment in segments)
        shown = [Segment(inert(s.text), s.style, s.control) for s in segments]
        return Segment.adjust_line_length(shown, width)
