"""Cubic Lagrange interpolation on grids, as in the paper (end of section 2.3).

At each point the four nodes around it carry the cubic; near an end, the four nodes there. A little
outside the ends the end's cubic goes on; the caller decides how far that is allowed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]


def stencil(nodes: ArrayLike, at: ArrayLike) -> tuple[Index, Array]:
    """Return the first of the four nodes (n,) and their weights (n, 4) at points (n,).

    `nodes` ascend, four or more.
    """
    x = np.asarray(nodes, dtype=float)
    points = np.asarray(at, dtype=float)
    first = np.clip(np.searchsorted(x, points, side="right") - 2, 0, len(x) - 4)
    local = x[first[:, None] + np.arange(4)]
    distance = points[:, None] - local
    weights = np.empty_like(local)
    for k in range(4):
        others = [m for m in range(4) if m != k]
        weights[:, k] = np.prod(distance[:, others], axis=1) / np.prod(
            local[:, [k]] - local[:, others], axis=1
        )
    return first, weights


def matrix(nodes: ArrayLike, at: ArrayLike) -> Array:
    """Return the matrix (n, nodes) that interpolates from nodal values to points (n,)."""
    x = np.asarray(nodes, dtype=float)
    first, weights = stencil(x, at)
    full = np.zeros((len(first), len(x)))
    np.put_along_axis(full, first[:, None] + np.arange(4), weights, axis=1)
    return full


class TensorLagrange:
    """Vector values on a grid in three coordinates, interpolated at many points at once."""

    def __init__(self, axes: tuple[Array, Array, Array], values: Array) -> None:
        """`values` has the shape (n1, n2, n3, k)."""
        self._axes = axes
        self._shape = values.shape
        self._values = np.ascontiguousarray(values.reshape(-1, values.shape[-1]))

    def __call__(self, points: Array) -> Array:
        """Return the values (n, k) at points (n, 3)."""
        _, n2, n3, k = self._shape
        (i1, w1), (i2, w2), (i3, w3) = (
            stencil(axis, points[:, d]) for d, axis in enumerate(self._axes)
        )
        out = np.zeros((len(points), k))
        # 16 rows of four neighbours along the last axis: no (n, 64, k) array is ever made.
        for a in range(4):
            for b in range(4):
                base = ((i1 + a) * n2 + i2 + b) * n3 + i3
                row = np.zeros_like(out)
                for c in range(4):
                    row += w3[:, c, None] * self._values[base + c]
                out += (w1[:, a] * w2[:, b])[:, None] * row
        return out
