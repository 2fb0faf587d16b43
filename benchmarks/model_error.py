"""How far the mesh of record is from a fine mesh, as a shape: what the noise model takes from it.

    python benchmarks/model_error.py [--sets 64] [--seed 3]
    python benchmarks/model_error.py --openings

Skins: log-uniform in X1 (0.005–0.2 MPa) and X2/X1 (0.5–1000), uniform in ν (0.2–0.48) and in
thickness (0.8–1.6 mm), openings of 2, 4, 6 and 8 mm, to 100 mbar or to where either mesh ends.
The relative deviation from the 9-node mesh of verification is fitted by shifted Legendre
polynomials of p/p_max, normalised to a mean square of 1; the root mean squares of the
coefficients over the skins are saved. Skins whose last tenth is on the way to a crease (deviation
above 0.5 %) are left out and counted. Takes about three minutes.

With `--openings` every skin (X1 0.01–0.1 MPa, X2 0.3–6 MPa, ν 0.22–0.44, 0.8–1.6 mm) is measured
with openings of 2 mm (to 300 mbar), 6 mm and 8 mm (to 100 mbar), as a campaign would, and the
deviation is told in two parts: what the openings have in common, and each one's own. Another
program, FElupe, is compared at the tops of eleven skins (`data/other_program_tops.csv`).

With `--law-range` two things are measured that depend on the skin, for
`skinlab/tables/model_errors.py`: how much the mesh of record locks, for ν from 0 to 0.499, against
9-node elements that cannot (projected dilatation, 0.02 mm at the edge of a 6 mm opening, quarter
points), by orders of polynomials as above, to 100 mbar or 0.3 of the pressure at which the table's
skin creases (`--locking` measures this alone); and, of skins that crease at 40 to 300 mbar, how far
the dome is from that of the finer 9-node mesh of verification, which creases earlier, at shares of
the table's limit.
"""

from __future__ import annotations

import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from skinlab.inference.noise import legendre
from skinlab.mechanics.fem.element import QUAD9_LINEAR_DILATATION
from skinlab.mechanics.fem.suction import MESH_OF_RECORD, VERIFICATION_MESH, Geometry, solve
from skinlab.mechanics.materials.compressibility import kappa_ratio, nu_from_ratio
from skinlab.tables.model_errors import LOCKING_SHAPES, crease_shapes, locking
from skinlab.tables.store import shipped_table

HERE = Path(__file__).parent
RESULT = HERE / "results" / "model_error.json"
OPENINGS_RESULT = HERE / "results" / "model_error_openings.json"
LAW_RANGE_RESULT = HERE / "results" / "model_error_law_range.json"
TOPS = HERE / "data" / "other_program_tops.csv"
OPENINGS = ((2.0, 300.0), (6.0, 100.0), (8.0, 100.0))  # mm, mbar
POINTS = 50


