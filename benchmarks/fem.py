"""How fast one curve is, against FElupe, scikit-fem, without the kernel, and LAPACK's floor.

    OPENBLAS_NUM_THREADS=1 python benchmarks/fem.py [--quick] [--out benchmarks/results/fem.json]

FElupe (GPL, the extra "bench") is used here and nowhere else. Both programs run side by side in one
process, in turns, on the reference cases. FElupe is given the law in closed form (not by automatic
differentiation), its best predictor, solver ordering, steps and mesh out of those tried, and is
asked for 20, 50 and 100 mbar only, while skinlab gives the whole curve. scikit-fem (also "bench")
assembles the same tangent and forces of the same mesh, with stress and moduli from skinlab's numpy.
For batches there is no peer: torch-fem 0.14 and JAX-FEM 0.0.12 list plane and solid elements, and
neither axisymmetry nor a pressure that follows the surface.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg.lapack import dpbtrf
from scipy.sparse.linalg import spsolve

sys.path.append(str(Path(__file__).parents[1] / "tests"))

from known_answers import ReferenceCurve, reference_curves

from skinlab.mechanics.effects.model import problem_of
from skinlab.mechanics.fem.assembly import Assembly, stress_and_tangent
from skinlab.mechanics.fem.element import QUAD8_FULL
from skinlab.mechanics.fem.sensitivity import solve_with_slopes
from skinlab.mechanics.fem.skin import Skin, SkinProblem
from skinlab.mechanics.fem.suction import (
    MBAR,
    MESH_OF_RECORD,
    VERIFICATION_MESH,
    Discretisation,
    assembly_for,
    solve,
    trace,
)
from skinlab.tables.build import build
from skinlab.tables.grid_spec import GridSpec
from skinlab.tables.parallel_build import How

FOLDER = Path(__file__).resolve().parent
CASES = [
    case for case in reference_curves(FOLDER.parent / "tests/data/fe_reference") if case.certain
]
UNIFORM = Discretisation("u0.25", QUAD8_FULL, 0.25 / 3, 1.0, 0.25 / 3, 0.25 / 6, 0.25)
# Plain elements as accurate as the mesh of record, for a program without quarter points.
PLAIN = replace(MESH_OF_RECORD, name="plain-0.02", edge=0.02 / 3, quarter_point=False)
STEPS = {
    5: (3, 10, 20, 50, 100),
    7: (2, 8, 20, 35, 50, 75, 100),
    10: (2, 6, 12, 20, 30, 40, 50, 65, 82, 100),
    15: (1, 3, 6, 10, 15, 20, 26, 33, 41, 50, 59, 69, 79, 90, 100),
}


# ---- FElupe's side ----


def law_in_closed_form(x1: float, x2: float, kappa: float) -> tuple[Any, Any]:
    """Return stress and elasticity of eq. (1) as FElupe asks for them: (3, 3, q, c) in and out."""
    delta = np.eye(3)

    def parts(f: Any) -> Any:
        c = np.einsum("kiqc,kjqc->ijqc", f, f)
        j = np.linalg.det(f.transpose(2, 3, 0, 1))
        inverse = np.linalg.inv(f.transpose(2, 3, 0, 1)).transpose(3, 2, 0, 1)  # F^-T
        i1 = np.einsum("iiqc->qc", c)
        i2 = 0.5 * (i1**2 - np.einsum("ijqc,ijqc->qc", c, c))
        fc = np.einsum("ikqc,kjqc->ijqc", f, c)
        a, b = j ** (-2 / 3), j ** (-4 / 3)
        w1, w2 = x1 + x2 * (b * i2 - 3), x2 * (a * i1 - 3)
        g1 = 2 * a * (f - i1 / 3 * inverse)  # dJ1/dF
        g2 = 2 * b * (i1 * f - fc - 2 / 3 * i2 * inverse)  # dJ2/dF
        return c, j, inverse, i1, i2, fc, a, b, w1, w2, g1, g2

    def stress(x: Any, **_: Any) -> Any:
        _, j, inverse, *_, w1, w2, g1, g2 = parts(x[0])
        return [w1 * g1 + w2 * g2 + kappa * (j - 1) * j * inverse, x[-1]]

    def elasticity(x: Any, **_: Any) -> Any:
        f = x[0]
        c, j, inverse, i1, i2, fc, a, b, w1, w2, g1, g2 = parts(f)
        left = np.einsum("ikqc,jkqc->ijqc", f, f)
        outer = "ijqc,klqc->ijklqc"
        # three outer products hold all that is not δ or crossed
        u1 = x2 * g2 - 4 / 3 * w1 * a * f + 4 / 9 * w1 * a * i1 * inverse
        u1 = u1 - 8 / 3 * w2 * b * (i1 * f - fc) + 16 / 9 * w2 * b * i2 * inverse
        u1 = u1 - x2 * g2 + kappa * (2 * j * j - j) * inverse
        hessian = np.einsum(outer, u1, inverse)
        hessian += np.einsum(outer, x2 * g2, g1)
        hessian += np.einsum(outer, x2 * g1, g2)
        v = -4 / 3 * w1 * a * f - 8 / 3 * w2 * b * (i1 * f - fc)
        hessian += np.einsum(outer, inverse, v)
        hessian += np.einsum(outer, 4 * w2 * b * f, f)
        crossed = 2 / 3 * w1 * a * i1 + 4 / 3 * w2 * b * i2 - kappa * (j - 1) * j
        hessian += np.einsum("ilqc,kjqc->ijklqc", crossed * inverse, inverse)
        hessian += np.einsum("ik,jlqc->ijklqc", delta, -2 * w2 * b * c)
        hessian += np.einsum("ilqc,kjqc->ijklqc", -2 * w2 * b * f, f)
        hessian += np.einsum("ikqc,jl->ijklqc", -2 * w2 * b * left, delta)
        hessian += np.einsum("ik,jl,qc->ijklqc", delta, delta, 2 * w1 * a + 2 * w2 * b * i1)
        return [hessian]

    return stress, elasticity


class Felupe:
    """One case on one mesh, prepared; preparing is not timed."""

    def __init__(self, case: ReferenceCurve, discretisation: Discretisation) -> None:
        """Build mesh, regions, fields and the items of Newton's method."""
        import felupe as fem

        self.fem = fem
        assembly, _ = assembly_for(case.geometry, discretisation, "extended_neo_hookean")
        mesh = assembly.mesh
        order = [0, 3, 2, 1, 7, 6, 5, 4, 8][: mesh.elements.shape[1]]  # (z, r) is a reflection
        points = mesh.nodes[:, ::-1].copy()
        nine = len(order) == 9
        body = fem.Mesh(points, mesh.elements[:, order], "quad9" if nine else "quad8")
        region = (fem.RegionBiQuadraticQuad if nine else fem.RegionQuadraticQuad)(body)
        self.field = fem.FieldContainer([fem.FieldAxisymmetric(region, dim=2)])
        mask = (points[:, 0] == 0) & (points[:, 1] <= case.geometry.radius_mm)
        kind = fem.RegionBiQuadraticQuadBoundary if nine else fem.RegionQuadraticQuadBoundary
        boundary = kind(body, only_surface=True, mask=mask, ensure_3d=True)
        pressed = fem.FieldContainer([fem.FieldAxisymmetric(boundary, dim=2)])
        p = case.parameters
        law = fem.Material(*law_in_closed_form(p["X1_MPa"], p["X2_MPa"], p["kappa_MPa"]))
        self.pressure = fem.SolidBodyPressure(pressed)
        self.items = [fem.SolidBody(law, self.field), self.pressure]
        axial, radial = 2 * np.arange(len(points)), 2 * np.arange(len(points)) + 1
        self.dof0 = np.unique(
            np.concatenate(
                [radial[mesh.axis], axial[mesh.tape], radial[mesh.tape], radial[mesh.outer]]
            )
        )
        self.dof1 = np.setdiff1d(np.arange(2 * len(points)), self.dof0)
        self.apex = mesh.apex

    def curve(self, steps: Sequence[float], predictor: int, ordering: str) -> tuple[Any, int]:
        """Return the apex at `steps` (mbar) in mm, and the iterations.

        `predictor`: the degree of the polynomial through the last points that starts each step.
        """
        values = self.field[0].values
        values[:] = 0.0
        seen_p, seen_u = [0.0], [values.copy()]
        apex, iterations = [], 0

        def solver(a: Any, b: Any) -> Any:
            return spsolve(a, b, permc_spec=ordering)

        for p in steps:
            use = min(predictor + 1, len(seen_p)) if predictor else 1
            at = np.array(seen_p[-use:])
            weights = [
                np.prod([(p - q) / (x - q) for q in np.delete(at, i)]) for i, x in enumerate(at)
            ]
            values[:] = sum(w * u for w, u in zip(weights, seen_u[-use:], strict=True))
            self.pressure.update(-p * MBAR)
            result = self.fem.newtonraphson(
                items=self.items, dof0=self.dof0, dof1=self.dof1, ext0=0.0, solver=solver, verbose=0
            )
            values = self.field[0].values
            iterations += result.iterations
            seen_p.append(p)
            seen_u.append(values.copy())
            apex.append(values[self.apex, 0])
        return np.array(apex), iterations


