"""Cubic Lagrange interpolation on grids, as in the paper (end of section 2.3).

At each point the four nodes around it carry the cubic; near an end, the four nodes there. A little
outside the ends the end's cubic goes on; the caller decides how far that is allowed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

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
        _, n2, n3, _ = self._shape
        (i1, w1), (i2, w2), (i3, w3) = (
            stencil(axis, points[:, d]) for d, axis in enumerate(self._axes)
        )
        four = np.arange(4)
        first, second, third = ((i[:, None] + four) for i in (i1, i2, i3))
        plane = first[:, :, None] * n2 + second[:, None, :]
        rows = plane[..., None] * n3 + third[:, None, None, :]  # (n, 4, 4, 4)
        weights = (w1[:, :, None] * w2[:, None, :])[..., None] * w3[:, None, None, :]
        # A sparse matrix, 64 nodes a point: no (n, 64, k) array is ever made, and a point's sum
        # does not depend on the others.
        ends = np.arange(0, weights.size + 1, 64)
        shape = (len(points), len(self._values))
        matrix = csr_array((weights.ravel(), rows.ravel(), ends), shape=shape)
        return np.asarray(matrix @ self._values)
