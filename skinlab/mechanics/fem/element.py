"""Quadrilaterals of second order: shape functions and quadrature.

Nodes 0–3 are the corners, counter-clockwise from (−1, −1); 4–7 the middles of the edges 0–1, 1–2,
2–3, 3–0; node 8, where there is one, the centre.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_MIDDLES = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])


@dataclass(frozen=True)
class Element:
    """An element type: number of nodes and Gauss points a direction.

    `dilatation_modes`: 0, every point has its own change of volume; 1 or 3, it is a constant or a
    linear function in the element, which removes the locking of nearly incompressible skin.
    """

    name: str
    nodes: int
    points_1d: int
    dilatation_modes: int = 0


QUAD8_REDUCED = Element("quad8-reduced", 8, 2)  # the paper's choice
QUAD8_FULL = Element("quad8-full", 8, 3)
QUAD9_FULL = Element("quad9-full", 9, 3)
# Biquadratic displacement, linear pressure: stable at any compressibility.
QUAD9_LINEAR_DILATATION = Element("quad9-linear-dilatation", 9, 3, dilatation_modes=3)
ELEMENTS = {e.name: e for e in (QUAD8_REDUCED, QUAD8_FULL, QUAD9_FULL, QUAD9_LINEAR_DILATATION)}


@cache
def quadrature(points_1d: int) -> tuple[Array, Array]:
    """Return Gauss points (n, 2) on [−1, 1]² and their weights (n,)."""
    x, w = np.polynomial.legendre.leggauss(points_1d)
    xi, eta = np.meshgrid(x, x, indexing="ij")
    return np.column_stack([xi.ravel(), eta.ravel()]), np.outer(w, w).ravel()


def dilatation_basis(modes: int, at: Array) -> Array:
    """Return the first `modes` of 1, ξ, η (n, modes) at points (n, 2)."""
    return np.column_stack([np.ones(len(at)), at])[:, :modes]


@cache
def shape_at_points(nodes: int, points_1d: int) -> tuple[Array, Array]:
    """Return `shape` at the points of `quadrature`."""
    return shape(nodes, quadrature(points_1d)[0])


def shape(nodes: int, at: Array) -> tuple[Array, Array]:
    """Return shape functions (n, nodes) and their derivatives (n, nodes, 2) at points (n, 2)."""
    return _serendipity(at) if nodes == 8 else _biquadratic(at)


def _serendipity(at: Array) -> tuple[Array, Array]:
    x, y = at[:, :1], at[:, 1:]
    xc, yc = _CORNERS.T
    corner = 0.25 * (1 + x * xc) * (1 + y * yc) * (x * xc + y * yc - 1)
    corner_x = 0.25 * xc * (1 + y * yc) * (2 * x * xc + y * yc)
    corner_y = 0.25 * yc * (1 + x * xc) * (x * xc + 2 * y * yc)
    middle = np.empty((len(at), 4))
    middle_x, middle_y = np.empty_like(middle), np.empty_like(middle)
    for k, (xm, ym) in enumerate(_MIDDLES):
        if xm == 0.0:
            middle[:, k] = (0.5 * (1 - x**2) * (1 + y * ym))[:, 0]
            middle_x[:, k] = (-x * (1 + y * ym))[:, 0]
            middle_y[:, k] = (0.5 * (1 - x**2) * ym)[:, 0]
        else:
            middle[:, k] = (0.5 * (1 - y**2) * (1 + x * xm))[:, 0]
            middle_x[:, k] = (0.5 * (1 - y**2) * xm)[:, 0]
            middle_y[:, k] = (-y * (1 + x * xm))[:, 0]
    values = np.hstack([corner, middle])
    return values, np.stack(
        [np.hstack([corner_x, middle_x]), np.hstack([corner_y, middle_y])], axis=-1
    )


def line_shape(at: Array) -> tuple[Array, Array]:
    """Return the quadratic line's shape functions (n, 3), derivatives (n, 3); ends, then middle."""
    values = np.column_stack([0.5 * at * (at - 1), 0.5 * at * (at + 1), 1 - at**2])
    slopes = np.column_stack([at - 0.5, at + 0.5, -2 * at])
    return values, slopes


def _biquadratic(at: Array) -> tuple[Array, Array]:
    nx, dx = line_shape(at[:, 0])
    ny, dy = line_shape(at[:, 1])
    # For each node: which of the three line functions it takes along ξ and η.
    i = [0, 1, 1, 0, 2, 1, 2, 0, 2]
    j = [0, 0, 1, 1, 0, 2, 1, 2, 2]
    return nx[:, i] * ny[:, j], np.stack([dx[:, i] * ny[:, j], nx[:, i] * dy[:, j]], axis=-1)