# ---- measuring ----


@dataclass
class Timed:
    """Seconds of the best of a few runs, and what came out."""

    seconds: float
    result: Any


def timed(run: Callable[[], Any], repeats: int = 3) -> Timed:
    """Return the fastest of `repeats` runs: what is left of noise only makes a run slower."""
    best, result = np.inf, None
    for _ in range(repeats):
        start = time.process_time()  # of one thread: others on the machine do not count
        result = run()
        best = min(best, time.process_time() - start)
    return Timed(best, result)


def kernel_and_floor(cases: Sequence[ReferenceCurve], rounds: int = 7) -> dict[str, Any]:
    """Return CPU times (ms, medians over cases) of ways to the same curve, measured in turns.

    The floor is what LAPACK's factorisation alone takes for as many matrices; `batch_of_8` what
    numpy takes for eight curves at once, per curve, LAPACK's floor included.
    """
    rows: dict[str, list[float]] = {}
    apart = []
    for case in cases:
        assembly, apex = assembly_for(case.geometry, MESH_OF_RECORD, "extended_neo_hookean")
        fixed = np.flatnonzero(assembly.equation == assembly.n)
        plain = Assembly(assembly.mesh, assembly.element, assembly.law, fixed, compiled=False)
        radius, parameters = case.geometry.radius_mm, case.parameters
        one, other = (trace(x, apex, parameters, 100.0, radius) for x in (assembly, plain))
        p = np.linspace(0.0, min(one.holds_to_mbar, 100.0), 500)
        apart.append(float(np.abs(one(p) - other(p)).max()) * 1e3)
        u, pressure = one.path.displacements[-1], one.path.pressure_mpa[-1]
        state = plain.evaluate(u, pressure, parameters)
        assert state is not None
        band = state.tangent.T
        eight = np.tile(plain.deformation_gradients(plain.full(u)), (1, 8, 1))
        gradients = np.tile(plain._gradients, (8, 1, 1, 1))
        m, q, _, dofs = gradients.shape
        across = np.ascontiguousarray(gradients.reshape(m, 5 * q, dofs).transpose(0, 2, 1))

        def batch(
            law: Any = plain.law, eight: Any = eight, gradients: Any = gradients,
            across: Any = across, parameters: Any = parameters,
        ) -> None:  # fmt: skip
            _, _, moduli, _ = stress_and_tangent(eight, law, parameters)
            m, q, _, dofs = gradients.shape
            by_point = np.ascontiguousarray(moduli.reshape(25, -1).T).reshape(m, q, 5, 5)
            across @ (by_point @ gradients).reshape(m, 5 * q, dofs)

        ways: dict[str, Callable[[], Any]] = {
            "compiled": lambda a=assembly, x=apex, c=parameters, r=radius: trace(a, x, c, 100.0, r),
            "numpy": lambda a=plain, x=apex, c=parameters, r=radius: trace(a, x, c, 100.0, r),
            "floor": lambda k=band: dpbtrf(k, lower=1),
            "batch_of_8": batch,
        }
        times = {name: [] for name in ways}
        for _ in range(rounds):
            for name, way in ways.items():
                start = time.process_time()
                way()
                times[name].append((time.process_time() - start) * 1e3)
        found = {name: float(np.median(each)) for name, each in times.items()}
        found["floor"] *= one.iterations
        found["batch_of_8"] = found["batch_of_8"] * one.iterations / 8 + found["floor"]
        for name, value in found.items():
            rows.setdefault(name, []).append(value)
    return {
        "cpu_ms": {name: float(np.median(values)) for name, values in rows.items()},
        "compiled_to_numpy": float(np.median(np.divide(rows["compiled"], rows["numpy"]))),
        "compiled_to_floor": float(np.median(np.divide(rows["compiled"], rows["floor"]))),
        "largest_difference_um": max(apart),
    }


