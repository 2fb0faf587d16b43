"""Studies measured: intervals of variance components, narrowing by a prior, time a curve.

    OPENBLAS_NUM_THREADS=1 python benchmarks/study.py components [--cohorts 200] [--seed 1]
    OPENBLAS_NUM_THREADS=1 python benchmarks/study.py simulated [--cohorts 200] [--seed 1]
    OPENBLAS_NUM_THREADS=1 python benchmarks/study.py prior [--cohorts 10] [--people 60] [--seed 1]
    OPENBLAS_NUM_THREADS=1 python benchmarks/study.py speed [--people 625]

Each part prints and saves benchmarks/results/study_PART.json; `simulated` appends each cohort's
values to study_simulated.jsonl when it is done, and goes on where it ended.

`components`: small cohorts with known components, as the simulator's (people, two sites, two
visits, operators, probes, placements), whole and with 15 % of their curves lost. How often the 90 %
intervals of variances, shares, ICC and MDC hold the true value.

`simulated`: the same of cohorts that the simulator measures (finite elements, noise, resolution of
the sensors), each curve identified anew (`lm`, for its speed): the components of log X1. What lies
within a placement is the noise of the identification, of which nobody knows the truth.

`prior`: cohorts of the simulator, curves by finite elements. A population is learned from some of
the people and used for others: how often their 90 % intervals contain the true value, and how much
narrower they are than without it.

`speed`: 16 curves of each person through `skinlab study`, 50 broken files among them, killed twice.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from sim_device.cohort import Cohort, CohortFile, Shifts, Size, write_cohort
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.inference.identify import Identifier
from skinlab.inference.population import Prior, with_prior
from skinlab.studies.components import components, interval
from skinlab.studies.compute import draws_of
from skinlab.studies.design import WITHIN, effect
from skinlab.studies.population import Posterior, learn, to_toml
from skinlab.tables.store import shipped_table

RESULTS = Path(__file__).parent / "results"
LINES = RESULTS / "study_simulated.jsonl"

TRUE = {
    "subject": 0.25,
    "subject:site": 0.10,
    "visit": 0.06,
    "operator": 0.03,
    "probe": 0.04,
    "placement": 0.06,
    WITHIN: 0.05,
}


def small_cohort(rng: np.random.Generator, people: int, lost: float) -> tuple[Any, Any]:
    """Return values (n,) and the effects of one cohort."""
    grid = np.array(
        [
            (s, i, v, (p + v + s) % 3, (p // 3 + v + i + s) % 2, p, c)
            for s in range(people)
            for i in range(2)
            for v in range(2)
            for p in range(2)
            for c in range(2)
        ]
    )
    grid = grid[rng.random(len(grid)) >= lost]
    s, i, v, o, b, p, _ = grid.T
    effects = [
        effect("subject", s),
        effect("subject:site", s, i),
        effect("visit", s, v),
        effect("operator", o),
        effect("probe", b),
        effect("placement", s, i, v, o, b, p),
    ]
    values = rng.normal(0.0, TRUE[WITHIN], len(grid))
    for one in effects:
        values += rng.normal(0.0, TRUE[one.name], one.levels)[one.codes]
    return values, effects


def measure_components(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return how often intervals hold the truth."""
    true = {name: sd**2 for name, sd in TRUE.items()}
    total = sum(true.values())
    between, error = (
        ("subject", "subject:site"),
        ("visit", "operator", "probe", "placement", WITHIN),
    )
    icc = sum(true[n] for n in between) / total
    mdc = 1.96 * np.sqrt(2.0 * sum(true[n] for n in error))
    result: dict[str, Any] = {"true_sd": TRUE, "people": arguments.people}
    for kind, lost in (("whole", 0.0), ("15 % lost", 0.15)):
        held: dict[str, int] = {}
        for k in range(arguments.cohorts):
            rng = np.random.default_rng([arguments.seed, k])
            found = components(*small_cohort(rng, arguments.people, lost), seed=k)
            for part in found.parts:
                held[part.name] = held.get(part.name, 0) + (
                    part.low <= true[part.name] <= part.high
                )
                share = true[part.name] / total
                name = f"share of {part.name}"
                held[name] = held.get(name, 0) + (part.share_low <= share <= part.share_high)
            e, b = found.drawn(error), found.drawn(between)
            estimate = found.variance(between)
            low, high = interval(b / (b + e), estimate / (estimate + found.variance(error)))
            held["ICC(2,1)"] = held.get("ICC(2,1)", 0) + (low <= icc <= high)
            ends = found.sum_interval(dict.fromkeys(error, 1.0))
            low, high = (1.96 * np.sqrt(2.0 * end) for end in ends)
            held["MDC95"] = held.get("MDC95", 0) + (low <= mdc <= high)
        result[kind] = {name: count / arguments.cohorts for name, count in held.items()}
    return result


SIMULATED = {
    "subject": 0.25,
    "subject:site": 0.10,
    "visit": 0.06,
    "operator": 0.03,
    "probe": 0.04,
}


