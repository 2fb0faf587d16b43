"""NO_COLOR: Textual 8's filter fails on text without a style, which the plot draws."""

from __future__ import annotations

from rich.segment import Segment
from rich.style import Style
from textual.color import Color
from textual.filter import LineFilter


class StyledFirst(LineFilter):
    """Another filter, which gets no segment without a style."""

    def __init__(self, inner: LineFilter) -> None:
        super().__init__(enabled=inner.enabled)
        self._inner = inner

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Return the segments, filtered."""
        if any(s.style is None for s in segments):
            segments = [Segment(s.text, s.style or Style.null(), s.control) for s in segments]
        return self._inner.apply(segments, background)
