"""The missing-effect workflow on domes of another finite-element program, with errors as in life.

    OPENBLAS_NUM_THREADS=1 python benchmarks/other_program.py [--draws 3] [--seed 1] [--workers 2]

The 45 skins of data/other_program_domes.csv (`other_program_domes.py`): 12 with nothing hidden, 30
with one of ten effects, three whose upper half is stiffer, which the library does not have. Each is
measured `draws` times, with errors of life drawn anew (`challenge/campaigns.py`), one to three
placements under 6, 2 and 8 mm. All skins are elastic: effects of time but for the regulator's lag
are not among them, nor is the thickness of a placement. Lines are added to
results/other_program.jsonl as they come, and a run goes on where it ended; prints and saves
results/other_program.json.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import statistics
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from challenge.campaigns import LIFE, Life, Truth, readings
from challenge.score import share
from numpy.typing import NDArray
from other_program_domes import DOMES, TRUTH
from scipy.interpolate import CubicSpline

from skinlab.curves.campaign import Campaign
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.discrepancy.workflow import explain
from skinlab.mechanics.effects.model import Skin, felt_path, forget
from skinlab.tables.store import shipped_table

Array = NDArray[np.float64]

RESULTS = Path(__file__).parent / "results"
LINES, SUMMARY = RESULTS / "other_program.jsonl", RESULTS / "other_program.json"
OUTSIDE = "two_layers"


@cache
def domes() -> dict[tuple[int, float], CubicSpline]:
    """Return deflections, mm, as functions of suction, mbar, by skin and opening."""
    rows: dict[tuple[int, float], list[tuple[float, float]]] = {}
    with DOMES.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            key = int(row["number"]), float(row["aperture_mm"])
            point = float(row["pressure_mbar"]), float(row["deflection_mm"])
            rows.setdefault(key, []).append(point)
    return {key: CubicSpline(*np.array(points).T) for key, points in rows.items()}


def campaign(of: dict[str, Any], seed: int, draw: int) -> tuple[Campaign, Life]:
    """Return a campaign of one skin, and its errors."""
    rng = np.random.default_rng([seed, of["number"], draw])
    life = replace(Life.drawn(rng, int(rng.integers(45))), thickness=0.0)
    white, noise_mbar = round(float(rng.uniform(2, 5)), 1), round(float(rng.uniform(0.1, 0.3)), 2)
    stated = bool(rng.random() < 0.5)
    truth = Truth(
        Skin(tuple(of["skin"])), {}, "", 0.0, of["thickness_mm"], white, noise_mbar, stated, life
    )
    curves = []
    for repeat in range(1, int(rng.choice([1, 2, 3, 3])) + 1):
        for aperture, text, cycle in LIFE:
            program = parse_program(text)
            t = life.times_s(program.duration_s, rng)
            path = PressurePath.of_program(program)
            if life.lag_s:  # measured truly
                path = felt_path({"regulator_lag": {"tau_s": life.lag_s}}, path)
            w = deflections(of, aperture, path, t, float(np.exp(life.stiffness * rng.normal())))
            offset_mm = 1e-3 * life.offset_um * rng.normal()
            p, read = readings(truth, life, t, path(t), w, offset_mm, rng)
            setup = Setup(aperture, of["thickness_mm"], program, cycle, repeat)
            curves.append(Curve(f"d{aperture:g}_{repeat}.csv", setup, t, p, read))
    told = (white, noise_mbar) if stated else (None, None)
    return Campaign("other program", *told, tuple(curves)), life


def deflections(
    of: dict[str, Any], aperture_mm: float, path: PressurePath, t: Array, stiffer: float
) -> Array:
    """Return a curve without errors (n,), mm, of a place so many times as stiff."""
    values, dome = of["values"], domes()[of["number"], aperture_mm]
    if of["kind"] == "regulator_lag":
        path = felt_path({"regulator_lag": values}, path)
    before = values.get("p0_mbar", 0.0)
    w = dome((np.maximum(path(t), 0.0) + before) / stiffer) - dome(before / stiffer)
    return np.asarray(values.get("gain", 1.0) * w)


def judge(of: dict[str, Any], seed: int, draw: int) -> dict[str, Any]:
    """Return the line of one campaign."""
    made, life = campaign(of, seed, draw)
    forget()
    begin = time.process_time()
    outcome = explain(made, shipped_table())
    return {
        "number": of["number"], "draw": draw, "seed": seed, "kind": of["kind"],
        "values": of["values"], "skin": of["skin"], "errors": life.kind, "rate_hz": life.rate_hz,
        "placements": len(made.curves) // len(LIFE), "verdict": outcome.verdict.name,
        "effects": [sorted(c.effects) for c in outcome.verdict.explanations],
        "parameters": outcome.parameters(outcome.best),
        "cpu_seconds": time.process_time() - begin,
    }  # fmt: skip


def figures(lines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the figures, shares with 90 % intervals."""
    none = [x for x in lines if x["kind"] == "none"]
    outside = [x for x in lines if x["kind"] == OUTSIDE]
    one = [x for x in lines if x["kind"] not in ("none", OUTSIDE)]
    named = [x for x in none + one if x["verdict"] == "named"]
    tied = [x for x in one if x["verdict"] == "ambiguous"]
    held = [x for x in none if x["verdict"] == "none"] + [x for x in named if _right(x)]
    found: dict[str, Any] = {
        "nothing_hidden_named": share(x["verdict"] == "named" for x in none),
        "nothing_hidden_not_none": share(x["verdict"] != "none" for x in none),
        "names_right": share(_right(x) for x in named),
        "one_hidden_named": share(x["verdict"] == "named" for x in one),
        "truth_among_tied": share([x["kind"]] in x["effects"] for x in tied),
        "outside_named": share(x["verdict"] == "named" for x in outside),
    }
    for i, name in enumerate(("X1_MPa", "X2_MPa", "nu")):
        found[f"interval_holds_{name}"] = share(
            x["parameters"][name]["low"] <= x["skin"][i] <= x["parameters"][name]["high"]
            for x in held
        )
    for name, some in (("none", none), ("one_hidden", one)):
        seconds = [x["cpu_seconds"] for x in some]
        found[f"cpu_seconds_{name}_median"] = statistics.median(seconds) if seconds else None
    return found


def _right(line: dict[str, Any]) -> bool:
    return bool(line["effects"] == [[line["kind"]]])


def _known(seed: int) -> Iterator[dict[str, Any]]:
    if LINES.exists():
        for line in LINES.read_text(encoding="utf-8").splitlines():
            if (one := json.loads(line))["seed"] == seed:
                yield one


def main() -> None:
    """Run what is missing, print and save."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    lines = list(_known(arguments.seed))
    done = {(x["number"], x["draw"]) for x in lines}
    every = json.loads(TRUTH.read_text(encoding="utf-8"))
    with ProcessPoolExecutor(arguments.workers) as pool, LINES.open("a", encoding="utf-8") as file:
        tasks = [
            pool.submit(judge, of, arguments.seed, draw)
            for draw in range(arguments.draws)
            for of in every
            if (of["number"], draw) not in done
        ]
        for task in as_completed(tasks):
            line = task.result()
            lines.append(line)
            file.write(json.dumps(line) + "\n")
            file.flush()
            print(line["number"], line["kind"], line["errors"], line["verdict"], line["effects"])
    found = {"seed": arguments.seed, "campaigns": len(lines), "figures": figures(lines)}
    SUMMARY.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