NAMES = ("subject", "site", "visit", "operator", "probe")


def _simulated_cohort(people: int, seed: int) -> dict[str, Any]:
    """Return the log X1 that each curve of a cohort gives, behind its labels (numbers from 0)."""
    spec = CohortFile(
        cohort=Size(people=people),
        subject=Shifts(X1=SIMULATED["subject"], X2=0.25, nu=0.02),
        subject_site=Shifts(stiffness=SIMULATED["subject:site"]),
        visit=Shifts(stiffness=SIMULATED["visit"]),
        operator=Shifts(stiffness=SIMULATED["operator"]),
        probe=Shifts(stiffness=SIMULATED["probe"]),
        placement=Shifts(stiffness=0.06),
    )
    identifier = Identifier(shipped_table(), method="lm")
    known: dict[str, list[Any]] = {name: [] for name in NAMES}
    curves = []
    for measured in Cohort(spec, seed).curves():
        setup = Setup(6.0, float(measured.labels["thickness_mm"]), parse_program("ramp:100@20"))
        result = identifier(
            Curve(
                measured.file,
                setup,
                measured.time_s,
                measured.pressure_mbar,
                measured.deflection_mm,
            )
        )
        if not result.parameters:
            continue
        row: list[float] = []
        for name, levels in known.items():
            if measured.labels[name] not in levels:
                levels.append(measured.labels[name])
            row.append(levels.index(measured.labels[name]))
        curves.append([*row, round(float(np.log(result.parameters["X1_MPa"].value)), 6)])
    return {"people": people, "seed": seed, "curves": curves}


