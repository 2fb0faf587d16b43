"""Cubic Lagrange interpolation on grids, as in the paper (end of section 2.3).

At each point the four nodes around it carry the cubic; near an end, the four nodes there. A little
outside the ends the end's cubic goes on; the caller decides how far that is allowed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_OTHERS = ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2))  # of four nodes, without the k-th


def stencil(nodes: ArrayLike, at: ArrayLike) -> tuple[Index, Array]:
    """Return the first of the four nodes (n,) and their weights (n, 4) at points (n,).

    `nodes` ascend, four or more.
    """
    x = np.asarray(nodes, dtype=float)
    points = np.asarray(at, dtype=float)
    first = np.minimum(np.maximum(np.searchsorted(x, points, side="right") - 2, 0), len(x) - 4)
    local = x[first[:, None] + np.arange(4)]
    distance = points[:, None] - local
    weights = np.empty_like(local)
    for k, (a, b, c) in enumerate(_OTHERS):
        apart = local[:, [k]] - local
        above = distance[:, a] * distance[:, b] * distance[:, c]
        weights[:, k] = above / (apart[:, a] * apart[:, b] * apart[:, c])
    return first, weights


def matrix(nodes: ArrayLike, at: ArrayLike) -> Array:
    """Return the matrix (n, nodes) that interpolates from nodal values to points (n,)."""
    x = np.asarray(nodes, dtype=float)
    first, weights = stencil(x, at)
    full = np.zeros((len(first), len(x)))
    np.put_along_axis(full, first[:, None] + np.arange(4), weights, axis=1)
    return full


class TensorLagrange:
    """Vector values on a grid, interpolated at many points at once."""

    def __init__(self, axes: tuple[Array, ...], values: Array) -> None:
        """`values` has the shape (n1, …, nd, k)."""
        self._axes = axes
        self._shape = values.shape[:-1]
        self._values = np.ascontiguousarray(values.reshape(-1, values.shape[-1]))

    def __call__(self, points: Array) -> Array:
        """Return the values (n, k) at points (n, d)."""
        count = len(points)
        if not count:
            return np.empty((0, self._values.shape[1]))
        rows, weights = np.zeros((count, 1), dtype=np.intp), np.ones((count, 1))
        for d, (axis, size) in enumerate(zip(self._axes, self._shape, strict=True)):
            first, weight = stencil(axis, points[:, d])
            at = first[:, None] + np.arange(4)
            rows = (rows[:, :, None] * size + at[:, None, :]).reshape(count, -1)
            weights = (weights[:, :, None] * weight[:, None, :]).reshape(count, -1)
        # A sparse matrix, 4^d nodes a point: no (n, 4^d, k) array is ever made, and a point's sum
        # does not depend on the others.
        ends = np.arange(0, weights.size + 1, weights.shape[1])
        shape = (count, len(self._values))
        from scipy.sparse import csr_array  # slow to import

        matrix = csr_array((weights.ravel(), rows.ravel(), ends), shape=shape)
        return np.asarray(matrix @ self._values)

    def slopes(self, points: Array) -> Array:
        """Return derivatives (n, d, k) by each coordinate, by central differences.

        Cubic Lagrange pieces meet with a kink at the nodes; next to one this is a mean.
        """
        steps = 1e-6 * np.array([axis[-1] - axis[0] for axis in self._axes])
        # In one call, which costs a single point hardly more than one of them.
        shifted = np.concatenate([points + sign * np.diag(steps)[:, None] for sign in (1, -1)])
        found = self(shifted.reshape(-1, len(steps)))
        both = found.reshape(2, len(steps), len(points), found.shape[1])
        return np.asarray(np.swapaxes(both[0] - both[1], 0, 1) / (2 * steps)[:, None])
