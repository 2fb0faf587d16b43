"""Identification measured: optimum found, coverage of intervals, time against other optimisers.

    OPENBLAS_NUM_THREADS=1 python benchmarks/identification.py optimum [--curves 1000] [--seed 1]
    OPENBLAS_NUM_THREADS=1 python benchmarks/identification.py coverage [--curves 1000]
        [--seed 20290401] [--rows white_3,ou_0.3s] [--processes 2]
    OPENBLAS_NUM_THREADS=1 python benchmarks/identification.py sampler [--curves 50]
        [--seed 20290401]
    OPENBLAS_NUM_THREADS=1 python benchmarks/identification.py ranks [--seed 20290401 …]
    OPENBLAS_NUM_THREADS=1 python benchmarks/identification.py rivals [--curves 40] [--seed 3]

Each part prints and saves benchmarks/results/identification_PART.json; `coverage` runs some curves
of each row by turns, saves each row as a line of identification_coverage.jsonl, and goes on where
it ended (coverage.py has the rows, prior_skins.py the skins). Curves of the other parts are
computed by the finite elements directly, for skins drawn from the prior (flat in log X1, log X2/X1
and ν over the database's range, where the skin does not crease before 100 mbar), openings of 2, 4,
6 and 8 mm and thicknesses of 0.8–1.6 mm: 51 samples, 0–100 mbar. `rivals` needs the package cma,
`sampler` emcee (extra "bench"). `ranks` draws docs/pictures/ranks.svg and prints the tables of
docs/intervals.md, of coverage from its saved rows, of flags from the kept outcomes.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import coverage
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution, dual_annealing, least_squares

from skinlab.curves.curve import Curve, Setup
from skinlab.inference.identify import Identifier
from skinlab.inference.optimise import polish
from skinlab.inference.problem import Options, Problem
from skinlab.mechanics.fem.suction import Geometry, solve
from skinlab.mechanics.materials.compressibility import kappa_ratio
from skinlab.tables.store import shipped_table

RESULTS = Path(__file__).parent / "results"
PRESSURE = np.linspace(0.0, 100.0, 51)
NAMES = ("X1_MPa", "X2_MPa", "nu")
CLOSE_UM = 0.001

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Skin:
    """A drawn skin with its noise-free curve."""

    setup: Setup
    truth: Array
    deflection_mm: Array

    def curve(self, noise_um: float = 0.0, seed: int = 0) -> Curve:
        """Return the curve with noise."""
        noise = np.random.default_rng(seed).normal(0.0, 1e-3 * noise_um, len(PRESSURE))
        return Curve("drawn", self.setup, PRESSURE / 20.0, PRESSURE, self.deflection_mm + noise)


def draw(seed: int, number: int) -> Skin:
    """Return skin `number` of this seed; skins that crease before 100 mbar are drawn again."""
    rng = np.random.default_rng([seed, number])
    table = shipped_table()
    while True:
        setup = Setup(float(rng.choice([2.0, 4.0, 6.0, 8.0])), float(rng.uniform(0.8, 1.6)))
        geometry = Geometry(setup.aperture_mm, setup.thickness_mm)
        model = table.model(geometry, PRESSURE[-1:])
        truth = model.space.from_unit(rng.random(3))
        if not np.isfinite(model.deflection_mm(truth[None])).all():
            continue
        x1, x2, nu = (float(v) for v in truth)
        kappa = x1 * float(kappa_ratio(nu, "paper"))
        found = solve(geometry, {"X1_MPa": x1, "X2_MPa": x2, "kappa_MPa": kappa}, 100.0)
        deflection = found(PRESSURE)
        if np.isfinite(deflection).all():
            return Skin(setup, truth, deflection)


def problem_of(skin: Skin, curve: Curve) -> Problem:
    """Return the problem that identification solves for this curve."""
    geometry = Geometry(skin.setup.aperture_mm, skin.setup.thickness_mm)
    model = shipped_table().model(geometry, PRESSURE)
    return Problem(model.space, model.misfit(curve.deflection_mm), len(PRESSURE))


# ---- does auto find the optimum? -----------------------------------------------------------------


def optimum_of_one(seed: int, number: int) -> dict[str, float]:
    """Return E of auto, and of the best that a search without regard to time finds."""
    skin = draw(seed, number)
    curve = skin.curve()
    found = Identifier(shipped_table())(curve)
    problem = problem_of(skin, curve)
    space = problem.space
    rng = np.random.default_rng([seed, number, 1])
    starts = rng.random((20_000, 3))
    cost = problem.misfit(space.from_unit(starts))
    best = starts[np.argsort(cost)[:150]]
    polished = polish(space, problem.misfit, best, most_iterations=400)
    evolved = differential_evolution(
        lambda u: problem.misfit(space.from_unit(np.clip(u.T, 0, 1))),
        [(0.0, 1.0)] * 3,
        vectorized=True,
        updating="deferred",
        popsize=40,
        maxiter=150,
        tol=1e-12,
        polish=False,
        rng=rng,
    )
    again = polish(space, problem.misfit, np.array([evolved.x, space.to_unit(skin.truth)]))
    least = min(float(polished.cost.min()), float(again.cost.min())) + problem.misfit.rest
    return {
        "auto_um": float(found.error_um or np.nan),
        "best_um": 1e3 * float(np.sqrt(least)) / len(PRESSURE),
        "seconds": found.seconds,
    }


def optimum(curves: int, seed: int) -> dict[str, Any]:
    """Return how often auto is within 0.001 µm of the best."""
    rows = _each(partial(optimum_of_one, seed), curves)
    excess = np.array([r["auto_um"] - r["best_um"] for r in rows])
    return {
        "curves": curves,
        "within_um": CLOSE_UM,
        "found": int((excess < CLOSE_UM).sum()),
        "share": float((excess < CLOSE_UM).mean()),
        "largest_excess_um": float(excess.max()),
        "missed": np.flatnonzero(excess >= CLOSE_UM).tolist(),
        "median_seconds": statistics.median(r["seconds"] for r in rows),
    }


# ---- against other optimisers --------------------------------------------------------------------


def rivals(curves: int, seed: int) -> dict[str, Any]:
    """Return time, evaluations and success of several searches on the same misfits, one core."""
    skins = [draw(seed, i) for i in range(curves)]
    measured = [s.curve(3.0, seed=i) for i, s in enumerate(skins)]
    problems = [problem_of(s, c) for s, c in zip(skins, measured, strict=True)]
    best = [_reference(p, i) for i, p in enumerate(problems)]
    table: dict[str, Any] = {}
    for name, method in _METHODS.items():
        seconds, evaluations, close = [], [], 0
        for i, problem in enumerate(problems):
            began = time.perf_counter()
            error_um, spent = method(problem, i)
            seconds.append(time.perf_counter() - began)
            evaluations.append(spent)
            close += error_um < best[i] + CLOSE_UM
        table[name] = {
            "median_ms": 1e3 * statistics.median(seconds),
            "median_evaluations": statistics.median(evaluations),
            "success": close / curves,
        }
    reference = table["auto"]["median_ms"]
    for row in table.values():
        row["time_over_auto"] = row["median_ms"] / reference
    whole = _whole_identification(measured)
    return {"curves": curves, "noise_um": 3.0, "searches": table, "identification_ms": whole}


def _whole_identification(measured: list[Curve]) -> dict[str, float]:
    """Return medians in ms of what a user waits for, database preparation included."""
    table = shipped_table()
    Identifier(table)(measured[0])
    found: dict[str, float] = {}
    for name, identifier in {
        "auto with intervals": Identifier(table),
        "sto, N = 1000": Identifier(table, method="sto"),
    }.items():
        found[name] = 1e3 * statistics.median(identifier(c).seconds for c in measured)
    identifier = Identifier(table)
    began = time.perf_counter()
    for i in range(300):
        identifier(measured[i % len(measured)])
    found["300 curves, auto with intervals"] = 1e3 * (time.perf_counter() - began)
    growing = []
    for curve in measured:
        previous = None
        for end in range(10, len(PRESSURE) + 1, 5):
            part = Curve(
                "growing", curve.setup, curve.time_s[:end], curve.pressure_mbar[:end],
                curve.deflection_mm[:end], partial=True,
            )  # fmt: skip
            began = time.perf_counter()
            previous = identifier.growing(part, previous)
            growing.append(time.perf_counter() - began)
    found["growing curve"] = 1e3 * statistics.median(growing)
    return found


def _reference(problem: Problem, seed: int) -> float:
    rng = np.random.default_rng(seed)
    found = polish(problem.space, problem.misfit, rng.random((300, 3)), most_iterations=400)
    return 1e3 * float(np.sqrt(found.cost.min() + problem.misfit.rest)) / problem.points


def _ours(name: str, problem: Problem, seed: int) -> tuple[float, int]:
    from skinlab.inference.methods import get_method

    found = get_method(name)(problem, Options(), np.random.default_rng(seed))
    return found.error_um, found.evaluations


def _unit_misfit(problem: Problem) -> Callable[[Array], Array]:
    """Return the misfit (n,) over points (n, 3) of the unit cube, large where there is no model."""
    return lambda unit: np.nan_to_num(
        problem.misfit(problem.space.from_unit(np.clip(unit, 0.0, 1.0))), posinf=1e6
    )


def _error_um(problem: Problem, unit: Array) -> float:
    return float(problem.error_um(problem.space.from_unit(np.clip(unit, 0, 1)[None]))[0])


_CANDIDATES = 15  # of each unknown: scipy's default


def _differential_evolution(problem: Problem, seed: int) -> tuple[float, int]:
    misfit = _unit_misfit(problem)
    found = differential_evolution(
        lambda u: misfit(u.T), [(0.0, 1.0)] * 3, vectorized=True, updating="deferred",
        tol=1e-10, polish=False, rng=np.random.default_rng(seed), maxiter=1000, popsize=_CANDIDATES,
    )  # fmt: skip
    # It counts a whole population as one evaluation.
    return _error_um(problem, found.x), int(found.nfev) * 3 * _CANDIDATES


def _dual_annealing(problem: Problem, seed: int) -> tuple[float, int]:
    misfit = _unit_misfit(problem)
    found = dual_annealing(
        lambda u: float(misfit(u[None])[0]), [(0.0, 1.0)] * 3, rng=np.random.default_rng(seed)
    )
    return _error_um(problem, found.x), int(found.nfev)


def _multi_start(problem: Problem, seed: int) -> tuple[float, int]:
    rng = np.random.default_rng(seed)
    space = problem.space

    def residuals(unit: Array) -> Array:
        r = problem.residuals(space.from_unit(unit))
        return r if np.isfinite(r).all() else np.full(len(r), 1e3)

    best, spent = np.inf, 0
    for start in rng.uniform(0.02, 0.98, (10, 3)):
        found = least_squares(residuals, start, bounds=(0.0, 1.0), xtol=1e-12, ftol=1e-12)
        best = min(best, _error_um(problem, found.x))
        spent += 4 * int(found.nfev)
    return best, spent


def _cma(problem: Problem, seed: int) -> tuple[float, int]:
    import cma

    misfit = _unit_misfit(problem)
    options = {"bounds": [0, 1], "seed": seed + 1, "verbose": -9, "tolfun": 1e-14, "tolx": 1e-10}
    search = cma.CMAEvolutionStrategy([0.5, 0.5, 0.5], 0.25, options)
    while not search.stop():
        asked = search.ask()
        search.tell(asked, misfit(np.array(asked)).tolist())
    return _error_um(problem, np.array(search.result.xbest)), int(search.result.evaluations)


_METHODS: dict[str, Callable[[Problem, int], tuple[float, int]]] = {
    "auto": partial(_ours, "auto"),
    "sto": partial(_ours, "sto"),
    "hka": partial(_ours, "hka"),
    "lm": partial(_ours, "lm"),
    "scipy differential evolution": _differential_evolution,
    "scipy dual annealing": _dual_annealing,
    "multi-start least squares (10)": _multi_start,
    "CMA-ES (pycma)": _cma,
}


def _sampler(curves: int, seed: int) -> dict[str, Any]:
    from reference_sampler import sampler  # needs emcee

    return sampler(curves, seed)


def _each(function: Callable[[int], dict[str, Any]], count: int) -> list[dict[str, Any]]:
    with ProcessPoolExecutor() as pool:
        return list(pool.map(function, range(count), chunksize=10))


def main() -> None:
    """Measure one part, print and save it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=["optimum", "coverage", "ranks", "sampler", "rivals"])
    parser.add_argument("--curves", type=int)
    parser.add_argument("--seed", type=int, nargs="+", help="of ranks, several: all their curves")
    parser.add_argument("--rows", help="of coverage, separated by commas; all without")
    parser.add_argument("--processes", type=int, default=1, help="of coverage")
    arguments = parser.parse_args()
    seeds = arguments.seed or [coverage.SEED]
    if arguments.part == "ranks":
        coverage.draw_ranks(seeds)
        print(f"{coverage.table(seeds)}\n\n{coverage.power(seeds)}")
        return
    if len(seeds) > 1:
        parser.error(f"{arguments.part} takes one seed")
    if arguments.part == "coverage":
        names = arguments.rows.split(",") if arguments.rows else list(coverage.ROWS)
        coverage.run(names, arguments.curves or 1000, seeds[0], processes=arguments.processes)
        return
    part, curves, seed = {
        "optimum": (optimum, 1000, 1),
        "sampler": (_sampler, 50, coverage.SEED),
        "rivals": (rivals, 40, 3),
    }[arguments.part]
    curves = arguments.curves or curves
    seed = arguments.seed[0] if arguments.seed else seed
    result = {
        "command": f"python benchmarks/identification.py {arguments.part} --curves {curves} "
        f"--seed {seed}",
        **part(curves, seed),
    }
    text = json.dumps(result, indent=1)
    (RESULTS / f"identification_{arguments.part}.json").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
