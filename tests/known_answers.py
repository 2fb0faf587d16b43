"""Problems whose answers are known: what the tests and docs/verification.md measure the solver by.

Each builder returns a Problem ready for `deflection`; beside it stands the answer, with its source.
Lengths in mm, stresses and pressures in MPa.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import brentq

from skinlab.mechanics.fem.admissibility import NO_LIMITS
from skinlab.mechanics.fem.assembly import Assembly, stress_and_tangent
from skinlab.mechanics.fem.element import Element
from skinlab.mechanics.fem.mesh import Mesh, graded_sizes, grid_mesh
from skinlab.mechanics.fem.newton import EquilibriumPath, StepSettings, follow
from skinlab.mechanics.fem.suction import Geometry, SuctionCurve
from skinlab.mechanics.materials import DEFAULT_LAW, Law, get_law
from skinlab.mechanics.materials import extended_neo_hookean as eq_1
from skinlab.mechanics.materials.base import KAPPA

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Problem:
    """A body under a follower pressure, and the unknown whose displacement is compared."""

    assembly: Assembly
    watch: int
    scale_mm: float

    def path(
        self, pressure_mpa: float, parameters: Mapping[str, Any], correction: float = 3e-7
    ) -> EquilibriumPath:
        """Return the path to this pressure, with nothing held to be inadmissible."""
        return follow(
            self.assembly,
            pressure_mpa,
            parameters,
            self.scale_mm,
            StepSettings(limits=NO_LIMITS, smallest_step_mbar=1e-9, correction=correction),
            watch=self.watch,
        )

    def deflection(self, pressure_mpa: float, parameters: Mapping[str, Any]) -> float:
        """Return the watched displacement, mm.

        Raises:
            ArithmeticError: the path ends before this pressure.
        """
        path = self.path(pressure_mpa, parameters)
        if path.stopped:
            raise ArithmeticError(path.stopped)
        return float(path.displacements[-1][self.watch])


def neo_hookean(mu_mpa: float, nu: float) -> dict[str, float]:
    """Return the parameters of the neo-Hookean law that are, at small strain, μ and ν."""
    return eq_1.neo_hookean(0.5 * mu_mpa, 2.0 * mu_mpa * (1 + nu) / (3 * (1 - 2 * nu)))


# ---- thick shells ----


def thick_shell(
    inner: float, outer: float, element: Element, across: int, along: int, *, sphere: bool
) -> Problem:
    """Return half a hollow sphere, or a slice of a long tube, with a pressure inside.

    `across` and `along` are the numbers of elements through the wall and along it. What is watched
    is how far the inner wall moves out.
    """
    mesh = grid_mesh(
        np.linspace(inner, outer, across + 1),
        np.linspace(0.0, np.pi / 2 if sphere else outer - inner, along + 1),
        2 * outer,
        2 * outer,
        element.nodes,
    )
    first, last = mesh.bottom, np.flatnonzero(mesh.nodes[:, 1] == mesh.nodes[:, 1].max())
    inside = mesh.axis[::-1]  # downwards: the load then points out of the cavity
    edges = np.column_stack([inside[0:-2:2], inside[2::2], inside[1::2]])
    if sphere:
        rho, angle = mesh.nodes.T.copy()
        mesh = replace(mesh, nodes=np.column_stack([rho * np.cos(angle), rho * np.sin(angle)]))
        fixed = np.concatenate([2 * last, 2 * first + 1])
    else:
        fixed = np.concatenate([2 * first + 1, 2 * last + 1])
    assembly = Assembly(replace(mesh, loaded_edges=edges), element, get_law(DEFAULT_LAW), fixed)
    return Problem(assembly, int(assembly.equation[2 * inside[-1]]), inner)


def sphere_pressure(inner: float, outer: float, moved: float, mu: float) -> float:
    """Return the pressure that widens an incompressible neo-Hookean sphere by `moved` inside.

    A. E. Green and W. Zerna, Theoretical Elasticity: p is the integral of W'(λ)/(λ³−1).
    """
    a = (inner + moved) / inner
    b = np.cbrt(outer**3 + (inner + moved) ** 3 - inner**3) / outer
    return float(mu * (2 / b + 0.5 / b**4 - 2 / a - 0.5 / a**4))


def tube_pressure(inner: float, outer: float, moved: float, mu: float) -> float:
    """Return the same for a tube that keeps its length: the integral of W'(λ)/(λ²−1)."""
    a = (inner + moved) / inner
    b = np.sqrt(outer**2 + (inner + moved) ** 2 - inner**2) / outer
    return float(mu * (np.log(a / b) + 0.5 / b**2 - 0.5 / a**2))


