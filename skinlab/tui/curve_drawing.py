"""The plot of deflection against pressure, as pure functions: traces in, rows of styled text out.

All rows but four are the plot's own: a terminal at the bedside has few.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinlab.tui.canvas import Bits, braille, dots, share
from skinlab.tui.plot_data import Box, Trace, nice_ticks, spaced

LEFT = 7  # cells of the labels and the axis
_TICK_ROWS = 3  # of the plot for each label
_TICK_COLUMNS = 9
_TWO_LINES = 9  # rows from which on the axis has a line of its own
_MARK, _LEFT_OUT = "●", "×"
_APART, _APART_ROWS = 0.08, 1.3  # of the plot, and at least so many rows, between two marks

Run = tuple[str, str]  # text, and the name of its style


@dataclass(frozen=True, eq=False)
class Layers:
    """What is drawn: `earlier` and `band` are behind, `points` one by one, `left_out` over all."""

    earlier: Sequence[Trace] = ()
    band: Sequence[Trace] = ()
    fitted: Trace | None = None
    points: Trace | None = None  # of a curve that grows, or without a fit
    left_out: Trace | None = None  # glitches, marked each

    @property
    def all(self) -> list[Trace]:
        """All that has points."""
        traces = (self.fitted, self.points, self.left_out, *self.earlier)
        return [t for t in traces if t is not None and len(t)]


def curve_rows(layers: Layers, box: Box, columns: int, rows: int) -> list[list[Run]]:
    """Return the rows of a plot of this size in cells, legend and axes included."""
    line = rows >= _TWO_LINES
    height, width = rows - 2 - line, columns - LEFT
    if height < 2 or width < 8:
        return []
    plot = [
        [(label, "tick"), (axis, "axis"), *runs]
        for label, axis, runs in zip(
            *_y_axis(box, height), _data(layers, box, width, height), strict=True
        )
    ]
    ticks, labels = _x_axis(box, width)
    axis_row: list[list[Run]] = [[(" " * (LEFT - 1), "tick"), ("└" + ticks, "axis")]]
    return [
        _legend(layers, columns),
        *plot,
        *(axis_row if line else []),
        [(" " * LEFT + labels, "tick")],
    ]


def _legend(layers: Layers, columns: int) -> list[Run]:
    parts: list[list[Run]] = [[(" deflection, mm", "label")]]
    if layers.fitted is not None:
        parts += [_key(_MARK, "measured"), _key("──", "fitted")]
        if layers.left_out is not None:
            parts.append([(f"  {_LEFT_OUT}", "measured"), (" left out", "label")])
        if layers.band:
            parts.append([(" ±", "band"), (" 2 noise", "label")])
        if layers.earlier:
            parts.append(_key("··", "earlier"))
    while len(parts) > 1 and sum(len(text) for part in parts for text, _ in part) > columns:
        parts.pop()
    return [run for part in parts for run in part]


def _key(mark: str, style: str) -> list[Run]:
    """Return a mark in its colour, and its name in one that can be read on every theme."""
    return [(f"  {mark}", style), (f" {style}", "label")]


def _y_axis(box: Box, height: int) -> tuple[list[str], list[str]]:
    labels, axis = [" " * (LEFT - 1)] * height, ["│"] * height
    for tick, text in _labelled(nice_ticks(box.bottom_mm, box.top_mm, height // _TICK_ROWS)):
        at = float(share(tick, box.bottom_mm, box.top_mm))
        row = min(int((1 - at) * height), height - 1)
        labels[row], axis[row] = text.rjust(LEFT - 1), "┤"
    return labels, axis


def _x_axis(box: Box, width: int) -> tuple[str, str]:
    line, labels = ["─"] * (width - 1), [" "] * width
    unit, last = "mbar", 0
    for tick, text in _labelled(nice_ticks(box.left_mbar, box.right_mbar, width // _TICK_COLUMNS)):
        at = int(float(share(tick, box.left_mbar, box.right_mbar)) * width)
        if at < len(line):
            line[at - (at > 0)] = "┴"
        begin = min(max(at - len(text) // 2, 0), width - len(text))
        labels[begin : begin + len(text)] = text
        last = begin
    end = len("".join(labels).rstrip())
    at = end + 1 if width - end > len(unit) else last - len(unit) - 1  # behind, or before the last
    if at >= 0 and not "".join(labels[max(at - 1, 0) : at + len(unit)]).strip():
        labels[at : at + len(unit)] = unit
    return "".join(line), "".join(labels[:width])


def _labelled(ticks: Sequence[float]) -> list[tuple[float, str]]:
    """Return the ticks with labels of as many decimals as their steps have."""
    step = ticks[1] - ticks[0] if len(ticks) > 1 else (ticks[0] or 1.0)
    places = max(0, -int(np.floor(np.log10(abs(step)) + 1e-9)))
    return [(tick, f"{tick:.{places}f}") for tick in ticks]


def _data(layers: Layers, box: Box, width: int, height: int) -> list[list[Run]]:
    def line(trace: Trace, every: int = 1) -> Bits:
        return _polyline(trace, box, width, height, every)

    drawn: list[tuple[str, Bits]] = []  # the first one is on top
    if layers.points is not None and layers.fitted is None:
        inside = box.inside(layers.points)
        x = share(inside.pressure_mbar, box.left_mbar, box.right_mbar)
        y = share(inside.deflection_mm, box.bottom_mm, box.top_mm)
        drawn.append(("measured", dots(x, y, width, height)))
    if layers.fitted is not None:
        drawn.append(("fitted", line(layers.fitted)))
    drawn += [("band", line(trace, 2)) for trace in layers.band]
    drawn += [("earlier", line(trace, 2)) for trace in layers.earlier]
    if not drawn:
        return [[(" " * width, "tick")] for _ in range(height)]
    cells = [list(row) for row in braille(np.bitwise_or.reduce([bits for _, bits in drawn]))]
    owner = np.full((height, width), len(drawn) - 1)
    for number in range(len(drawn) - 1, -1, -1):
        owner[drawn[number][1] != 0] = number
    names = [[drawn[n][0] for n in row] for row in owner]
    if layers.points is not None and layers.fitted is not None:
        marked = spaced(layers.points, box, max(_APART, _APART_ROWS / height))
        for row, column in _cells_of(box.inside(marked), box, width, height):
            cells[row][column], names[row][column] = _MARK, "measured"
    if layers.left_out is not None:
        for row, column in _cells_of(box.inside(layers.left_out), box, width, height):
            cells[row][column], names[row][column] = _LEFT_OUT, "measured"
    return [_runs(row, of) for row, of in zip(cells, names, strict=True)]


def _cells_of(trace: Trace, box: Box, width: int, height: int) -> list[tuple[int, int]]:
    x = share(trace.pressure_mbar, box.left_mbar, box.right_mbar)
    y = share(trace.deflection_mm, box.bottom_mm, box.top_mm)
    columns = np.minimum((x * width).astype(int), width - 1)
    rows = np.minimum(((1 - y) * height).astype(int), height - 1)
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def _polyline(trace: Trace, box: Box, width: int, height: int, every: int) -> Bits:
    """Return the dots along a trace, one in `every`."""
    x = share(trace.pressure_mbar, box.left_mbar, box.right_mbar) * 2 * width
    y = share(trace.deflection_mm, box.bottom_mm, box.top_mm) * 4 * height
    if len(x) > 1:
        along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        at = np.arange(0.0, along[-1] + every, every)
        x, y = np.interp(at, along, x), np.interp(at, along, y)
    return dots(x / (2 * width), y / (4 * height), width, height)


def _runs(cells: Sequence[str], names: Sequence[str]) -> list[Run]:
    """Return a row with cells of one style together: single ones take longer than a frame may."""
    runs: list[Run] = []
    begin = 0
    for i in range(1, len(cells) + 1):
        if i == len(cells) or names[i] != names[begin]:
            runs.append(("".join(cells[begin:i]), names[begin]))
            begin = i
    return runs
