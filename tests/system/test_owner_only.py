"""Whatever a command writes is for its owner only, also where the system would let all read it."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest
from crashes import journal_of_example
from studies import small

from sim_device.cohort import write_cohort
from skinlab.cli.main import run

GEOMETRY = ["--aperture-mm", "6", "--thickness-mm", "1"]
SKIN = ["--x1-mpa", "0.03", "--x2-mpa", "1.5", "--nu", "0.3"]
FOLDERS = {"probe.curves", "visits", "out", "csv", "html", "study", "gap"}  # that commands make
SPEC = Path(__file__).parents[1] / "data" / "inputs" / "spec.toml"


def readable_by_others(folder: Path) -> list[str]:
    return [
        f"{path.relative_to(folder)} {stat.S_IMODE(path.stat().st_mode):o}"
        for path in folder.rglob("*")
        if path.is_file() and path.stat().st_mode & 0o077
    ]


@pytest.fixture
def folder(tmp_path, tmp_path_factory, monkeypatch):
    """An empty folder to work in, with the system's own folders inside, at umask 000."""
    monkeypatch.setenv("MPLCONFIGDIR", str(tmp_path_factory.mktemp("matplotlib")))  # not ours
    for name in ("XDG_CACHE_HOME", "XDG_STATE_HOME", "XDG_DATA_HOME", "XDG_CONFIG_HOME", "HOME"):
        monkeypatch.setenv(name, str(tmp_path / "home" / name.lower()))
    monkeypatch.chdir(tmp_path)
    before = os.umask(0)
    yield tmp_path
    os.umask(before)


@pytest.mark.long
def test_every_file_that_a_command_writes(folder):
    write_cohort(small(people=3), folder / "given", seed=5, broken=2)
    (folder / "given.truth.csv").unlink()
    (folder / "spec.toml").write_bytes(SPEC.read_bytes())
    given = {path for path in folder.rglob("*") if path.is_file()}
    open_journal = journal_of_example(folder / "crashed.h5.journal")
    assert readable_by_others(folder) == [
        f"{path.relative_to(folder)} 666" for path in folder.rglob("*") if path in given
    ]
    open_journal.close()
    curve = ["forward", *SKIN, *GEOMETRY, "--program", "ramp:60@20", "--csv", "curve.csv"]
    for arguments in (
        ["recover", "crashed.h5.journal", "--out", "crashed.h5"],
        curve,
        ["measure", "--port", "sim://?speed=20", *GEOMETRY, "--program", "ramp:60@60",
         "--out", "visits/s.h5"],
        ["replay", "visits/s.h5", "--speed", "max"],
        *(["export", "visits/s.h5", "--to", way, f"out/{way}"]
          for way in ("csv", "json", "html", "svg", "fhir", "parameters")),
        ["import", "curve.csv", *GEOMETRY, "--program", "ramp:60@20", "--out", "imported.h5"],
        ["calibrate", "--port", "sim://?speed=20", "--out", "probe.toml"],
        ["calibrate", "--port", "sim://?speed=20", "--check", "probe.toml"],
        ["capture", "--port", "sim://", "--seconds", "0", "--out", "traffic.jsonl"],
        ["database", "build", "--spec", "spec.toml", "--out", "table.h5", "--workers", "1"],
        ["discrepancy", "out/csv", "--report", "gap", "--adopt", "model.toml", "--workers", "1"],
        ["study", "given", "--out", "study", "--workers", "1"],
    ):  # fmt: skip
        assert run(arguments) in {0, 3}, arguments
    for path in given:
        path.unlink()
    written = {path.name for path in folder.rglob("*") if path.is_file()}
    assert written >= {
        "crashed.h5", "curve.csv", "s.h5", "session.json", "report.html", "imported.h5",
        "traffic.jsonl", "table.h5", "probe.toml", "probe.checks", "soft.csv",
        "study.sqlite", "curves.csv", "curves.parquet", "study.json",
        "ro-crate-metadata.json",
    }  # fmt: skip
    assert readable_by_others(folder) == []
    made = [path for path in folder.rglob("*") if path.is_dir() and path.name in FOLDERS]
    assert {path.name for path in made} == FOLDERS
    assert {stat.S_IMODE(path.stat().st_mode) for path in made} == {0o700}