def deviation(point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return w(record)/w(fine) − 1 at POINTS pressures, for a point of the unit cube (5,)."""
    x1 = 0.005 * 40.0 ** point[0]
    nu = 0.2 + 0.28 * point[2]
    parameters = {
        "X1_MPa": x1,
        "X2_MPa": x1 * 0.5 * 2000.0 ** point[1],
        "kappa_MPa": x1 * float(kappa_ratio(nu, "paper")),
    }
    geometry = Geometry((2.0, 4.0, 6.0, 8.0)[int(4 * point[3])], 0.8 + 0.8 * point[4])
    curves = [
        solve(geometry, parameters, 100.0, discretisation=mesh)
        for mesh in (MESH_OF_RECORD, VERIFICATION_MESH)
    ]
    top = min(100.0, *(c.holds_to_mbar for c in curves))
    at = np.arange(1, POINTS + 1) / POINTS * top
    record, fine = (c.spline(at) for c in curves)
    return np.asarray(record / fine - 1.0)


def deviations_by_opening(point: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return w(record)/w(fine) − 1 (openings, POINTS) of a skin; None where it creases early."""
    x1, nu = 0.01 * 10.0 ** point[0], 0.22 + 0.22 * point[2]
    parameters = {
        "X1_MPa": x1,
        "X2_MPa": 0.3 * 20.0 ** point[1],
        "kappa_MPa": x1 * float(kappa_ratio(nu, "paper")),
    }
    found = []
    for aperture, pressure in OPENINGS:
        geometry = Geometry(aperture, 0.8 + 0.8 * point[3])
        record, fine = (
            solve(geometry, parameters, pressure, discretisation=mesh)
            for mesh in (MESH_OF_RECORD, VERIFICATION_MESH)
        )
        top = min(pressure, record.holds_to_mbar, fine.holds_to_mbar)
        if top < 0.95 * pressure:
            return None
        at = np.arange(1, POINTS + 1) / POINTS * top
        found.append(record.spline(at) / fine.spline(at) - 1.0)
    values = np.array(found)
    return values if np.abs(values).max() < 0.005 else None


def tops_of_another_program() -> NDArray[np.float64]:
    """Return w(other)/w(record) − 1 at the tops (skins, openings)."""
    rows = np.genfromtxt(TOPS, delimiter=",", names=True, skip_header=2)
    found = []
    for row in rows:
        parameters = {
            "X1_MPa": float(row["X1_MPa"]),
            "X2_MPa": float(row["X2_MPa"]),
            "kappa_MPa": float(row["X1_MPa"] * kappa_ratio(float(row["nu"]), "paper")),
        }
        geometry = Geometry(float(row["aperture_mm"]), float(row["thickness_mm"]))
        top = float(row["pressure_mbar"])
        record = solve(geometry, parameters, top, discretisation=MESH_OF_RECORD)
        found.append(1e-3 * row["deflection_um"] / float(record.spline(top)) - 1.0)
    return np.array(found).reshape(-1, len(OPENINGS))


def parts(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return root mean squares, over skins, of what openings (skins, openings, …) share and not."""
    common = values.mean(axis=1)
    own = ((values - common[:, None]) ** 2).sum(axis=1) / (values.shape[1] - 1)
    return np.sqrt((common**2).mean(axis=0)), np.sqrt(own.mean(axis=0))


def measure_openings(sets: int, seed: int) -> None:
    """Measure, print, save."""
    points = qmc.Sobol(4, rng=np.random.default_rng(seed)).random(sets)
    with ProcessPoolExecutor(WORKERS) as pool:
        found = np.array([v for v in pool.map(deviations_by_opening, points) if v is not None])
    shapes = legendre(np.arange(1, POINTS + 1) / POINTS, 8)
    flat = np.linalg.lstsq(shapes, found.reshape(-1, POINTS).T, rcond=None)[0].T
    common, own = parts(flat.reshape(len(found), len(OPENINGS), -1))
    other_common, other_own = parts(tops_of_another_program())
    # At the top a normalised polynomial of order k is sqrt(2 k + 1).
    at_top = 2.0 * np.arange(len(common)) + 1.0
    expected = [float(np.sqrt(at_top @ part**2)) for part in (common, own)]
    result = {
        "command": f"python benchmarks/model_error.py --openings --sets {sets} --seed {seed}",
        "skins": len(found),
        "left_out": int(sets - len(found)),
        "common_rms_relative_by_order": common.tolist(),
        "own_rms_relative_by_order": own.tolist(),
        "common_rms_relative_at_the_top": expected[0],
        "own_rms_relative_at_the_top": expected[1],
        "other_program_common_rms_relative_at_the_top": float(other_common),
        "other_program_own_rms_relative_at_the_top": float(other_own),
    }
    OPENINGS_RESULT.write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1))


CANNOT_LOCK = replace(
    VERIFICATION_MESH, name="cannot-lock", element=QUAD9_LINEAR_DILATATION, ratio=1.5, inside=0.1,
    outside=0.2, through=0.25, quarter_point=True,
)  # fmt: skip
KAPPA_EDGES = (3.3, 6.0, 12.0, 25.0, 50.0, 100.0, 300.0, 1001.0)
SHARES = (0.2, 0.4, 0.6, 0.8, 1.0)
WORKERS = int(os.environ.get("WORKERS", os.cpu_count() or 1))


def locked(point: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Return κ/X1, and w(record)/w(cannot lock) − 1 by orders (3,); NaN where either ends early."""
    ratio = 3.34 * (1000.0 / 3.34) ** point[2]
    geometry = Geometry((2.0, 4.0, 6.0, 8.0)[int(4 * point[3])], 0.8 + 0.8 * point[4])
    x1 = 0.005 * 40.0 ** point[0]
    x2 = x1 * 0.5 * 2000.0 ** point[1]
    parameters = {"X1_MPa": x1, "X2_MPa": x2, "kappa_MPa": x1 * ratio}
    skin = np.array([[x1, x2, float(nu_from_ratio(ratio, "paper"))]])
    limit = float(shipped_table().model(geometry, np.array([1.0])).holds_to(skin)[0])
    top = min(100.0, 0.3 * limit)
    curves = [
        solve(geometry, parameters, top, discretisation=mesh)
        for mesh in (MESH_OF_RECORD, CANNOT_LOCK)
    ]
    if any(c.holds_to_mbar < 0.999 * top for c in curves):
        return ratio, np.full(3, np.nan)
    at = np.arange(1, POINTS + 1) / POINTS * top
    record, fine = (c.spline(at) for c in curves)
    off = record / fine - 1.0
    return ratio, np.linalg.lstsq(legendre(at / top, 3), off, rcond=None)[0]


def near_crease(point: NDArray[np.float64]) -> list[float] | None:
    """Return w(record)/w(finer) − 1 at SHARES of the limit, NaN where either ends.

    None where the limit is not within 40 to 300 mbar.
    """
    geometry = Geometry((2.0, 4.0, 6.0, 8.0)[int(4 * point[3])], 0.8 + 0.8 * point[4])
    x1, nu = 0.005 * 40.0 ** point[0], 0.48 * point[2]
    x2 = x1 * 0.5 * 2000.0 ** point[1]
    table = shipped_table().model(geometry, np.array([1.0]))
    limit = float(table.holds_to(np.array([[x1, x2, nu]]))[0])
    if not 40.0 < limit < 300.0:
        return None
    parameters = {"X1_MPa": x1, "X2_MPa": x2, "kappa_MPa": x1 * float(kappa_ratio(nu, "paper"))}
    at = limit * np.array(SHARES)
    domes = []
    for mesh in (MESH_OF_RECORD, VERIFICATION_MESH):
        curve = solve(geometry, parameters, 1.05 * limit, discretisation=mesh)
        domes.append(np.where(at <= 1.01 * curve.holds_to_mbar, curve.spline(at), np.nan))
    found: list[float] = (domes[0] / domes[1] - 1.0).tolist()
    return found


def measure_locking(sets: int, seed: int) -> list[dict[str, object]]:
    """Return what is measured by κ/X1."""
    points = qmc.Sobol(5, rng=np.random.default_rng(seed)).random(sets)
    with ProcessPoolExecutor(WORKERS) as pool:
        found = list(pool.map(locked, points))
    ratio, off = np.array([k for k, _ in found]), np.array([c for _, c in found])
    rows: list[dict[str, object]] = []
    for low, high in pairwise(KAPPA_EDGES):
        inside = (ratio >= low) & (ratio < high) & np.isfinite(off).all(axis=1)
        if inside.any():
            assumed = locking(np.sqrt(low * high)) * np.array(LOCKING_SHAPES)
            rows.append(
                {
                    "kappa_over_X1": [low, high],
                    "skins": int(inside.sum()),
                    "mean_percent_by_order": (100 * off[inside].mean(axis=0)).round(3).tolist(),
                    "rms_percent_by_order": _rms_percent(off[inside]),
                    "largest_percent": round(100 * float(np.abs(off[inside]).max()), 3),
                    "assumed_percent_by_order": (100 * assumed).round(3).tolist(),
                }
            )
    return rows


def _rms_percent(off: NDArray[np.float64]) -> list[float]:
    found: list[float] = (100 * np.sqrt(np.square(off).mean(axis=0))).round(3).tolist()
    return found


def measure_law_range(sets: int, seed: int) -> None:
    """Measure, print, save."""
    points = qmc.Sobol(5, rng=np.random.default_rng(seed)).random(5 * sets)  # few of them crease
    with ProcessPoolExecutor(WORKERS) as pool:
        creasing = [v for v in pool.map(near_crease, points) if v is not None]
    rows = measure_locking(sets, seed)
    ratios = np.array(creasing)
    assumed = np.sqrt(np.square(crease_shapes(np.array(SHARES))).sum(axis=1))
    result = {
        "command": f"python benchmarks/model_error.py --law-range --sets {sets} --seed {seed}",
        "locking": rows,
        "creasing_skins": len(ratios),
        "near_crease": [
            {
                "share_of_limit": share,
                "skins": int(np.isfinite(column).sum()),
                "rms_percent": round(100 * float(np.sqrt(np.nanmean(column**2))), 3),
                "assumed_percent": round(100 * float(size), 3),
            }
            for share, column, size in zip(SHARES, ratios.T, assumed, strict=True)
        ],
    }
    LAW_RANGE_RESULT.write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1))


