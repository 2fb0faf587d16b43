"""Deflection against pressure: the running curve, or a completed one with its fit."""

from __future__ import annotations

from typing import ClassVar

from skinlab.tui.curve_drawing import Layers, curve_rows
from skinlab.tui.plot_data import box_around, fit_band, fitted, left_out, measured, thin
from skinlab.tui.shown import Entry, Live
from skinlab.tui.ui_state import Board
from skinlab.tui.widgets.rows import BoardRows

_EARLIER_POINTS = 150
_STYLES = ("measured", "fitted", "earlier", "band", "axis", "tick", "label")


class CurvePlot(BoardRows):
    """Draws what the board shows, and only when that changed."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {f"plot--{name}" for name in _STYLES}

    def __init__(self) -> None:
        super().__init__("plot-panel")
        self.drawn_layers = Layers()  # as drawn last

    def show(self, board: Board) -> None:
        """Draw."""
        super().show(board)
        shown = board.live or board.entry
        setup = shown.setup if shown is not None else board.order.setup if board.order else None
        program = None if setup is None else setup.program
        top_mbar = None if program is None else program.max_pressure_mbar
        earlier = [] if shown is None else board.earlier(shown)
        numbers = tuple(e.index for e in earlier)
        key = (board.session, top_mbar, numbers, self.size, *_identity(shown))
        if key == self._drawn:
            return
        self._drawn = key
        entry = shown if isinstance(shown, Entry) else None
        self.drawn_layers = Layers(
            [thin(measured(e), _EARLIER_POINTS) for e in earlier],
            () if entry is None else fit_band(entry),
            None if entry is None else fitted(entry),
            None if shown is None else measured(shown),
            None if entry is None else left_out(entry),
        )
        box = box_around(top_mbar, self.drawn_layers.all)
        styles = {name: self.get_component_rich_style(f"plot--{name}") for name in _STYLES}
        rows = curve_rows(self.drawn_layers, box, self.size.width, self.size.height)
        self.set_rows([[(cells, styles[style]) for cells, style in row] for row in rows])


def _identity(shown: Live | Entry | None) -> tuple[object, ...]:
    if isinstance(shown, Live):
        return ("live", shown.index, len(shown.curve))
    if isinstance(shown, Entry):
        return ("entry", shown.index, shown.result is not None)
    return ("nothing",)
