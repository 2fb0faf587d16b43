"""Domes of skins with and without an effect, by another finite-element program (FElupe).

    python benchmarks/other_program_domes.py [--skins 45] [--seed 1]

Nothing of this project computes them: 9-node elements, full integration, a graded mesh whose
smallest element is 0.02 mm at the edge (0.0125 mm under 2 mm), the outer radius the larger of 3 R
and R + 6 h, its edge held in the plane. `benchmarks/other_program.py` makes campaigns of them. What
creases before 1.2 times the suctions that are used and 15 mbar, and domes with a kink, are drawn
again. `fem.py` runs that program on our own mesh, for its speed. Needs the extra `bench`. Saves
benchmarks/data/other_program_domes.csv, and the truth beside it.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from challenge.campaigns import drawn_size
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]

DATA = Path(__file__).parent / "data"
DOMES, TRUTH = DATA / "other_program_domes.csv", DATA / "other_program_domes.json"
MOST_MBAR = {6.0: 100.0, 2.0: 300.0, 8.0: 100.0}  # that campaigns of these openings go to
KINDS = (
    "none", "natural_tension", "hypodermis", "surface_layer", "none", "strain_stiffening",
    "tape_slip", "thickness_error", "none", "contact_preload", "regulator_lag", "deflection_gain",
    "aperture_error", "none", "two_layers",
)  # fmt: skip
SIZES: dict[
    str, dict[str, tuple[float, float, float, str]]
] = {  # in the form of challenge/campaigns.py
    "natural_tension": {"stretch": (1.0, 0.01, 0.06, "+")},
    "hypodermis": {"thickness_mm": (0.0, 2.0, 7.0, "+"), "X1_kPa": (0.0, 0.3, 4.0, "+")},
    "surface_layer": {"thickness_um": (0.0, 15.0, 40.0, "+"), "X1_MPa": (0.0, 0.4, 4.0, "+")},
    "strain_stiffening": {"X3_MPa": (0.0, 10.0, 300.0, "+")},
    "tape_slip": {"slip_mm": (0.0, 0.08, 0.4, "+")},
    "thickness_error": {"ratio": (1.0, 0.07, 0.3, "±")},
    "aperture_error": {"ratio": (1.0, 0.02, 0.06, "±")},  # of the 6 mm opening alone
    "contact_preload": {"p0_mbar": (0.0, 3.0, 15.0, "+")},
    "regulator_lag": {"tau_s": (0.0, 0.04, 0.4, "+")},
    "deflection_gain": {"gain": (1.0, 0.04, 0.15, "±")},
    "two_layers": {"stiffer": (0.0, 3.0, 10.0, "+")},  # the upper half: not in the library
}


def kappa(x1: float, nu: float) -> float:
    """Return the bulk modulus, MPa, by the paper's equation (3)."""
    return 4 * x1 * (1 + nu) / (3 * (1 - 2 * nu)) + 2 * x1 * (1 - nu) / (1 + nu)


def graded(length: float, smallest: float, largest: float) -> Array:
    """Return nodes (n,) from 0 to a length, mm, each element 1.5 times the one before."""
    found, size = [0.0], smallest
    while found[-1] + size < length:
        found.append(found[-1] + size)
        size = min(1.5 * size, largest)
    if length - found[-1] < 0.5 * size:
        found.pop()
    return np.array([*found, length])


def energy(c, x1=1.0, x2=0.0, x3=0.0, k=1.0, through=1.0, plane=1.0):  # type: ignore[no-untyped-def]
    """Return the law's energy, MPa, of a right Cauchy-Green tensor behind a stretch.

    The stretch, diagonal and before: `through` the thickness and in the `plane`.
    """
    import tensortrax.math as tm

    before = np.diag([through**2, plane**2, plane**2])
    both = c if through == plane == 1.0 else c @ before
    j = tm.sqrt(tm.linalg.det(c)) * through * plane**2
    i1 = tm.trace(both)
    i2 = (i1**2 - tm.trace(both @ both)) / 2
    return _energy(i1, i2, j, x1, x2, x3, k) / (through * plane**2)


def _energy(i1: Any, i2: Any, j: Any, x1: float, x2: float, x3: float, k: float) -> Any:
    one, two = i1 * j ** (-2 / 3) - 3, i2 * j ** (-4 / 3) - 3
    return x1 * one + x2 * one * two + x3 * one**3 + k / 2 * (j - 1) ** 2