def main() -> None:
    """Measure, print, save."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=64)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--openings", action="store_true", help="what openings have in common")
    parser.add_argument("--law-range", action="store_true", help="by κ, and near a crease")
    parser.add_argument("--locking", action="store_true", help="by κ alone; saves beside the rest")
    arguments = parser.parse_args()
    if arguments.locking:
        saved = json.loads(LAW_RANGE_RESULT.read_text())
        saved["locking_command"] = (
            f"python benchmarks/model_error.py --locking --sets {arguments.sets} "
            f"--seed {arguments.seed}"
        )
        saved["locking"] = measure_locking(arguments.sets, arguments.seed)
        LAW_RANGE_RESULT.write_text(json.dumps(saved, indent=1) + "\n")
        print(json.dumps(saved["locking"], indent=1))
        return
    if arguments.law_range:
        measure_law_range(arguments.sets, arguments.seed)
        return
    if arguments.openings:
        measure_openings(arguments.sets, arguments.seed)
        return
    points = qmc.Sobol(5, rng=np.random.default_rng(arguments.seed)).random(arguments.sets)
    with ProcessPoolExecutor(WORKERS) as pool:
        found = np.array(list(pool.map(partial(deviation), points)))
    smooth = found[np.abs(found).max(axis=1) < 0.005]
    shapes = legendre(np.arange(1, POINTS + 1) / POINTS, 8)
    coefficients = np.linalg.lstsq(shapes, smooth.T, rcond=None)[0]
    rest = smooth.T - shapes @ coefficients
    result = {
        "command": f"python benchmarks/model_error.py --sets {arguments.sets} "
        f"--seed {arguments.seed}",
        "skins": arguments.sets,
        "near_a_crease": int(len(found) - len(smooth)),
        "rms_relative_by_order": [float(v) for v in np.sqrt((coefficients**2).mean(axis=1))],
        "median_rms_relative_rest": float(np.median(np.sqrt((rest**2).mean(axis=0)))),
        "largest_relative": float(np.abs(smooth).max()),
    }
    RESULT.write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
