"""The suction test: geometry, mesh of record, and the curve that the finite elements give.

Axisymmetric, quasi-static, finite strain. Tape: the top surface is held for r ≥ R. The bottom is
free. The outer edge (r_out = 3R, or R + 6h where that is more) slides on a wall. Suction is a
follower pressure on the deformed top surface r < R.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinlab.errors import InputError
from skinlab.mechanics.fem.element import (
    QUAD8_FULL,
    QUAD9_FULL,
    QUAD9_LINEAR_DILATATION,
    Element,
)
from skinlab.mechanics.fem.hermite import CubicHermite
from skinlab.mechanics.fem.mesh import Grading, Mesh, suction_mesh
from skinlab.mechanics.materials import DEFAULT_LAW, get_law

if TYPE_CHECKING:
    from skinlab.mechanics.fem.assembly import Assembly
    from skinlab.mechanics.fem.newton import EquilibriumPath, Look, StepSettings

Array = NDArray[np.float64]

MBAR = 1e-4  # MPa

# How sharp an opening's edge can be: what counts as sharp in workshops (ISO 13715: ± 0.05 mm), and
# about the thickness of a tape's adhesive. docs/decisions/0023-the-rim-has-a-length.md
RIM_MM = 0.05

SOLVER_VERSION = "4"  # raise it whenever a curve changes by more than round-off

# Below zero and above the programmed maximum a noisy pressure channel still has a model.
EXTENSION_BELOW_MBAR = 2.0
EXTENSION_ABOVE = 0.02


@dataclass(frozen=True)
class Geometry:
    """What is measured: opening diameter and skin thickness, mm."""

    aperture_mm: float
    thickness_mm: float

    def __post_init__(self) -> None:
        """Refuse what is no length."""
        for name, value in (("aperture_mm", self.aperture_mm), ("thickness_mm", self.thickness_mm)):
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"{name} must be a positive number of mm, got {value}")

    @property
    def radius_mm(self) -> float:
        """Radius of the opening."""
        return 0.5 * self.aperture_mm

    @property
    def outer_radius_mm(self) -> float:
        """Where the model ends: beyond it the apex no longer notices (0.1 µm)."""
        return max(3 * self.radius_mm, self.radius_mm + 6 * self.thickness_mm)


@dataclass(frozen=True)
class Discretisation:
    """A recipe for meshes: sizes as fractions of the opening's radius.

    Except `outside`, of the taped width r_out − R, and `through`, of the thickness.

    All sizes scale with the geometry, so that w/R depends on h/R and the law's ratios alone.
    """

    name: str
    element: Element
    edge: float
    ratio: float
    inside: float
    outside: float
    through: float
    quarter_point: bool = False
    counts: tuple[int, int, int] | None = None  # elements inside, outside, through; see `Grading`

    def edge_mm(
        self, geometry: Geometry, above_mm: tuple[float, ...] = (), rim_mm: float = 0.0
    ) -> float:
        """Return the size of the elements at the tape's edge.

        Under thin layers, `above_mm` thick, it is no shorter than `rim_mm`.
        """
        edge = self.edge * geometry.radius_mm
        if above_mm:  # a stiff layer bends at the edge within about its own thickness
            edge = min(edge, max(0.25 * edge, min(above_mm)))
            if self.quarter_point:  # other elements are for comparisons in a sharp edge's limit
                edge = max(edge, rim_mm)
        return edge

    def mesh(
        self,
        geometry: Geometry,
        slip_mm: float = 0.0,
        above_mm: tuple[float, ...] = (),
        below_mm: tuple[float, ...] = (),
        edge_mm: float | None = None,
    ) -> Mesh:
        """Return the mesh for this geometry.

        The tape holds from R + `slip_mm` on; `above_mm` and `below_mm` are the thicknesses of
        layers inside the skin, from its top down, and of layers under it; `edge_mm` is the size of
        the elements at the edge, by itself that without layers.
        """
        r, counts = geometry.radius_mm, self.counts
        if above_mm:
            counts = counts and (counts[0] + 2, counts[1] + 1, counts[2])
        grading = Grading(
            edge=self.edge_mm(geometry, above_mm) if edge_mm is None else edge_mm,
            ratio=self.ratio,
            inside=self.inside * r,
            outside=self.outside * (geometry.outer_radius_mm - r),
            through=self.through * geometry.thickness_mm,
            quarter_point=self.quarter_point,
            counts=counts,
        )
        return suction_mesh(
            r,
            geometry.thickness_mm,
            geometry.outer_radius_mm,
            grading,
            self.element.nodes,
            r + slip_mm,
            above_mm,
            below_mm,
        )


# Why these numbers: docs/decisions/0003-mesh-of-record.md
MESH_OF_RECORD = Discretisation(
    "record-2", QUAD8_FULL, 1 / 60, 2.0, 0.15, 0.4, 0.35, quarter_point=True, counts=(10, 9, 8)
)
# The same mesh with elements that cannot lock: a cross-check for nearly incompressible skin.
LINEAR_DILATATION_MESH = replace(
    MESH_OF_RECORD, name="record-2-linear-dilatation", element=QUAD9_LINEAR_DILATATION
)
# In 40 % of the time, for what is looked at by differences: what an effect does to the dome is off
# by 0.1 to 1 % (docs/effects.md).
SCREENING_MESH = replace(
    MESH_OF_RECORD, name="screening-1", edge=1 / 40, inside=0.3, outside=0.6, through=0.5,
    counts=(6, 5, 4),
)  # fmt: skip
# Ever blunter edges, at one of which a soft surface does not crease: what goes on where the mesh of
# record ends (docs/decisions/0022-going-on-near-creases.md).
BLUNT_MESHES = tuple(
    replace(
        MESH_OF_RECORD, name=f"blunt-{1 / edge:g}", edge=edge, inside=max(edge, 0.15), counts=None,
        quarter_point=False,
    )
    for edge in (1 / 20, 1 / 10, 1 / 5)
)  # fmt: skip
# For comparison with other programs: plain 9-node elements, 0.02 mm at the edge of a 6 mm opening.
VERIFICATION_MESH = Discretisation("verification-2", QUAD9_FULL, 0.02 / 3, 1.25, 0.1, 0.1, 0.2)


@dataclass(frozen=True)
class SuctionCurve:
    """Apex deflection against suction, as cubic Hermite pieces between converged points.

    Every point is converged and admissible (see `admissibility.py`); there is none beyond
    `holds_to_mbar`, and the deflection there is NaN.
    """

    pressure_mbar: Array  # (k,), from 0, or from a little below
    deflection_mm: Array  # (k,)
    slope_mm_per_mbar: Array  # (k,)
    holds_to_mbar: float  # the goal, or the last pressure that converged and is admissible
    stopped: str  # why it does not reach the goal; empty where it does
    iterations: int
    path: EquilibriumPath

    def __call__(self, pressure_mbar: ArrayLike) -> Array:
        """Return deflection (mm) at these pressures; NaN where the curve does not hold.

        A little beyond both ends (2 mbar below zero, 2 % above the top) the end pieces go on.
        """
        p = np.asarray(pressure_mbar, dtype=float)
        if len(self.pressure_mbar) < 2:
            return np.full(p.shape, np.nan)
        top = self.holds_to_mbar * (1 + (EXTENSION_ABOVE if not self.stopped else 0.0))
        inside = (p >= -EXTENSION_BELOW_MBAR - 1e-9) & (p <= top + 1e-9)
        return np.where(inside, self.spline(p), np.nan)

    @property
    def spline(self) -> CubicHermite:
        """The curve as a function of pressure (mbar) that does not ask whether it holds."""
        return CubicHermite(self.pressure_mbar, self.deflection_mm, self.slope_mm_per_mbar)


@lru_cache(maxsize=16)
def assembly_for(
    geometry: Geometry, discretisation: Discretisation, law_name: str
) -> tuple[Assembly, int]:
    """Return the prepared problem and the unknown that is the apex deflection."""
    from skinlab.mechanics.fem.assembly import Assembly  # tables are asked without

    mesh = discretisation.mesh(geometry)
    assembly = Assembly(mesh, discretisation.element, get_law(law_name), mesh.held)
    return assembly, int(assembly.equation[2 * mesh.apex + 1])


def solve(
    geometry: Geometry,
    parameters: Mapping[str, float],
    goal_mbar: float,
    *,
    law: str = DEFAULT_LAW,
    discretisation: Discretisation = MESH_OF_RECORD,
    settings: StepSettings | None = None,
    below_mbar: float = 0.0,
    after: SuctionCurve | None = None,
) -> SuctionCurve:
    """Return the curve from 0 to `goal_mbar`, or as far as the model holds.

    With `below_mbar` it starts that far below zero, where the probe would blow. `after` is a curve
    of the same skin that reached a smaller goal: this one goes on from its end.
    `parameters` are what the law's potential asks for: its `parameter_names`.

    Raises:
        InputError: a parameter or the pressure is out of its physical range.
    """
    if not (math.isfinite(goal_mbar) and goal_mbar > 0):
        raise InputError(f"pressure_mbar must be a positive number of mbar, got {goal_mbar}")
    assembly, apex = assembly_for(geometry, discretisation, law)
    its_law = get_law(law)
    least = {p.name: p.low for p in its_law.parameters}
    for name in its_law.parameter_names:
        value, low = parameters[name], least.get(name, 1.0)  # κ is positive
        if not math.isfinite(value) or (low >= 0 > value) or (low > 0 and value == 0):
            raise InputError(f"{name} must be a positive number, got {value}")
    return trace(
        assembly, apex, parameters, goal_mbar, geometry.radius_mm, settings,
        below_mbar=below_mbar, after=after,
    )  # fmt: skip


def trace(
    assembly: Assembly,
    apex: int,
    parameters: Mapping[str, Any],
    goal_mbar: float,
    scale_mm: float,
    settings: StepSettings | None = None,
    *,
    below_mbar: float = 0.0,
    look: Look | None = None,
    after: SuctionCurve | None = None,
) -> SuctionCurve:
    """Return the curve of this unknown, the apex, from `-below_mbar` to `goal_mbar`.

    `look`, and the path of `after`: see `newton.follow`.
    """
    from skinlab.mechanics.fem.newton import follow

    before = None if after is None else after.path
    path = follow(assembly, goal_mbar * MBAR, parameters, scale_mm, settings, apex, look, before)
    pressures = [p / MBAR for p in path.pressure_mpa]
    displacements, slopes = list(path.displacements), list(path.slopes)
    holds_to = goal_mbar if not path.stopped else pressures[-1] if pressures else 0.0
    if below_mbar > 0:
        below = follow(assembly, -below_mbar * MBAR, parameters, scale_mm, settings, watch=apex)
        pressures[:0] = [p / MBAR for p in below.pressure_mpa[:0:-1]]
        displacements[:0] = below.displacements[:0:-1]
        slopes[:0] = below.slopes[:0:-1]
    return SuctionCurve(
        pressure_mbar=np.array(pressures),
        deflection_mm=np.array([u[apex] for u in displacements]),
        slope_mm_per_mbar=np.array([s[apex] for s in slopes]) * MBAR,
        holds_to_mbar=holds_to,
        stopped=path.stopped,
        iterations=path.iterations,
        path=path,
    )