def assembly_peer(case: ReferenceCurve, rounds: int = 15) -> dict[str, float]:
    """Return CPU times (ms, medians, in turns) of one assembly, and how far apart results are.

    On straight-sided elements, at 60 mbar; scikit-fem's assembly has no follower pressure in it.
    """
    import skfem

    assembly, _ = assembly_for(case.geometry, UNIFORM, "extended_neo_hookean")
    law, parameters, mesh = assembly.law, case.parameters, assembly.mesh
    curve = solve(case.geometry, parameters, 60.0, discretisation=UNIFORM)
    unknowns = curve.path.displacements[-1]
    used, corners = np.unique(mesh.elements[:, :4], return_inverse=True)
    quads = skfem.MeshQuad(
        np.ascontiguousarray(mesh.nodes[used].T), corners.reshape(-1, 4).T.copy()
    )
    basis = skfem.Basis(quads, skfem.ElementVector(skfem.ElementQuadS2()), intorder=5)
    node = {tuple(np.round(x, 9)): i for i, x in enumerate(mesh.nodes)}
    axial = np.zeros(basis.N, dtype=int)
    axial[basis.nodal_dofs[1]] = axial[basis.facet_dofs[1]] = 1
    at = [2 * node[tuple(np.round(x, 9))] for x in basis.doflocs.T] + axial
    displacements, equation = assembly.full(unknowns)[at], assembly.equation[at]
    radius = basis.global_coordinates()[0]

    def gradients(u: Any, r: Any) -> Any:
        return np.stack([u.grad[0, 0], u.grad[0, 1], u.grad[1, 0], u.grad[1, 1], u[0] / r])

    @skfem.BilinearForm
    def tangent(u: Any, v: Any, w: Any) -> Any:
        r = w.x[0]
        product = np.einsum("i...,ij...,j...", gradients(v, r), w["moduli"], gradients(u, r))
        return 2 * np.pi * r * product

    @skfem.LinearForm
    def force(v: Any, w: Any) -> Any:
        r = w.x[0]
        return 2 * np.pi * r * np.einsum("i...,i...", gradients(v, r), w["stress"])

    def theirs() -> tuple[Any, Any]:
        f = gradients(basis.interpolate(displacements), radius)
        f[[0, 3, 4]] += 1.0
        _, stress, moduli, _ = stress_and_tangent(f, law, parameters)
        return tangent.assemble(basis, moduli=moduli), force.assemble(basis, stress=stress)

    def ours() -> Any:
        return assembly.evaluate(unknowns, 0.0, parameters)

    times: dict[str, list[float]] = {"skinlab": [], "scikit_fem": []}
    for _ in range(rounds):
        for name, run in (("skinlab", ours), ("scikit_fem", theirs)):
            start = time.process_time()
            run()
            times[name].append((time.process_time() - start) * 1e3)
    state, (matrix, forces) = ours(), theirs()
    free = equation < assembly.n
    band, n = state.tangent, assembly.n
    whole = sum(np.diag(band[: n - k, k], -k) for k in range(band.shape[1]))
    whole = whole + np.tril(whole, -1).T
    order = equation[free]
    other = matrix.tocsr()[free][:, free].toarray()
    apart = np.abs(whole[np.ix_(order, order)] - other).max() / np.abs(other).max()
    off = np.abs(state.residual[order] - forces[free]).max() / np.abs(forces).max()
    found = {f"{name}_ms": float(np.median(each)) for name, each in times.items()}
    return {
        **found,
        "ratio": found["scikit_fem_ms"] / found["skinlab_ms"],
        "largest_relative_difference": float(max(apart, off)),
    }


