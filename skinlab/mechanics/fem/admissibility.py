"""May a converged state be believed? What the equations do not say by themselves.

The energy has no barrier against J → 0 and the strain at the tape's edge is singular: with rising
suction a soft skin creases there. The equations go on beyond it, with the surface folded into the
skin under the tape, but that branch is not physical and depends on the mesh. Each check below
answers with a short phrase, or with nothing where all is well. What was measured to choose them,
and what they miss: docs/verification.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.mechanics.fem.assembly import Assembly, State

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Limits:
    """What a state has to keep to."""

    j_min: float = 0.1  # det F at every quadrature point
    j_max: float = 3.0
    tilt_deg: float = 135.0  # a chord of the free surface may have turned by this much
    surface_stretch: float = 0.05  # shortest chord against its length at rest
    elliptic: bool = True  # the material, at every quadrature point


DEFAULT_LIMITS = Limits()
NO_LIMITS = Limits(0.0, np.inf, np.inf, 0.0, elliptic=False)
FOLDED = Limits(0.02, np.inf, np.inf, 0.0, elliptic=False)  # nothing is turned inside out


def fault(assembly: Assembly, unknowns: Array, state: State, limits: Limits) -> str:
    """Return why this state is not admissible, in a short phrase; empty where it is."""
    if limits.tilt_deg < 180.0 or limits.surface_stretch > 0.0:
        tilt, stretch = surface(assembly, unknowns)
        if tilt > limits.tilt_deg:
            return "the surface folds over at the tape's edge"
        if stretch < limits.surface_stretch:
            return "the surface creases at the tape's edge"
    if not (limits.j_min <= state.j_min and state.j_max <= limits.j_max):
        return "the change of volume is out of bounds"
    if limits.elliptic and not state.least_acoustic() > 0.0:
        return "the material loses ellipticity"
    return ""


def surface(assembly: Assembly, unknowns: Array) -> tuple[float, float]:
    """Return the largest turn (degrees) and the smallest stretch of the free surface's chords.

    Chords, from node to node, rather than tangents: at the edge itself the tangent is singular and
    turns by more than 90° at the smallest pressure, and beyond 180° in good curves.
    """
    nodes = assembly.mesh.free_surface
    at_rest = assembly.mesh.nodes[nodes]
    chords = np.diff(at_rest + assembly.full(unknowns).reshape(-1, 2)[nodes], axis=0)
    before = np.diff(at_rest, axis=0)
    length, length_before = np.hypot(*chords.T), np.hypot(*before.T)
    cosine = (chords * before).sum(axis=1) / np.maximum(length * length_before, 1e-300)
    tilt = float(np.degrees(np.arccos(np.clip(cosine.min(initial=1.0), -1.0, 1.0))))
    return tilt, float((length / length_before).min(initial=np.inf))