def compressible_tube(
    inner: float, outer: float, pressure_mpa: float, law: Law, parameters: Mapping[str, Any]
) -> Any:
    """Return r(R) and dr/dR of a compressible tube that keeps its length, as a function of R.

    The ordinary differential equation dP_rR/dR + (P_rR − P_θΘ)/R = 0, solved by collocation to
    1e-10: the smooth problem on which the order of convergence is measured.
    """

    def stress(radius: Array, r: Array, slope: Array) -> tuple[Array, Array]:
        zero, one = np.zeros_like(r), np.ones_like(r)
        f = np.stack([slope, zero, zero, one, r / radius])
        _, p, a, _ = stress_and_tangent(f, law, parameters)
        return p, a

    def slopes(radius: Array, y: Array) -> Array:
        p, a = stress(radius, y[0], y[1])
        hoop_slope = (y[1] - y[0] / radius) / radius
        return np.stack([y[1], (-(p[0] - p[4]) / radius - a[0, 4] * hoop_slope) / a[0, 0]])

    def ends(ya: Array, yb: Array) -> Array:
        at = np.array([inner, outer])
        p, _ = stress(at, np.array([ya[0], yb[0]]), np.array([ya[1], yb[1]]))
        return np.array([p[0, 0] + pressure_mpa * ya[0] / inner, p[0, 1]])

    radius = np.linspace(inner, outer, 41)
    start = np.stack([radius, np.ones_like(radius)])
    return solve_bvp(slopes, ends, radius, start, tol=1e-10, max_nodes=20000).sol


# ---- plates and membranes ----


def disc(
    radius: float,
    thickness: float,
    element: Element,
    law: str = DEFAULT_LAW,
    *,
    held: str = "clamped",
    through: int = 2,
    along: int = 30,
) -> Problem:
    """Return a disc with a pressure on its lower face; the apex deflection is watched.

    `held`: `clamped`, the whole rim; `pinned`, the rim's lower edge only. The elements shrink
    towards the rim.
    """
    sizes = graded_sizes(radius, min(0.25 * thickness, radius / along), 1.3, radius / along)
    r_lines = np.concatenate([[0.0], np.cumsum(sizes[::-1])])
    r_lines[-1] = radius
    mesh = grid_mesh(
        r_lines, np.linspace(0.0, thickness, through + 1), radius, 2 * radius, element.nodes
    )
    under = mesh.bottom
    mesh = replace(mesh, loaded_edges=np.column_stack([under[0:-2:2], under[2::2], under[1::2]]))
    rim = mesh.outer if held == "clamped" else under[-1:]
    fixed = np.unique(np.concatenate([2 * mesh.axis, 2 * rim, 2 * rim + 1]))
    assembly = Assembly(mesh, element, get_law(law), fixed)
    return Problem(assembly, int(assembly.equation[2 * mesh.apex + 1]), radius)


def clamped_plate(radius: float, thickness: float, pressure: float, mu: float, nu: float) -> float:
    """Return the deflection p R⁴/(64 D) + p R²/(4 k G h), k = 5/6 (Timoshenko; Mindlin)."""
    stiffness = 2 * mu * (1 + nu) * thickness**3 / (12 * (1 - nu**2))
    bending = pressure * radius**4 / (64 * stiffness)
    return bending + pressure * radius**2 / (4 * (5 / 6) * mu * thickness)


def hencky(radius: float, thickness: float, pressure: float, mu: float, nu: float) -> float:
    """Return the deflection of Hencky's membrane, clamped and without pre-tension.

    H. Hencky, Z. Math. Phys. 63 (1915) 311; the coefficients as corrected by Chien and Alekseev.
    """
    stress = np.array([2 / 3, 13 / 18, 17 / 18, 37 / 27, 1205 / 567])
    powers = np.arange(5, 18, 3)

    def rim(b: float) -> float:  # no radial displacement there
        tail = ((powers / 1.5 + 5 / 3 - nu) * stress / b**powers).sum()
        return float((1 - nu) * b - (3 - nu) / b**2 - tail)

    b = brentq(rim, 1.2, 3.0)
    shape = np.array([1, 1 / 2, 5 / 9, 55 / 72, 7 / 6, 205 / 108, 17051 / 5292])
    series = float((shape / b ** np.arange(1, 20, 3)).sum())
    load = pressure * radius / (2 * mu * (1 + nu) * thickness)
    return radius * float(np.cbrt(load)) * series


