"""The headless path with real processes: simulator, measurement, kill, interrupt, replay."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from patience import patient_command, probe_command

from drivers.events import Sample, State, TimedEvent
from skinlab.recording.recorded_items import dialect_of, recorded_items
from skinlab.recording.session import read_session

SKIN = ["--aperture-mm", "6", "--thickness-mm", "1.0"]
PATIENCE_S = 300.0
ENVIRONMENT = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}


@contextmanager
def simulator(*arguments: str) -> Iterator[str]:
    process = subprocess.Popen(
        probe_command(*arguments, patient=True),
        stdout=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    )
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        process.wait(PATIENCE_S)
        process.stdout.close()


def skinlab(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        patient_command("skinlab", *arguments, apart=True),
        cwd=cwd,
        env=ENVIRONMENT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


def values(document: dict[str, Any]) -> list[dict[str, float]]:
    """What was identified, a dictionary a curve."""
    return [
        {name: entry["value"] for name, entry in curve["parameters"].items()}
        for curve in document["curves"]
    ]


def test_two_curves_over_a_real_link_and_their_replay(tmp_path, here):
    with simulator("--pty", "--seed", "1", "--speed", "5") as url:
        done = skinlab(
            "measure", "--port", url, *SKIN, "--program", "ramp:100@20", "--repeats", "2",
            "--rest-s", "0.2", "--out", "s.h5", "--json", cwd=tmp_path,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["session"] == "s.h5"
    assert len(document["curves"]) == 2
    for entry in document["curves"]:
        assert 50 <= entry["points"] <= 101
        assert entry["error"] is None
        # The default skin, through 3 µm of noise on a valley that is nearly flat.
        assert entry["parameters"]["X1_MPa"]["value"] == pytest.approx(0.025, rel=0.5)
        assert 2.0 < entry["rms_um"] < 5.0
    replayed = here("replay", "s.h5", "--speed", "max", "--verify", "--json")
    assert replayed.returncode == 0, replayed.stderr
    again = json.loads(replayed.stdout)
    for before, now in zip(document["curves"], again["curves"], strict=True):
        assert before | {"seconds": 0} == now | {"seconds": 0}
    identified = here("identify", "s.h5", "--json")
    assert identified.returncode == 0
    # The intervals may differ: here the noise is estimated from all repeats at once
    assert values(json.loads(identified.stdout)) == values(document)
    assert here("session", "verify", "s.h5").returncode == 0


def test_without_a_terminal_it_measures_headless(tmp_path):
    done = skinlab("ui", "--port", "sim://?seed=1&speed=10", "--sessions", "kept", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "X1" in done.stdout
    (session,) = (tmp_path / "kept").glob("session-*.h5")
    assert len(read_session(session).curves) == 1


def start_measuring(tmp_path: Path, *more: str) -> subprocess.Popen[str]:
    """Start a measurement and wait until its journal holds samples of the second curve."""
    return subprocess.Popen(
        patient_command(
            "skinlab", "measure", "--port", "sim://?seed=1", *SKIN, "--program",
            "ramp:100@100,hold:30", "--out", "s.h5", *more,
        ),
        cwd=tmp_path,
        env=ENVIRONMENT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip


def wait_for_samples(journal: Path, process: subprocess.Popen[str]) -> None:
    """Return once samples are committed; the process ends the wait if it dies."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline and process.poll() is None:
        if journal.exists():
            try:
                with sqlite3.connect(f"file:{journal}?mode=ro", uri=True) as db:
                    (n,) = db.execute(
                        "SELECT count(*) FROM record WHERE kind = 0 AND number > "
                        "(SELECT max(number) FROM record WHERE kind = 2)"
                    ).fetchone()
                db.close()
                if n > 40:  # pieces of the stream, of which some are no samples
                    return
            except sqlite3.Error:
                pass
        try:
            process.wait(0.05)
        except subprocess.TimeoutExpired:
            continue
    raise AssertionError(f"no samples were recorded: {process.communicate(timeout=PATIENCE_S)}")


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)]
)
def test_an_interrupted_measurement_vents_and_saves(tmp_path, number):
    process = start_measuring(tmp_path)
    wait_for_samples(tmp_path / "s.h5.journal", process)
    process.send_signal(number)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Traceback" not in err
    session = read_session(tmp_path / "s.h5")
    (curve,) = session.curves
    assert curve.partial
    assert len(curve) > 20
    # The vent is in the record: the last reading is of a probe without suction. It may come with a
    # state: at 20 Hz the pressure can fall from above 5 mbar to nothing between two samples.
    pressures = [
        item.event.pressure_mbar
        for item in recorded_items(session.records, dialect_of(session.meta))
        if isinstance(item, TimedEvent)
        and isinstance(item.event, Sample | State)
        and item.event.pressure_mbar is not None
    ]
    assert pressures[-1] < 5.0
    assert list(tmp_path.glob("*.journal*")) == []


def test_what_a_killed_measurement_leaves_is_recovered(tmp_path, here):
    process = start_measuring(tmp_path)
    wait_for_samples(tmp_path / "s.h5.journal", process)
    process.kill()
    process.communicate(timeout=PATIENCE_S)
    assert not (tmp_path / "s.h5").exists()
    done = here("recover", "s.h5.journal")
    assert done.returncode == 0, done.stderr
    (curve,) = read_session(tmp_path / "s.h5").curves
    assert curve.partial
    assert len(curve) > 20
    np.testing.assert_array_equal(np.diff(curve.time_s) > 0, True)
    identified = here("identify", "s.h5", "--json")
    assert identified.returncode == 0
    assert "partial_curve" in json.loads(identified.stdout)["curves"][0]["flags"]