def slopes(case: ReferenceCurve, rounds: int = 15) -> dict[str, float]:
    """Return what slopes by three parameters and by one of the mesh cost, in curves."""
    values = (0.03, 1.0, 0.32)

    def problem(at: Sequence[float], ratio: float = 1.0) -> SkinProblem:
        effects = {} if ratio == 1.0 else {"thickness_error": {"ratio": ratio}}
        return problem_of(Skin(tuple(at)), effects, case.geometry)

    changes = []
    for j, x in enumerate(values):
        up, down = ([*values[:j], x * s, *values[j + 1 :]] for s in (1 + 1e-4, 1 - 1e-4))
        changes.append((problem(up), problem(down), 2e-4 * x))
    mesh = [(problem(values, 1 + 1e-4), problem(values, 1 - 1e-4), 2e-4)]
    times: dict[str, list[float]] = {"none": [], "three": [], "mesh": []}
    for _ in range(rounds):
        for name, asked in (("none", []), ("three", changes), ("mesh", mesh)):
            start = time.process_time()
            solve_with_slopes(problem(values), asked, 100.0)
            times[name].append(time.process_time() - start)
    none, three, one = (float(np.median(times[name])) for name in ("none", "three", "mesh"))
    return {"three_parameters": (three - none) / none, "thickness": (one - none) / none}