def mooney_membrane(
    radius: float, thickness: float, pressure: float, c10: float, c01: float
) -> float:
    """Return the apex deflection of an incompressible Mooney-Rivlin membrane, rim held.

    J. E. Adkins and R. S. Rivlin, Phil. Trans. R. Soc. A 244 (1952) 505: equilibrium along the
    meridian, T1 sin θ = p r/2, and the law of the membrane; integrated from a guessed stretch of
    the pole, which is then found so that the rim stays where it is.
    """

    def tension(along: float, around: float) -> float:
        third = 1 / (along * around)
        return 2 * thickness * third * (along**2 - third**2) * (c10 + around**2 * c01)

    def slopes(rho: float, y: Array) -> list[float]:
        along, r, _ = y
        if rho == 0.0:
            return [0.0, along, 0.0]
        around = r / rho
        t1, t2 = tension(along, around), tension(around, along)
        sine = np.clip(0.5 * pressure * r / t1, -1.0, 1.0)
        r_slope = along * np.sqrt(1 - sine**2)
        step = 1e-6
        by_along = (tension(along + step, around) - tension(along - step, around)) / (2 * step)
        by_around = (tension(along, around + step) - tension(along, around - step)) / (2 * step)
        t_slope = (t2 - t1) * r_slope / r
        along_slope = (t_slope - by_around * (r_slope - around) / rho) / by_along
        return [along_slope, r_slope, along * sine]

    def integrate(pole: float) -> Array:
        start = 1e-4 * radius
        y0 = [pole, pole * start, 0.0]
        solution = solve_ivp(slopes, (start, radius), y0, "LSODA", rtol=1e-8, atol=1e-9 * radius)
        return np.asarray(solution.y[:, -1])

    # The branch before any limit point: the smallest stretch of the pole that fits.
    low = 1.01
    while integrate(low)[1] < radius:
        low *= 1.02
        if low > 4.0:
            raise ArithmeticError("no membrane of this kind carries this pressure")
    pole = brentq(lambda x: float(integrate(x)[1]) - radius, low / 1.02, low, xtol=1e-9)
    return float(integrate(pole)[2])


def distorted(mesh: Mesh, amount: float, rng: np.random.Generator) -> Mesh:
    """Return the mesh with its corners moved about at random, but for those on its outline.

    `amount` is a fraction of the smallest element; middle nodes stay in the middle.
    """
    nodes = mesh.nodes.copy()
    (r0, z0), (r1, z1) = nodes.min(axis=0), nodes.max(axis=0)
    x = nodes[mesh.elements[:, :4]]
    size = float(np.hypot(*(x[:, 2] - x[:, 0]).T).min())
    corners = np.unique(mesh.elements[:, :4])
    r, z = nodes[corners].T
    inner = corners[(r > r0) & (r < r1) & (z > z0) & (z < z1)]
    nodes[inner] += amount * size * rng.uniform(-0.5, 0.5, (len(inner), 2))
    for k in range(4):
        ends = mesh.elements[:, [k, (k + 1) % 4]]
        nodes[mesh.elements[:, 4 + k]] = nodes[ends].mean(axis=1)
    if mesh.elements.shape[1] == 9:
        nodes[mesh.elements[:, 8]] = nodes[mesh.elements[:, :4]].mean(axis=1)
    return replace(mesh, nodes=nodes)


# ---- curves of other programs ----


@dataclass(frozen=True)
class GeometryTo(Geometry):
    """A geometry whose model ends where somebody else's did."""

    ends_mm: float = math.inf

    @property
    def outer_radius_mm(self) -> float:
        """Where the model ends."""
        return self.ends_mm


@dataclass(frozen=True)
class ReferenceCurve:
    """A case that another program has solved; see tests/data/fe_reference/ORIGIN.md."""

    file: Path
    parameters: dict[str, float]  # of eq. (1), MPa
    nu: float
    geometry: Geometry
    certain: bool  # no finer mesh creases
    w_um: Array  # (3,) at 20, 50 and 100 mbar
    uncertainty_um: Array  # (3,)
    on_mesh: dict[str, Array]  # the same on named meshes

    PRESSURE_MBAR: ClassVar[tuple[float, ...]] = (20.0, 50.0, 100.0)

    @property
    def name(self) -> str:
        """Short, unique."""
        return self.file.stem.removeprefix("fe_")

    def curve(self) -> tuple[Array, Array]:
        """Return pressure (mbar) and deflection (mm), 0 to 100 mbar."""
        table = np.loadtxt(self.file, delimiter=",", skiprows=1)
        return table[:, 0], table[:, 1]

    def deviation(self, curve: SuctionCurve) -> Array:
        """Return w/w_ref − 1 at 20, 50 and 100 mbar (3,); NaN where `curve` does not hold."""
        return curve(self.PRESSURE_MBAR) * 1e3 / self.w_um - 1


def reference_curves(folder: Path) -> list[ReferenceCurve]:
    """Return the cases that this folder's index.json lists."""
    found = []
    for entry in json.loads((folder / "index.json").read_text(encoding="utf-8")):
        if entry["p_at"] != [20, 50, 100]:
            raise ValueError(f"{entry['file']}: not at 20, 50 and 100 mbar")
        found.append(
            ReferenceCurve(
                file=folder / entry["file"],
                parameters={
                    eq_1.X1: entry["X1"],
                    eq_1.X2: entry["X2"],
                    KAPPA: entry[KAPPA],
                },
                nu=entry["nu"],
                geometry=GeometryTo(2 * entry["R"], entry["h"], entry["r_out"]),
                certain=not entry["crease_on_finer_mesh"],
                w_um=np.array(entry["w_um"]),
                uncertainty_um=np.array(entry["uncertainty_um"]),
                on_mesh={k: np.array(v["w_um"], float) for k, v in entry["on_mesh"].items()},
            )
        )
    return found
