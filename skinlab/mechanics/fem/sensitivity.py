"""How a curve changes with its parameters, by direct differentiation.

At equilibrium the residual vanishes, R(u, θ) = 0, so that K du/dθ = −∂R/∂θ, with K the tangent
whose factor Newton's method has left. Of u the apex alone is asked for, eᵀu: its derivatives by all
parameters are −λᵀ ∂R/∂θ with one λ, of Kᵀ λ = e (the adjoint). ∂R/∂θ at the same u is a central
difference of residuals, which is exact to round-off where the energy is linear in θ, and costs no
solution. A parameter may move the mesh: the unknowns are displacements of its nodes, of which there
are as many. Where all of them move it at the tape's edge, what that does is found once.

Source: Kleiber, Antúnez, Hien and Kowalczyk, Parameter Sensitivity in Nonlinear Mechanics (1997).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinlab.errors import InputError
from skinlab.mechanics.fem.newton import Point, StepSettings, solve_linear
from skinlab.mechanics.fem.skin import Prepared, SkinProblem, edge_of, prepare
from skinlab.mechanics.fem.suction import (
    EXTENSION_ABOVE,
    MBAR,
    MESH_OF_RECORD,
    Discretisation,
    SuctionCurve,
    trace,
)

Array = NDArray[np.float64]

_EDGE_STEP = 1e-4  # of the elements' size at the tape's edge

Change = tuple[SkinProblem, SkinProblem, float]
"""The problem with a parameter a little higher and a little lower, and by how much they differ."""


@dataclass(frozen=True)
class Slopes:
    """Derivatives (k, points) of the deflection, mm per unit of each of k parameters.

    NaN where a change has no state, and beyond where the curve holds.
    """

    pressure_mbar: Array
    by_parameter: Array

    def __call__(self, pressure_mbar: ArrayLike) -> Array:
        """Return the derivatives (k, n) at pressures (n,), a thousandth off at most."""
        from scipy.interpolate import make_interp_spline  # slow to import

        at, known = np.asarray(pressure_mbar, dtype=float), self.pressure_mbar
        if len(known) < 2:
            return np.full((len(self.by_parameter), len(at)), np.nan)
        there = np.isfinite(self.by_parameter).all(axis=1)
        found = np.full((len(self.by_parameter), len(at)), np.nan)
        spline = make_interp_spline(known, self.by_parameter[there].T, k=min(3, len(known) - 1))
        found[there] = spline(at).T
        return np.where(at <= known[-1] * (1 + EXTENSION_ABOVE) + 1e-9, found, np.nan)


def solve_with_slopes(
    problem: SkinProblem,
    changes: Sequence[Change],
    goal_mbar: float,
    discretisation: Discretisation = MESH_OF_RECORD,
    settings: StepSettings | None = None,
) -> tuple[SuctionCurve, Slopes]:
    """Return the elastic curve from 0 to `goal_mbar`, and how it changes.

    Memory, and the preload, are left out: these are the caller's.

    Raises:
        InputError: a change alters the number of nodes.
    """
    prepared = prepare(problem, discretisation)
    assembly, apex = prepared.assembly, prepared.apex
    edge = edge_of(problem, discretisation)
    edges = np.array([[edge_of(end, discretisation) for end in change[:2]] for change in changes])
    moved = [
        (prepare(up, discretisation, edge), prepare(down, discretisation, edge))
        for up, down, _ in changes
    ]
    steps = np.array([step for *_, step in changes])
    shifts = (edges[:, 0] - edges[:, 1]) / (2.0 * _EDGE_STEP * edge) if changes else np.zeros(0)
    if shifts.any():
        longer, shorter = (1.0 + _EDGE_STEP) * edge, (1.0 - _EDGE_STEP) * edge
        ends = prepare(problem, discretisation, longer), prepare(problem, discretisation, shorter)
        moved.append(ends)
    for up, down in moved:
        if (up.assembly.n, down.assembly.n) != (assembly.n, assembly.n):
            raise InputError("a change of the mesh's topology has no derivative")
    residuals = _Residuals(prepared, moved)
    by_apex = np.zeros(assembly.n)
    by_apex[apex] = 1.0
    columns: list[Array] = []
    at: list[float] = []

    def look(pressure_mpa: float, point: Point) -> None:
        # The tangent's skew part is proportional to the pressure: with −p it is transposed.
        adjoint = solve_linear(point.factor, point.state, -pressure_mpa, by_apex)
        rise = residuals.rises(point.unknowns, adjoint, pressure_mpa)
        if len(moved) > len(changes):
            rise = rise[:-1] + np.where(shifts, shifts * rise[-1], 0.0)
        columns.append(-rise / steps)
        at.append(pressure_mpa / MBAR)

    curve = trace(
        assembly, apex, prepared.parameters(), goal_mbar, problem.geometry.radius_mm, settings,
        look=look if changes else None,
    )  # fmt: skip
    return curve, Slopes(np.array(at), np.array(columns).T.reshape(len(changes), len(columns)))


class _Residuals:
    """By how much residuals differ between the two problems of each pair, at the same unknowns."""

    def __init__(self, prepared: Prepared, pairs: Sequence[tuple[Prepared, Prepared]]) -> None:
        self._assembly = assembly = prepared.assembly
        self._count = len(pairs)
        # Where the law alone changes, one pass through the mesh serves all.
        self._in_law = [
            i for i, pair in enumerate(pairs) if all(each.assembly is assembly for each in pair)
        ]
        self._by_law = prepared.body.rises(
            [(pairs[i][0].parameters(), pairs[i][1].parameters()) for i in self._in_law],
            at_once=assembly.compiled,
        )
        self._in_mesh = {
            i: [(each.assembly, [[(1.0, each.parameters())]]) for each in pair]
            for i, pair in enumerate(pairs)
            if i not in self._in_law
        }

    def rises(self, unknowns: Array, along: Array, pressure_mpa: float) -> Array:
        """Return the differences (pairs,) times a vector (n,); NaN where there is no state."""
        rise = np.full(self._count, np.nan)
        if self._in_law:
            of_law = self._assembly.virtual_work(unknowns, along, 0.0, self._by_law)
            if of_law is not None:
                rise[self._in_law] = of_law
        for i, pair in self._in_mesh.items():
            up, down = (
                other.virtual_work(unknowns, along, pressure_mpa, energy) for other, energy in pair
            )
            if up is not None and down is not None:
                rise[i] = (up - down)[0]
        return rise
