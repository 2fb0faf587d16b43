"""Meshes of the skin's cross-section: a grid of quadrilaterals, graded to the tape's edge."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from skinlab.mechanics.fem.roots import brentq

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True)
class Mesh:
    """Nodes and elements, with what the suction problem needs to find on them.

    `nodes` (n, 2) are (r, z) in mm, numbered column by column so that the band is narrow;
    `elements` (m, 8 or 9) in the order of `element.py`; `loaded_edges` (k, 3) are the edges on the
    top surface inside the opening, from the axis outwards: inner end, outer end, middle; the
    pressure acts on them for r < `loaded_to_mm`, which may lie within the last;
    `layer` (m,) tells which layer an element belongs to, counted from the top.
    """

    nodes: Array
    elements: Index
    loaded_edges: Index
    apex: int
    axis: Index
    tape: Index  # nodes of the top surface with r ≥ R
    outer: Index  # nodes at r = r_out
    bottom: Index
    layer: Index
    loaded_to_mm: float

    @cached_property
    def held(self) -> Index:
        """Displacements that are zero: r at axis and wall, both under the tape; 2 i is r of i."""
        parts = [2 * self.axis, 2 * self.tape, 2 * self.tape + 1, 2 * self.outer]
        return np.asarray(np.unique(np.concatenate(parts)), dtype=np.intp)

    @cached_property
    def free_surface(self) -> Index:
        """Nodes of the top surface from the apex to where the tape holds, in order."""
        on_top = np.flatnonzero(self.nodes[:, 1] == self.nodes[self.apex, 1])
        r = self.nodes[:, 0]
        free = on_top[r[on_top] <= r[self.tape].min(initial=np.inf)]
        return np.asarray(free[np.argsort(r[free])], dtype=np.intp)


@dataclass(frozen=True)
class Grading:
    """How fine: everything in mm, for an opening of radius R on a skin of thickness h."""

    edge: float  # size of the elements at the tape's edge
    ratio: float  # from one element to the next
    inside: float  # largest size under the opening
    outside: float  # largest size under the tape
    through: float  # largest size through the thickness
    quarter_point: bool = False  # see `_to_quarter_points`
    counts: tuple[int, int, int] | None = None  # elements inside, outside and through, if fixed


def graded_sizes(
    length: float, first: float, ratio: float, largest: float, count: int | None = None
) -> Array:
    """Return sizes that start at `first`, grow by about `ratio` up to `largest`, and fill `length`.

    The ratio is lowered a little where the sizes would not fit exactly; `first` is kept. With
    `count` there are that many, and the ratio is whatever fits: the sizes then change continuously
    with the length.
    """
    if count is not None:
        return _counted_sizes(length, first, largest, count)
    if first >= largest or first >= length:
        n = max(1, math.ceil(length / largest - 1e-9))
        return np.full(n, length / n)

    def sizes(q: float, n: int) -> Array:
        return np.asarray(np.minimum(first * q ** np.arange(n), largest))

    n = 1
    while sizes(ratio, n).sum() < length - 1e-12:
        n += 1
    low = 1.0
    if sizes(low, n).sum() >= length:  # `first` alone fills it
        return np.full(n, length / n)
    q = brentq(lambda q: float(sizes(q, n).sum()) - length, low, ratio, xtol=1e-14)
    return sizes(q, n)


ROWS_ABOVE = 2  # of elements, in each thin layer on top
ROWS_BELOW = 6  # in each layer under the skin: four were 0.4 % too stiff where it is 20 mm thick
_STEEPEST = 20.0  # ratio from one element to the next


@lru_cache(maxsize=64)  # meshes of which one length differs follow one another
def _counted_sizes(length: float, first: float, largest: float, count: int) -> Array:
    if count * first >= length:
        return np.full(count, length / count)
    largest = max(largest, length / count)

    def excess(q: float) -> float:
        size, total = first, 0.0
        for _ in range(count):
            total += size if size < largest else largest
            size *= q
        return total - length

    if excess(_STEEPEST) <= 0:  # the cap is too low for so few elements: even sizes but the first
        return np.concatenate([[first], np.full(count - 1, (length - first) / (count - 1))])
    q = brentq(excess, 1.0, _STEEPEST, xtol=1e-14)
    return np.asarray(np.minimum(first * q ** np.arange(count), largest))


def suction_mesh(
    radius_mm: float,
    thickness_mm: float,
    outer_radius_mm: float,
    grading: Grading,
    nodes_per_element: int = 8,
    held_from_mm: float | None = None,
    above_mm: tuple[float, ...] = (),
    below_mm: tuple[float, ...] = (),
) -> Mesh:
    """Return the mesh of a skin 0 ≤ r ≤ r_out, −h ≤ z ≤ 0, graded to where the tape starts to hold.

    That is r = `held_from_mm` (default: R). Where it is beyond R, the elements are those of an
    opening that large, loaded up to R only: the mesh changes continuously with it.
    `above_mm` are the thicknesses of layers inside the skin, from its top down; `below_mm` those of
    layers under it.
    """
    held = radius_mm if held_from_mm is None else held_from_mm
    g = grading
    n_inside, n_outside, n_through = g.counts or (None, None, None)
    inside = graded_sizes(held, g.edge, g.ratio, g.inside, n_inside)[::-1]
    outside = graded_sizes(outer_radius_mm - held, g.edge, g.ratio, g.outside, n_outside)
    r_lines = np.concatenate([[0.0], np.cumsum(np.concatenate([inside, outside]))])
    r_lines[len(inside)] = held
    skin_mm = thickness_mm - sum(above_mm)
    skin = graded_sizes(skin_mm, g.edge, g.ratio, g.through, n_through)
    layers = [
        *(np.full(ROWS_ABOVE, t / ROWS_ABOVE) for t in above_mm),
        skin,
        *(graded_sizes(t, skin[-1], 2.0, 0.5 * t, ROWS_BELOW) for t in below_mm),
    ]
    z_lines = np.concatenate([[0.0], -np.cumsum(np.concatenate(layers))])[::-1].copy()
    if not below_mm:
        z_lines[0] = -thickness_mm
    layer_of_row = np.repeat(np.arange(len(layers)), [len(sizes) for sizes in layers])[::-1]
    mesh = grid_mesh(r_lines, z_lines, radius_mm, held, nodes_per_element, layer_of_row)
    if g.quarter_point:
        _to_quarter_points(mesh, rim=int(mesh.tape[0]))
    return mesh


def grid_mesh(
    r_lines: Array,
    z_lines: Array,
    radius_mm: float,
    held_mm: float,
    nodes_per_element: int,
    layer_of_row: Index | None = None,
) -> Mesh:
    """Return the mesh with these grid lines (ascending, mm); the top is the last z line.

    `layer_of_row` (rows,), from the bottom up, is the layer of each row of elements.
    """
    nr, nz = len(r_lines) - 1, len(z_lines) - 1
    r_fine = _with_middles(r_lines)
    z_fine = _with_middles(z_lines)
    number, elements, grid_i, grid_j = _numbered(nr, nz, nodes_per_element)
    top = number[:, -1]
    tolerance = 1e-9 * max(radius_mm, 1.0)
    edges = np.column_stack([top[0:-2:2], top[2::2], top[1::2]])
    inside = r_lines[:-1] < radius_mm - tolerance
    rows = np.zeros(nz, dtype=np.intp) if layer_of_row is None else layer_of_row
    return Mesh(
        nodes=np.column_stack([r_fine[grid_i], z_fine[grid_j]]),
        elements=elements,
        loaded_edges=edges[inside],
        apex=int(top[0]),
        axis=_present(number[0]),
        tape=_present(top[r_fine >= held_mm - tolerance]),
        outer=_present(number[-1]),
        bottom=_present(number[:, 0]),
        layer=np.tile(rows, nr),
        loaded_to_mm=radius_mm,
    )


@lru_cache(maxsize=16)
def _numbered(nr: int, nz: int, nodes_per_element: int) -> tuple[Index, Index, Index, Index]:
    """Return the number of each node of the refined grid, the elements, and each node's place.

    Column by column; 8-node elements skip the centres, which are −1.
    """
    number = np.full((2 * nr + 1, 2 * nz + 1), -1, dtype=np.intp)
    used = np.ones_like(number, dtype=bool)
    if nodes_per_element == 8:
        used[1::2, 1::2] = False
    number[used] = np.arange(int(used.sum()))
    i = np.repeat(2 * np.arange(nr), nz)
    j = np.tile(2 * np.arange(nz), nr)
    offsets = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1)]
    elements = np.column_stack([number[i + a, j + b] for a, b in offsets[:nodes_per_element]])
    grid_i, grid_j = np.nonzero(used)
    return number, elements, grid_i, grid_j


def _to_quarter_points(mesh: Mesh, rim: int) -> None:
    """Move the middle nodes next to the rim to a quarter of their edges.

    Where a held surface meets a free one the displacement goes like the square root of the
    distance and the strain is singular. With its middle nodes at the quarter points a quadratic
    element holds exactly that root (Henshell and Shaw 1975, Barsoum 1976), so that a coarse edge
    is accurate.
    """
    for element in mesh.elements[(mesh.elements[:, :4] == rim).any(axis=1)]:
        for k in np.flatnonzero(element[:4] == rim):
            for middle, other in (
                (element[4 + k], element[(k + 1) % 4]),
                (element[4 + (k - 1) % 4], element[(k - 1) % 4]),
            ):
                mesh.nodes[middle] = 0.75 * mesh.nodes[rim] + 0.25 * mesh.nodes[other]


def _with_middles(lines: Array) -> Array:
    fine = np.empty(2 * len(lines) - 1)
    fine[::2] = lines
    fine[1::2] = 0.5 * (lines[1:] + lines[:-1])
    return fine


def _present(numbers: Index) -> Index:
    return numbers[numbers >= 0]
