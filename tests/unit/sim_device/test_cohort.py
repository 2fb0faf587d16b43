"""The simulated cohort: what is drawn is what the file says, and what is written what is drawn."""

from __future__ import annotations

import csv
import subprocess
import sys

import numpy as np
import pytest

from sim_device.cohort import Cohort, CohortFile, Shifts, Size, write_cohort
from sim_device.files import SensorSection
from sim_device.skin import MESH, Law, problem_of
from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.effects.model import solve_skin
from skinlab.mechanics.fem.suction import Geometry

QUIET = SensorSection(
    noise_um=0, resolution_um=0, pressure_noise_mbar=0, pressure_resolution_mbar=0
)


def test_a_stiffer_skin_is_the_same_solution_at_less_pressure():
    spec = CohortFile(
        cohort=Size(people=2, sites=("arm",), visits=1, placements=2, operators=1, probes=1),
        probe=Shifts(),
        placement=Shifts(stiffness=0.1),
        sensor=QUIET,
    )
    for curve in Cohort(spec, 4).curves():
        true = curve.true
        problem = problem_of(
            Law(true["X1_MPa"], true["X2_MPa"], true["nu"], "paper"), {}, Geometry(6.0, 1.2)
        )
        direct = solve_skin(problem, PressurePath((0.0, 1.0), (0.0, 101.0)), MESH)
        assert curve.deflection_mm == pytest.approx(direct.instant(curve.pressure_mbar), abs=2e-5)


def test_levels_shift_by_what_the_file_says():
    spec = CohortFile(
        cohort=Size(people=300, sites=("arm",), visits=1, placements=1, operators=1, probes=1),
        subject=Shifts(X1=0.3, X2=0.2, nu=0.02),
    )
    people = Cohort(spec, 1).people
    drawn = np.array([[p.shift.X1, p.shift.X2, p.shift.nu] for p in people])
    assert drawn.std(axis=0) == pytest.approx([0.3, 0.2, 0.02], rel=0.12)
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(0.0, abs=0.15)


def test_the_same_seed_writes_the_same_files_and_tells_whose_they_are(tmp_path):
    spec = CohortFile(cohort=Size(people=2, visits=1, placements=1))
    for name in ("a", "b"):
        write_cohort(spec, tmp_path / name, seed=7, broken=2)
    files = [p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file()]
    assert all(
        (tmp_path / "a" / f).read_bytes() == (tmp_path / "b" / f).read_bytes() for f in files
    )
    with (tmp_path / "a" / "curves.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 4 + 2
    assert all((tmp_path / "a" / row["file"]).is_file() for row in rows)
    with (tmp_path / "a.truth.csv").open(newline="") as stream:
        truth = list(csv.DictReader(stream))
    assert [t["file"] for t in truth] == [r["file"] for r in rows[:4]]
    with pytest.raises(ValueError, match="exists already"):
        write_cohort(spec, tmp_path / "a", seed=7)


def test_a_wrong_file_is_one_sentence(tmp_path):
    (tmp_path / "c.toml").write_text("[cohort]\npeople = 3\nhands = 2\n")
    done = subprocess.run(
        [sys.executable, "-m", "sim_device.cohort", "c.toml", "--out", "x"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 3
    assert "hands" in done.stderr
    assert "Traceback" not in done.stderr
