"""Drawing with braille dots, as pure functions: numbers in, rows of characters out."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

Bits = NDArray[np.uint8]

# Of the 2 x 4 dots of a cell: the bit of each, by row and column (Unicode block U+2800).
_DOT = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.uint8)


def dots(x: ArrayLike, y: ArrayLike, columns: int, rows: int) -> Bits:
    """Return the braille bits (rows, columns) of points; x and y run from 0 to 1, y upwards.

    What lies outside, or is not finite, is left out.
    """
    bits = np.zeros((max(rows, 0), max(columns, 0)), dtype=np.uint8)
    across, up = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    there = (across >= 0) & (across <= 1) & (up >= 0) & (up <= 1)  # NaN is nowhere
    if not bits.size or not there.any():
        return bits
    i = np.minimum((across[there] * 2 * columns).astype(int), 2 * columns - 1)
    j = np.minimum(((1 - up[there]) * 4 * rows).astype(int), 4 * rows - 1)
    np.bitwise_or.at(bits, (j // 4, i // 2), _DOT[j % 4, i % 2])
    return bits


def braille(bits: Bits) -> list[str]:
    """Return one text a row; a cell without a dot is a blank."""
    return ["".join(chr(0x2800 + int(b)) if b else " " for b in row) for row in bits]


def runs(layers: Sequence[Bits]) -> list[list[tuple[str, int]]]:
    """Return each row as (text, number of the layer that colours it); the first layer is on top.

    Cells of one colour come together: a thousand single characters take longer than a frame may.
    """
    whole = braille(np.bitwise_or.reduce(layers))
    # Of each cell the topmost layer that has a dot there; blanks go with the last one
    owner = np.full(layers[0].shape, len(layers) - 1)
    for number in range(len(layers) - 1, -1, -1):
        owner[layers[number] != 0] = number
    rows = []
    for text, owners in zip(whole, owner, strict=True):
        edges = np.flatnonzero(np.diff(owners)) + 1
        bounds = [0, *edges.tolist(), len(text)]
        rows.append([(text[a:b], int(owners[a])) for a, b in pairwise(bounds) if b > a])
    return rows


def share(values: ArrayLike, low: float, high: float) -> NDArray[np.float64]:
    """Return where values lie between `low` (0) and `high` (1)."""
    span = high - low
    return (np.asarray(values, dtype=float) - low) / (span if span > 0 else 1.0)


def interval_bar(
    low: float,
    best: float,
    high: float,
    columns: int,
    behind: tuple[float, float] | None = None,
) -> str:
    """Return an interval as a bar; all as shares of the width, arrows where it goes beyond.

    `behind` is a range to compare with. For example `  ├──●──┤ ░░░ `.
    """
    if columns < 1:
        return ""
    last = columns - 1

    def cell(share: float) -> int:
        return min(max(round(share * last), 0), last)

    cells = ["·"] * columns
    if behind is not None and behind[1] >= 0 and behind[0] <= 1:
        first, end = cell(behind[0]), cell(behind[1])
        cells[first : end + 1] = "░" * (end - first + 1)
    begin, end = cell(low), cell(high)
    cells[begin : end + 1] = "─" * (end - begin + 1)
    cells[begin] = "◄" if low < 0 else "├"
    cells[end] = "►" if high > 1 else "┤"
    cells[cell(best)] = "●"
    return "".join(cells)
