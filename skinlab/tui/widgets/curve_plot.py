"""Deflection against pressure: the running curve, or a completed one with its fit."""

from __future__ import annotations

from typing import ClassVar

from textual_plot import HiResMode, LegendLocation, PlotWidget

from skinlab.tui.plot_data import Trace, box_around, fitted, measured, nice_ticks, spaced
from skinlab.tui.ui_state import Board, Entry, Live

_TICK_ROWS = 3  # of the plot for each label
_LEGEND_COLUMNS = 36  # in less, the legend would lie on the curve


class CurvePlot(PlotWidget, can_focus=False):
    """Draws what the board shows, and only when that changed."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {"plot--measured", "plot--fitted"}

    def __init__(self) -> None:
        super().__init__(id="plot-panel", allow_pan_and_zoom=False)
        self._drawn: object = None
        self._shown: Live | Entry | None = None
        self._top_mbar: float | None = None

    def on_mount(self) -> None:
        """Label the axes."""
        super().on_mount()
        self.margin_top = 1
        self.margin_left = 7
        self.margin_bottom = 2
        self.set_xlabel("pressure (mbar)")
        self.set_ylabel("     deflection (mm)")  # centred on the axis: the blanks keep it whole
        self.show_legend(LegendLocation.BOTTOMRIGHT, is_visible=False)

    def show(self, board: Board) -> None:
        """Draw."""
        self._shown = board.live or board.entry
        program = None
        if isinstance(self._shown, Live):
            program = self._shown.setup.program
        elif self._shown is not None:
            program = self._shown.curve.setup.program
        elif board.order is not None:
            program = board.order.setup.program
        self._top_mbar = None if program is None else program.max_pressure_mbar
        key = (board.session, self._top_mbar, *_identity(self._shown))
        if key != self._drawn:
            self._drawn = key
            self._draw()

    def notify_style_update(self) -> None:
        """Draw again in the colours of another theme."""
        super().notify_style_update()
        if self.is_mounted:
            self._draw()

    def _draw(self) -> None:
        shown = self._shown
        points = None if shown is None else measured(shown)
        fit = fitted(shown) if isinstance(shown, Entry) else None
        traces = [trace for trace in (points, fit) if trace is not None and len(trace)]
        # One trace needs no legend; without it no frame of the running curve moves the layout.
        self.show_legend(is_visible=fit is not None and self.size.width >= _LEGEND_COLUMNS)
        self.clear()
        box = box_around(self._top_mbar, traces)
        self.set_xlimits(box.left_mbar, box.right_mbar)
        self.set_ylimits(box.bottom_mm, box.top_mm)
        # Not so many that two fall on one row, and one of them is not seen
        self.set_yticks(nice_ticks(box.bottom_mm, box.top_mm, self.size.height // _TICK_ROWS))
        if points is not None and len(points):
            self._points(box.inside(points), label="measured" if fit is None else None)
        if fit is not None and points is not None:
            self._line(fit)
            self._marks(box.inside(spaced(points, box)))  # else the line would hide them all

    def _points(self, trace: Trace, label: str | None) -> None:
        self.scatter(
            trace.pressure_mbar,
            trace.deflection_mm,
            marker_style=self._style("plot--measured"),
            hires_mode=HiResMode.BRAILLE,
            label=label,
        )

    def _line(self, trace: Trace) -> None:
        self.plot(
            trace.pressure_mbar,
            trace.deflection_mm,
            line_style=self._style("plot--fitted"),
            hires_mode=HiResMode.BRAILLE,
            label="fitted",
        )

    def _marks(self, trace: Trace) -> None:
        self.scatter(
            trace.pressure_mbar,
            trace.deflection_mm,
            marker_style=self._style("plot--measured"),
            hires_mode=HiResMode.QUADRANT,  # a whole cell would stand off the line
            label="measured",
        )

    def _style(self, component: str) -> str:
        return str(self.get_component_rich_style(component))


def _identity(shown: Live | Entry | None) -> tuple[object, ...]:
    if isinstance(shown, Live):
        return ("live", shown.index, len(shown.curve))
    if isinstance(shown, Entry):
        return ("entry", shown.index, shown.result is not None)
    return ("nothing",)
