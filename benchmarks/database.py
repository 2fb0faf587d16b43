"""The dimensionless table against direct finite elements, and its speed. Prints and saves JSON.

    python benchmarks/database.py [--points 500] [--seed 0]

Points: log-uniform in X1, X2/X1 and h/R, uniform in ν (both conventions in turn) and in pressure to
500 mbar, from where the table holds; the opening is one of 2, 4, 6 and 8 mm.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from skinlab.mechanics.fem.suction import Geometry, solve
from skinlab.mechanics.materials.compressibility import kappa_ratio
from skinlab.tables import store

RESULT = Path(__file__).parent / "results" / "database.json"


def draw(points: int, seed: int) -> tuple[list[dict[str, Any]], float]:
    """Return points that the table holds, with its deflections (mm), and their share of draws."""
    table = store.shipped_table()
    rng = np.random.default_rng(seed)
    spec = table.spec
    found: list[dict[str, Any]] = []
    drawn = 0
    while len(found) < points:
        drawn += 1
        convention = ("paper", "consistent")[drawn % 2]
        x1 = float(np.exp(rng.uniform(*np.log(spec.scale_mpa))))
        ratio = float(np.exp(rng.uniform(np.log(0.5), np.log(1000))))
        nu = float(rng.uniform(0.0, 0.499))
        thin, thick = spec.thickness.low, spec.thickness.high
        thickness = float(np.exp(rng.uniform(np.log(thin), np.log(thick))))
        pressure = float(rng.uniform(0, 500))
        aperture = float(rng.choice([2.0, 4.0, 6.0, 8.0]))
        geometry = Geometry(aperture, thickness * aperture / 2)
        model = table.model(geometry, np.array([pressure]), convention)
        w = float(model.deflection_mm(np.array([[x1, x1 * ratio, nu]]))[0, 0])
        if np.isfinite(w) and not model.creases(np.array([[x1, x1 * ratio, nu]]))[0]:
            kappa = x1 * float(kappa_ratio(nu, convention))
            found.append(
                {
                    "X1_MPa": x1, "X2_MPa": x1 * ratio, "kappa_MPa": kappa, "table_mm": w,
                    "aperture_mm": aperture, "thickness_mm": geometry.thickness_mm,
                    "pressure_mbar": pressure,
                }
            )  # fmt: skip
    return found, points / drawn


def direct(point: dict[str, Any]) -> float:
    """Return the deflection (mm) by finite elements on the mesh of record; NaN where it creases."""
    names = ("X1_MPa", "X2_MPa", "kappa_MPa")
    geometry = Geometry(point["aperture_mm"], point["thickness_mm"])
    curve = solve(geometry, {name: point[name] for name in names}, point["pressure_mbar"])
    return float(curve(point["pressure_mbar"]))


def median_ms(call: Callable[[], object], times: int = 21) -> float:
    """Return the median time of a call, ms."""
    spent = []
    for _ in range(times):
        begin = time.perf_counter()
        call()
        spent.append(time.perf_counter() - begin)
    return 1e3 * statistics.median(spent)


def speed() -> dict[str, float]:
    """Return medians on this machine, one core."""
    table = store.shipped_table()
    geometry, pressure = Geometry(6.0, 1.0), np.linspace(0, 100, 51)
    model = table.model(geometry, pressure)
    truth = np.array([[0.03, 1.0, 0.32]])
    misfit = model.misfit(model.deflection_mm(truth)[0])
    rng = np.random.default_rng(0)
    cloud = model.space.from_unit(rng.random((4000, 3)))
    cloud = cloud[np.isfinite(misfit(cloud))][:1000]
    return {
        "load_ms": median_ms(store.shipped_table.__wrapped__),
        "prepare_51_points_ms": median_ms(lambda: table.model(geometry, pressure)),
        "misfit_1000_candidates_ms": median_ms(lambda: misfit(cloud)),
        "slopes_1000_candidates_ms": median_ms(lambda: misfit.slopes(cloud)),
    }


def main() -> None:
    """Run, print, save."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    points, share = draw(arguments.points, arguments.seed)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        exact = np.array(list(pool.map(direct, points, chunksize=8)))
    w = np.array([point["table_mm"] for point in points])
    creased = ~np.isfinite(exact)
    error_um = np.abs(w - exact)[~creased] * 1e3
    relative = np.abs(w / exact - 1)[~creased]
    within = (error_um <= 1.0) | (relative <= 5e-4)
    result = {
        "points": len(points),
        "seed": arguments.seed,
        "share_of_draws_that_hold": round(share, 3),
        "creased_where_the_table_holds": int(creased.sum()),
        "median_error_um": float(np.median(error_um)),
        "p99_error_um": float(np.percentile(error_um, 99)),
        "largest_error_um": float(error_um.max()),
        "within_1_um_or_0.05_percent": float(within.mean()),
        "database": store.shipped_table().content_hash,
        **{name: round(value, 2) for name, value in speed().items()},
    }
    text = json.dumps(result, indent=1)
    print(text)
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(text + "\n")


if __name__ == "__main__":
    main()
