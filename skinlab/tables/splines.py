"""Cubic splines on evenly spaced nodes, as operators: they act on whole tables at once."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

Array = NDArray[np.float64]


@cache
def _knots_and_inverse(nodes: int) -> tuple[Array, Array]:
    spline = make_interp_spline(np.arange(nodes, dtype=float), np.eye(nodes), k=3)
    return spline.t, spline.c


def inverse(nodes: int) -> Array:
    """Return the matrix (n, n) from values at even nodes to B-spline coefficients."""
    return _knots_and_inverse(nodes)[1]


def knots(nodes: Array) -> Array:
    """Return the knots (n + 4,) of the not-a-knot cubic spline through even nodes (n,)."""
    step = (nodes[-1] - nodes[0]) / (len(nodes) - 1)
    return np.asarray(nodes[0] + step * _knots_and_inverse(len(nodes))[0])


def coefficients(values: Array, axis: int) -> Array:
    """Return the B-spline coefficients of nodal values along one axis; the shape stays."""
    inverse = _knots_and_inverse(values.shape[axis])[1]
    return np.moveaxis(np.tensordot(inverse, values, axes=(1, axis)), 0, axis)


def basis(nodes: Array, at: Array) -> Array:
    """Return the dense matrix (m, n) that takes coefficients to values at points (m,)."""
    t = knots(nodes)
    return np.asarray(BSpline.design_matrix(np.clip(at, t[0], t[-1]), t, 3).toarray())
