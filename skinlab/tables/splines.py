"""B-splines as operators: they act on whole tables at once.

In numpy and the compiled kernel, not `scipy.interpolate`, which takes longer to import than a
curve takes to identify. Formulas: de Boor, A Practical Guide to Splines, chapters IX and X.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from skinlab.mechanics.fem import kernel

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_AT_ONCE = 512  # points, without the compiled kernel


def knots_through(nodes: Array, degree: int) -> Array:
    """Return the not-a-knot knots (n + degree + 1,) of the spline through nodes (n,).

    The degree is odd, or n − 1, where there is one polynomial and no inner knot.
    """
    n = len(nodes)
    inner = nodes[:0] if degree == n - 1 else nodes[(degree + 1) // 2 : n - (degree + 1) // 2]
    ends = np.repeat(nodes[[0, -1]], degree + 1).reshape(2, -1)
    return np.concatenate([ends[0], inner, ends[1]])


def local_basis(
    knots: Array, degree: int, at: Array, *, slope: bool = False
) -> tuple[Index, Array]:
    """Return the first of the B-splines that are not zero (m,) and their values (m, degree + 1).

    At points (m,) between the ends; beyond, the end's polynomials go on. With `slope`: derivatives.
    """
    n = len(knots) - degree - 1
    if slope and not degree:
        return np.zeros(len(at), dtype=np.intp), np.zeros((len(at), 1))
    piece = np.clip(np.searchsorted(knots, at, side="right") - 1, degree, n - 1)
    values = np.zeros((len(at), degree + 1))
    values[:, 0] = 1.0
    for k in range(1, degree + 1):
        last = slope and k == degree
        before, saved = values[:, :k].copy(), np.zeros(len(at))
        for i in range(k):
            right, left = knots[piece + i + 1], knots[piece + i + 1 - k]
            share = before[:, i] / (right - left)
            if last:
                values[:, i] = saved - k * share
                saved = k * share
            else:
                values[:, i] = saved + (right - at) * share
                saved = (at - left) * share
        values[:, k] = saved
    return piece - degree, values


def design(knots: Array, degree: int, at: Array) -> Array:
    """Return the dense matrix (m, n) that takes coefficients to values at points (m,)."""
    first, values = local_basis(knots, degree, at)
    matrix = np.zeros((len(at), len(knots) - degree - 1))
    np.put_along_axis(matrix, first[:, None] + np.arange(degree + 1), values, axis=1)
    return matrix


def inverse_of(nodes: Array, degree: int) -> Array:
    """Return the matrix (n, n) from values at nodes (n,) to coefficients."""
    return np.asarray(np.linalg.inv(design(knots_through(nodes, degree), degree, nodes)))


@cache
def _knots_and_inverse(nodes: int) -> tuple[Array, Array]:
    even = np.arange(nodes, dtype=float)
    return knots_through(even, 3), inverse_of(even, 3)


def inverse(nodes: int) -> Array:
    """Return the matrix (n, n) from values at even nodes to cubic B-spline coefficients."""
    return _knots_and_inverse(nodes)[1]


def knots(nodes: Array) -> Array:
    """Return the knots (n + 4,) of the not-a-knot cubic spline through even nodes (n,)."""
    step = (nodes[-1] - nodes[0]) / (len(nodes) - 1)
    return np.asarray(nodes[0] + step * _knots_and_inverse(len(nodes))[0])


def coefficients(values: Array, axis: int) -> Array:
    """Return the B-spline coefficients of nodal values along one axis; the shape stays."""
    return along(inverse(values.shape[axis]), values, axis)


def along(matrix: Array, values: Array, axis: int) -> Array:
    """Return values with a square matrix applied along one axis."""
    shape = values.shape
    rows = values.reshape(-1, shape[axis], math.prod(shape[axis + 1 :]))
    return np.asarray(matrix @ rows).reshape(shape)


def basis(nodes: Array, at: Array) -> Array:
    """Return the dense matrix (m, n) that takes coefficients to values at points (m,)."""
    t = knots(nodes)
    return design(t, 3, np.clip(at, t[0], t[-1]))


class TensorBSpline:
    """Vector-valued splines along all axes of a grid."""

    def __init__(self, knots: Sequence[Array], degrees: Sequence[int], values: Array) -> None:
        """`values` (n1, …, nd, k) are the coefficients."""
        self._axes = list(zip(knots, degrees, values.shape[:-1], strict=True))
        self._values = np.ascontiguousarray(values.reshape(-1, values.shape[-1]))
        sizes = np.array(values.shape[:-1], dtype=np.intp)
        self._compiled = kernel.Spline(
            np.concatenate(knots), sizes, np.array(degrees, dtype=np.intp), self._values
        )

    def __call__(self, points: Array) -> Array:
        """Return the values (m, k) at points (m, d)."""
        found = self._compiled(points, slopes=False)
        return self._values_or_slope(points) if found is None else found

    def slopes(self, points: Array) -> Array:
        """Return the derivatives (m, d, k) by each coordinate at points (m, d)."""
        found = self._compiled(points, slopes=True)
        if found is not None:
            return found
        each = [self._values_or_slope(points, slope=d) for d in range(len(self._axes))]
        return np.stack(each, axis=1)

    def _values_or_slope(self, points: Array, slope: int = -1) -> Array:
        if len(points) > _AT_ONCE:
            parts = np.array_split(points, -(-len(points) // _AT_ONCE))
            return np.concatenate([self._values_or_slope(part, slope) for part in parts])
        rows, weights = np.zeros(len(points), dtype=np.intp), []
        stride = len(self._values)
        for d, (t, degree, size) in enumerate(self._axes):
            stride //= size
            first, values = local_basis(t, degree, points[:, d], slope=d == slope)
            rows = (rows.T + first * stride).T[..., None] + stride * np.arange(degree + 1)
            weights.append(values)
        around = self._values[rows]
        for each in reversed(weights):
            around = np.einsum("n...wk,nw->n...k", around, each)
        return np.asarray(around)