def _intervals(cohort: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Return the 90 % interval of each component's standard deviation, of log X1."""
    *labels, values = np.array(cohort["curves"]).T
    subject, site, visit, operator, probe = labels
    effects = [
        effect("subject", subject),
        effect("subject:site", subject, site),
        effect("visit", subject, visit),
        effect("operator", operator),
        effect("probe", probe),
    ]
    found = components(values, effects, seed=cohort["seed"])
    return {
        part.name: (math.sqrt(part.low), math.sqrt(part.high))
        for part in found.parts
        if part.name in SIMULATED
    }


def measure_simulated(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return how often intervals hold the truth, of cohorts measured by the simulator."""
    seeds = [1000 * arguments.seed + k for k in range(arguments.cohorts)]
    done = {
        row["seed"]: row
        for row in map(json.loads, LINES.read_text().splitlines() if LINES.exists() else ())
        if row["people"] == arguments.people
    }
    missing = [seed for seed in seeds if seed not in done]
    RESULTS.mkdir(exist_ok=True)
    with ProcessPoolExecutor(arguments.workers) as pool, LINES.open("a", encoding="utf-8") as out:
        for row in pool.map(partial(_simulated_cohort, arguments.people), missing):
            done[row["seed"]] = row
            print(json.dumps(row, separators=(",", ":")), file=out, flush=True)
            print(f"{len(done)} of {len(seeds)}", file=sys.stderr)
    held: dict[str, list[bool]] = {}
    for seed in seeds:
        for name, (low, high) in _intervals(done[seed]).items():
            held.setdefault(name, []).append(low <= SIMULATED[name] <= high)
    return {
        "true_sd": SIMULATED,
        "cohorts": len(seeds),
        "curves": sum(len(done[seed]["curves"]) for seed in seeds),
        "intervals that hold the truth": {n: float(np.mean(h)) for n, h in held.items()},
        "cohorts that tell the component": {n: len(h) for n, h in held.items()},
        "all of them": float(np.mean([inside for h in held.values() for inside in h])),
    }


def _skins(seed: int, people: int) -> Any:
    """Return a cohort of the simulator without errors of sensors: one placement at two sites."""
    return Cohort(
        CohortFile(
            cohort=Size(people=people, visits=1, placements=1, operators=1, probes=1),
            subject=Shifts(X1=0.25, X2=0.3, nu=0.025),
            subject_site=Shifts(stiffness=0.1),
            visit=Shifts(),
            operator=Shifts(),
            probe=Shifts(),
            placement=Shifts(stiffness=0.06),
        ),
        seed,
    )


def _one_cohort(people: int, seed: int) -> list[dict[str, Any]]:
    """Return what the prior of two thirds of the people makes of each curve of the others."""
    identifier = Identifier(shipped_table())
    learned, others = [], []
    for number, measured in enumerate(_skins(seed, people).curves()):
        labels = measured.labels
        setup = Setup(6.0, float(labels["thickness_mm"]), parse_program("ramp:100@20"))
        curve = Curve(
            measured.file, setup, measured.time_s, measured.pressure_mbar, measured.deflection_mm
        )
        if number < 2 * (2 * people // 3):
            draws = draws_of(identifier(curve))
            learned.append(Posterior(str(labels["subject"]), str(labels["site"]), None, draws))
        else:
            others.append((curve, measured.true))
    names = ("X1_MPa", "X2_MPa", "nu")
    file = learn(learned, names, identifier.provenance().model_hash, "benchmark")
    knowing = with_prior(identifier, Prior(file, to_toml(file)))
    rows = []
    for curve, true in others:
        alone, known = identifier(curve), knowing(curve)
        row: dict[str, Any] = {"unlike": "unlike_cohort" in known.flags}
        for name in names:
            for kind, answer in (("alone", alone), ("prior", known)):
                value = answer.parameters[name]
                row[f"{kind} {name}"] = [true[name], value.value, value.low, value.high]
        rows.append(row)
    return rows


def measure_prior(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return coverage and widths of intervals with and without a population as prior."""
    seeds = [1000 * arguments.seed + k for k in range(arguments.cohorts)]
    with ProcessPoolExecutor(arguments.workers) as pool:
        found = list(pool.map(partial(_one_cohort, arguments.people), seeds))
    rows = [row for cohort in found for row in cohort]
    result: dict[str, Any] = {
        "cohorts": arguments.cohorts,
        "curves": len(rows),
        "called unlike the cohort": float(np.mean([row["unlike"] for row in rows])),
    }
    for name in ("X1_MPa", "X2_MPa", "nu"):
        widths = {}
        for kind in ("alone", "prior"):
            true, value, low, high = np.array([row[f"{kind} {name}"] for row in rows]).T
            widths[kind] = np.log(high / low) if name != "nu" else high - low
            result[f"{name} {kind}: intervals that hold the truth"] = float(
                np.mean((low <= true) & (true <= high))
            )
            error = np.log(value / true) if name != "nu" else value - true
            result[f"{name} {kind}: root mean square error"] = float(np.sqrt(np.mean(error**2)))
        result[f"{name}: median width with the prior, of that without"] = float(
            np.median(widths["prior"]) / np.median(widths["alone"])
        )
    return result


def measure_speed(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return time and memory of `skinlab study` on a folder of curves, killed twice."""
    folder = Path(tempfile.mkdtemp(prefix="skinlab-speed-"))
    spec = CohortFile(cohort=Size(people=arguments.people, placements=4))
    count = write_cohort(spec, folder / "curves", arguments.seed, broken=50)
    out = folder / "study"
    command = [sys.executable, "-m", "skinlab", "study", str(folder / "curves"), "--out", str(out)]
    command += ["--workers", "2", "--resume"]
    seconds, memory_mb, kept_at_kill = 0.0, [], []
    for part in (0.3, 0.6, None):
        begin = time.perf_counter()
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        while process.poll() is None:
            time.sleep(1.0)
            kept = _kept(out)
            memory_mb.append(_resident_mb(process.pid))
            if part is not None and kept >= part * count:
                process.kill()
                process.wait()
                kept_at_kill.append(kept)
        seconds += time.perf_counter() - begin
    with (out / "curves.csv").open(encoding="utf-8") as stream:
        rows = sum(1 for _ in stream) - 1
    with (out / "failures.csv").open(encoding="utf-8", newline="") as stream:
        failures = len(list(csv.DictReader(stream)))
    begin = time.perf_counter()
    subprocess.run(command, check=False, capture_output=True)
    result = {
        "curves": count,
        "rows": rows,
        "broken files listed": failures,
        "kept when killed": kept_at_kill,
        "seconds, both kills included": round(seconds, 1),
        "seconds of a run that finds nothing new": round(time.perf_counter() - begin, 1),
        "the parent's memory, MB, after a tenth of the time and at most": [
            memory_mb[len(memory_mb) // 10],
            max(memory_mb),
        ],
        "load average of the machine": os.getloadavg()[2],
    }
    shutil.rmtree(folder)
    return result


def _kept(out: Path) -> int:
    """Return about how many curves are kept: the study holds its file, so by its size."""
    size = sum(p.stat().st_size for p in out.glob("study.sqlite*")) if out.is_dir() else 0
    return size // 5000  # bytes a curve


def _resident_mb(pid: int) -> int:
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE") >> 20


def main() -> None:
    """Measure one part, print and save it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=["components", "simulated", "prior", "speed"])
    parser.add_argument("--cohorts", type=int)
    parser.add_argument("--people", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    measure, cohorts, people = {
        "components": (measure_components, 200, 12),
        "simulated": (measure_simulated, 200, 8),
        "prior": (measure_prior, 10, 60),
        "speed": (measure_speed, 1, 625),
    }[arguments.part]
    arguments.cohorts = arguments.cohorts or cohorts
    arguments.people = arguments.people or people
    started = time.perf_counter()
    measured = measure(arguments)
    measured |= {
        "command": f"python benchmarks/study.py {arguments.part} --cohorts {arguments.cohorts} "
        f"--people {arguments.people} --seed {arguments.seed}",
        "seconds": round(time.perf_counter() - started, 1),
    }
    print(json.dumps(measured, indent=1))
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"study_{arguments.part}.json"
    path.write_text(json.dumps(measured, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