def free_through(plane: float, x1: float, x2: float, x3: float, k: float) -> float:
    """Return the stretch through the thickness of a skin that is stretched in its plane."""

    def slope(through: float) -> float:
        ends = []
        for t in (through - 1e-5, through + 1e-5):
            i1, i2 = t**2 + 2 * plane**2, 2 * t**2 * plane**2 + plane**4
            ends.append(_energy(i1, i2, t * plane**2, x1, x2, x3, k))
        return float(ends[1] - ends[0])

    return float(brentq(slope, 0.5, 1.5))


def dome(
    skin: tuple[float, float, float],
    thickness_mm: float,
    aperture_mm: float,
    most_mbar: float,
    *,
    plane: float = 1.0,
    x3: float = 0.0,
    above: tuple[float, float] | None = None,
    below: tuple[float, float] | None = None,
    slip_mm: float = 0.0,
) -> tuple[Array, Array]:
    """Return suctions, mbar, and the apex there, mm, as far as Newton's method comes.

    `above` is a layer inside the skin (mm, X1 in MPa), `below` one under it.
    """
    import felupe as fe

    x1, x2, nu = skin
    k, radius = kappa(x1, nu), aperture_mm / 2
    smallest = 0.02 if aperture_mm > 3.0 else 0.0125
    held = radius + slip_mm  # the tape holds from here on
    give = np.linspace(radius, held, 1 + max(2, round(slip_mm / 0.05)))[1:] if slip_mm else []
    outer = max(3 * radius, radius + 6 * thickness_mm)
    r = np.concatenate(
        [
            radius - graded(radius, smallest, 0.25)[::-1],
            give,
            held + graded(outer - held, smallest, 0.6)[1:],
        ]
    )
    top = 0.0 if above is None else above[0]
    first = max(top / 2, 0.01) if top else smallest
    z = -np.concatenate(
        [[0.0, top / 2, top] if top else [0.0], top + graded(thickness_mm - top, first, 0.2)[1:]]
    )
    if below is not None:
        z = np.concatenate([z, -thickness_mm - graded(below[0], 0.1, 1.0)[1:]])
    mesh = fe.mesh.add_midpoints_faces(fe.mesh.add_midpoints_edges(fe.Grid(z[::-1], r)))
    depth = -mesh.points[mesh.cells].mean(axis=1)[:, 0]

    def field_of(cells: Any) -> Any:
        part = mesh.copy()
        part.update(cells=cells)
        return fe.FieldContainer([fe.FieldAxisymmetric(fe.RegionBiQuadraticQuad(part), dim=2)])

    field = field_of(mesh.cells)

    def solid(where: Any, **law: float) -> Any:
        own = field_of(mesh.cells[where])
        own.link(field)
        return fe.SolidBody(fe.Hyperelastic(energy, **law), own)

    def stretched(law: dict[str, float]) -> dict[str, float]:
        if plane == 1.0:
            return law
        own = (law["x1"], law.get("x2", 0.0), law.get("x3", 0.0), law["k"])
        return {**law, "plane": plane, "through": free_through(plane, *own)}

    of_skin = stretched({"x1": x1, "x2": x2, "x3": x3, "k": k})
    items = [solid((depth > top) & (depth < thickness_mm), **of_skin)]
    if above is not None:
        items.append(solid(depth < top, **stretched({"x1": above[1], "k": above[1] * k / x1})))
    if below is not None:
        items.append(solid(depth > thickness_mm, x1=below[1], k=kappa(below[1], 0.45)))
    surface = np.abs(mesh.points[:, 0]) < 1e-9
    at_r = mesh.points[:, 1]
    region = fe.RegionBiQuadraticQuadBoundary(
        mesh, only_surface=True, mask=surface & (at_r < radius + 1e-9), ensure_3d=True
    )
    opening = fe.FieldContainer([fe.FieldAxisymmetric(region, dim=2)])
    opening.link(field)
    suction = fe.SolidBodyPressure(opening)  # a follower
    items.append(suction)
    one = field[0]
    bounds = {
        "axis": fe.Boundary(one, fy=0, skip=(True, False)),
        "tape": fe.Boundary(one, mask=surface & (at_r > held - 1e-9)),
        "outer": fe.Boundary(one, fy=outer, skip=(True, False)),
    }
    if below is not None:
        bounds["base"] = fe.Boundary(one, mask=mesh.points[:, 0] < z.min() + 1e-9)
    fixed, free = fe.dof.partition(field, bounds)
    outside = fe.dof.apply(field, bounds, fixed)
    apex = int(np.flatnonzero(surface & (at_r < 1e-9))[0])
    largest = most_mbar / 36.0
    at, step = [(0.0, 0.0)], largest / 16
    while at[-1][0] < most_mbar - 1e-9 and step > 0.05:
        pressure = min(at[-1][0] + step, most_mbar)
        before = one.values.copy()
        suction.update(-1e-4 * pressure)
        try:
            found = fe.newtonraphson(
                items=items, x0=field, dof0=fixed, dof1=free, ext0=outside, verbose=0, maxiter=12,
                tol=1e-9,
            )  # fmt: skip
        except ValueError:  # it has not converged
            one.values = before
            step /= 2
            continue
        one.values = np.array(found.x[0].values)
        at.append((pressure, float(one.values[apex, 0])))
        step = min(largest, 1.5 * step)
    pressure_mbar, apex_mm = np.array(at).T
    return pressure_mbar, apex_mm


