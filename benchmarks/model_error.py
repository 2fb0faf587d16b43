"""How far the mesh of record is from a fine mesh, as a shape: what the noise model takes from it.

    python benchmarks/model_error.py [--sets 64] [--seed 3]

Skins: log-uniform in X1 (0.005–0.2 MPa) and X2/X1 (0.5–1000), uniform in ν (0.2–0.48) and in
thickness (0.8–1.6 mm), openings of 2, 4, 6 and 8 mm, to 100 mbar or to where either mesh ends.
The relative deviation from the 9-node mesh of verification is fitted by shifted Legendre
polynomials of p/p_max, normalised to a mean square of 1; the root mean squares of the
coefficients over the skins are saved. Skins whose last tenth is on the way to a crease (deviation
above 0.5 %) are left out and counted. Takes about three minutes.
"""

from __future__ import annotations

import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from skinlab.fem.suction import MESH_OF_RECORD, VERIFICATION_MESH, Geometry, solve
from skinlab.identify.noise import legendre
from skinlab.materials.compressibility import kappa_ratio

RESULT = Path(__file__).parent / "results" / "model_error.json"
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


def main() -> None:
    """Measure, print, save."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=64)
    parser.add_argument("--seed", type=int, default=3)
    arguments = parser.parse_args()
    points = qmc.Sobol(5, rng=np.random.default_rng(arguments.seed)).random(arguments.sets)
    with ProcessPoolExecutor() as pool:
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
