"""Fill a table where its entries do not hold, so that splines through it stay smooth where they do.

None of these values is ever an answer. But a cubic spline feels its neighbours, a quarter as much
with each node further away, and a cell whose corners all hold needs something smooth beyond them.
Stiffer skins hold further: from where a row ends, it goes on by the increments of its stiffer
neighbours, extrapolated linearly to it. Where there is no neighbour it goes on straight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def supported(values: Array, load_nodes: Array) -> Array:
    """Return the table (h/R, X2/X1, κ/X1, load) with its NaNs filled.

    Every row is finite on one stretch of two nodes or more, about zero load.
    """
    filled = values.copy()
    _, n_ratio, n_kappa, _ = values.shape
    for plane in filled:
        for j in range(n_ratio - 1, -1, -1):
            for k in range(n_kappa - 1, -1, -1):
                if j + 1 < n_ratio:
                    stiffer = plane[j + 1, k], plane[min(j + 2, n_ratio - 1), k]
                elif k + 1 < n_kappa:
                    stiffer = plane[j, k + 1], plane[j, min(k + 2, n_kappa - 1)]
                else:
                    stiffer = None
                _continue(plane[j, k], stiffer, load_nodes)
    return filled


def _continue(row: Array, stiffer: tuple[Array, Array] | None, nodes: Array) -> None:
    held = np.flatnonzero(np.isfinite(row))
    first, last = int(held[0]), int(held[-1])
    below, above = slice(0, first), slice(last + 1, None)
    slope = (row[first + 1] - row[first]) / (nodes[first + 1] - nodes[first])
    row[below] = row[first] + slope * (nodes[below] - nodes[first])
    if stiffer is None:
        slope = (row[last] - row[last - 1]) / (nodes[last] - nodes[last - 1])
        row[above] = row[last] + slope * (nodes[above] - nodes[last])
    else:
        one, two = stiffer
        row[above] = row[last] + 2 * (one[above] - one[last]) - (two[above] - two[last])