@dataclass(frozen=True)
class Settings:
    """How FElupe is run."""

    mesh: Discretisation
    predictor: int
    ordering: str
    steps: int


def felupes_best(cases: Sequence[ReferenceCurve]) -> list[Settings]:
    """Return the settings that converge and are accurate on these cases, the fastest first."""
    rows = []
    for settings in (
        Settings(mesh, predictor, ordering, steps)
        for mesh in (MESH_OF_RECORD, PLAIN)
        for predictor in (1, 2, 3)
        for ordering in ("COLAMD", "MMD_AT_PLUS_A")
        for steps in STEPS
    ):
        runs = [felupes_run(case, settings, 1) for case in cases]
        if all(
            run is not None and off_by(case, run) < 2e-3
            for case, run in zip(cases, runs, strict=True)
        ):
            rows.append((sum(run.seconds for run in runs if run), settings))
    return [settings for _, settings in sorted(rows, key=lambda row: row[0])]


def felupes_run(case: ReferenceCurve, settings: Settings, repeats: int) -> Timed | None:
    """Return FElupe's run of this case, or nothing where it does not converge."""
    program = Felupe(case, settings.mesh)
    steps = STEPS[settings.steps]
    try:
        return timed(lambda: program.curve(steps, settings.predictor, settings.ordering), repeats)
    except Exception:  # noqa: BLE001  whatever it raises, it has no curve
        return None


def off_by(case: ReferenceCurve, run: Timed) -> float:
    """Return the largest deviation of FElupe's run at 20, 50 and 100 mbar."""
    steps = STEPS[len(run.result[0])]
    at = [steps.index(p) for p in (20, 50, 100)]
    return float(np.abs(run.result[0][at] * 1e3 / case.w_um - 1).max())