def draw(seed: int, number: int, attempt: int) -> dict[str, Any]:
    """Return a skin, and what is hidden in it."""
    rng = np.random.default_rng([seed, number, attempt])
    x1, x2 = (float(np.exp(rng.uniform(*np.log(b)))) for b in ((0.012, 0.08), (0.3, 4.5)))
    nu, thickness = float(rng.uniform(0.2, 0.47)), round(float(rng.uniform(0.9, 1.5)), 2)
    kind = KINDS[number % len(KINDS)]
    values = {name: drawn_size(rng, *size) for name, size in SIZES.get(kind, {}).items()}
    return {"kind": kind, "values": values, "skin": [x1, x2, nu], "thickness_mm": thickness}


def domes(truth: dict[str, Any]) -> dict[float, tuple[Array, Array]] | None:
    """Return the domes under each opening; None where one of them ends early, or has a kink."""
    kind, values, thickness = truth["kind"], truth["values"], truth["thickness_mm"]
    x1, x2, nu = truth["skin"]
    more: dict[str, Any] = {}
    match kind:
        case "natural_tension":
            more["plane"] = values["stretch"]
        case "hypodermis":
            more["below"] = values["thickness_mm"], 1e-3 * values["X1_kPa"]
        case "surface_layer":
            more["above"] = 1e-3 * values["thickness_um"], values["X1_MPa"]
        case "strain_stiffening":
            more["x3"] = values["X3_MPa"]
        case "tape_slip":
            more["slip_mm"] = values["slip_mm"]
        case "two_layers":
            more["above"] = 0.5 * thickness, values["stiffer"] * x1
    found = {}
    for aperture, most in MOST_MBAR.items():
        wider = values["ratio"] if kind == "aperture_error" and aperture == 6.0 else 1.0
        thicker = values["ratio"] if kind == "thickness_error" else 1.0
        end = 1.2 * most + 20.0
        p, w = dome((x1, x2, nu), thicker * thickness, wider * aperture, end, **more)
        slope = np.diff(w) / np.diff(p)
        kinked = bool((np.diff(slope[2:]) > 0.02 * slope[2:-1]).any())
        if p[-1] < end - 5.0 or kinked or w[-1] > 2.2 * aperture / 6.0:
            return None
        found[aperture] = p, w
    return found


def main() -> None:
    """Compute and save."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--skins", type=int, default=45)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    truths, rows = [], []
    for number in range(arguments.skins):
        for attempt in range(30):
            truth = draw(arguments.seed, number, attempt)
            found = domes(truth)
            if found is None:
                continue
            print(number, truth["kind"], flush=True)
            truths.append({"number": number, **truth})
            for aperture, (p, w) in found.items():
                rows += [
                    (number, f"{aperture:g}", f"{a:.6g}", f"{b:.7g}")
                    for a, b in zip(p, w, strict=True)
                ]
            break
    with DOMES.open("w", encoding="utf-8", newline="") as file:
        file.write("# By FElupe: see benchmarks/other_program_domes.py\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("number", "aperture_mm", "pressure_mbar", "deflection_mm"))
        writer.writerows(rows)
    TRUTH.write_text(json.dumps(truths, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
