"""What the tests of studies share."""

from __future__ import annotations

import csv
import math
import os

import numpy as np
from click.testing import CliRunner

from sim_device.cohort import CohortFile, Shifts, Size
from skinlab.cli.main import cli
from skinlab.studies.table import Columns


def small(**size):
    """Return a cohort that is quick to measure, without errors of sensors."""
    return CohortFile(
        cohort=Size(**{"people": 4, "sites": ("forearm",), "visits": 2, "placements": 2, **size}),
        probe=Shifts(),
        placement=Shifts(stiffness=0.05),
    )


def study(*arguments):
    """Run the command in this process; return its exit status and output."""
    done = CliRunner().invoke(cli, ["study", *map(str, arguments)], standalone_mode=False)
    if done.exception is not None:
        raise done.exception
    return done


def rows_of(path):
    with open(path, encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def stiffness_table(seed=2, people=15):
    """Return a tidy table of log-normal stiffnesses with known scatter."""
    rng = np.random.default_rng(seed)
    rows = []
    for s in range(people):
        person = rng.normal(math.log(0.03), 0.3)
        for v in range(2):
            visit = rng.normal(0, 0.05)
            for p in range(2):
                x = math.exp(person + visit + rng.normal(0, 0.1))
                rows.append((f"P{s}", str(v + 1), "arm", f"op{(p + s) % 2}", "b1", str(p + 1), x))
    names = ("subject", "visit", "site", "operator", "probe", "placement", "X1_MPa")
    columns = {n: np.array([str(r[k]) for r in rows]) for k, n in enumerate(names)}
    blank = np.full(len(rows), "")
    extra = {
        "file": np.array([f"f{k}.csv" for k in range(len(rows))]),
        "aperture_mm": np.full(len(rows), "6.0"),
        "program": np.full(len(rows), "ramp:100@20"),
        "cycle": np.full(len(rows), "1"),
        "X1_MPa_low": columns["X1_MPa"],
        "X1_MPa_high": columns["X1_MPa"],
        "same_as": blank,
        "partial": np.full(len(rows), "false"),
        "flags": blank,
        "error": blank,
        "method": blank,
        "model_hash": blank,
    }
    text = columns | extra
    order = [n for n in text if n not in ("error", "method")] + ["error", "method"]
    return Columns({n: text[n] for n in order}, tuple(order))


def tenfold(shared, task):
    """Return ten times the task, in a worker process; 13 kills it."""
    if task == 13:
        os._exit(1)
    return shared * task