def side_by_side(cases: Sequence[ReferenceCurve], ranked: Sequence[Settings]) -> dict[str, Any]:
    """Return both programs' times, in turns: each at its best, and on the same mesh and steps.

    Where FElupe's fastest settings do not converge, it is given the next ones.
    """
    own, theirs, deviations = [], [], []
    same: dict[str, list[float]] = {}
    agree: dict[str, float] = {}
    for case in cases:
        mine = timed(lambda c=case: solve(c.geometry, c.parameters, 100.0))
        other = next(run for s in ranked if (run := felupes_run(case, s, 3)) is not None)
        own.append(mine.seconds)
        theirs.append(other.seconds)
        deviations.append((np.abs(case.deviation(mine.result)).max(), off_by(case, other)))
    for mesh in (UNIFORM, MESH_OF_RECORD, VERIFICATION_MESH):
        same[mesh.name], agree[mesh.name] = [], 0.0
        for case in cases[:: 1 if len(cases) < 5 else 4]:
            mine = timed(
                lambda c=case, m=mesh: solve(c.geometry, c.parameters, 100.0, discretisation=m)
            )
            steps = mine.result.pressure_mbar[1:]
            program = Felupe(case, mesh)
            other = timed(
                lambda f=program, s=steps: f.curve(s, 2, ranked[0].ordering),
                1,
            )
            same[mesh.name].append(other.seconds / mine.seconds)
            off = np.abs(other.result[0] - mine.result.deflection_mm[1:]).max() * 1e3
            agree[mesh.name] = max(agree[mesh.name], float(off))
    ratio = np.array(theirs) / np.array(own)
    worst_own, worst_theirs = np.array(deviations).max(axis=0)
    return {
        "skinlab_ms": {"median": float(np.median(own)) * 1e3, "worst": max(own) * 1e3},
        "felupe_ms": {"median": float(np.median(theirs)) * 1e3, "worst": max(theirs) * 1e3},
        "ratio": {"median": float(np.median(ratio)), "least": float(ratio.min())},
        "worst_deviation": {"skinlab": float(worst_own), "felupe": float(worst_theirs)},
        "same_mesh_and_steps": {
            name: {
                "ratio_median": float(np.median(r)),
                "ratio_least": min(r),
                "largest_difference_um": agree[name],
            }
            for name, r in same.items()
        },
    }


def main() -> None:
    """Measure everything, print it, and write it down."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="three cases, no grid")
    parser.add_argument("--no-grid", action="store_true", help="leave out the paper's grid")
    parser.add_argument("--out", type=Path, help="default: results/fem.json, with --quick nothing")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    cases = CASES[:3] if options.quick else CASES
    for case in cases:  # prepared meshes are kept between curves; preparing is not a curve
        solve(case.geometry, case.parameters, 5.0)
    ranked = felupes_best([CASES[0], CASES[6], CASES[8]] if not options.quick else CASES[:1])
    best = ranked[0]
    report: dict[str, Any] = {
        "cases": len(cases),
        "machine": f"{platform.machine()}, Python {platform.python_version()}",
        "felupe_best": {**vars(best), "mesh": best.mesh.name},
        **side_by_side(cases, ranked),
        "kernel": kernel_and_floor(cases),
        "scikit_fem": assembly_peer(cases[0]),
        "slopes_in_curves": slopes(cases[0]),
    }
    if not (options.quick or options.no_grid):
        start = time.perf_counter()
        grid = build(GridSpec(), How(workers=2))
        report["paper_grid"] = {
            "curves": grid.spec.entries,
            "seconds_on_2_cores": time.perf_counter() - start,
            "marked": int((grid.holds_to < 100).sum()),
        }
    text = json.dumps(report, indent=1)
    print(text)
    out = options.out or (None if options.quick else FOLDER / "results" / "fem.json")
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
