"""Instruments that only stream, as processes of their own: measured, and never started."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from patience import module_command

from skinlab.recording.records import Kind
from skinlab.recording.session import read_session

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "dialects" / "plain_line.toml"
INSTRUMENT = ROOT / "tests" / "streaming_instrument.py"
SKIN = ["--aperture-mm", "6", "--thickness-mm", "1.0"]
PATIENCE_S = 120.0
ENVIRONMENT = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}


@pytest.fixture
def dialect(tmp_path) -> str:
    """The example, which does not mind a machine that keeps a process waiting."""
    text = EXAMPLE.read_text().replace("silent_s = 1.0", "silent_s = 60.0")
    (tmp_path / "mine.toml").write_text(text)
    return "mine.toml"


class Person:
    """Somebody at the instrument."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdin is not None
        self._stdin = process.stdin

    def does(self, what: str) -> None:
        self._stdin.write(what + "\n")
        self._stdin.flush()


@contextmanager
def instrument(*arguments: str) -> Iterator[tuple[str, Person]]:
    process = subprocess.Popen(
        [sys.executable, str(INSTRUMENT), *arguments],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip(), Person(process)
    finally:
        process.kill()
        with contextlib.suppress(BrokenPipeError):
            process.communicate()


class Command:
    """A command under way, whose standard error is read line by line."""

    def __init__(self, *arguments: str, cwd: Path) -> None:
        self.process = subprocess.Popen(
            module_command("skinlab", *arguments), cwd=cwd, env=ENVIRONMENT, text=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        self._lines: queue.Queue[str | None] = queue.Queue()
        self.said: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self._lines.put(line)
        self._lines.put(None)

    def until(self, words: str) -> None:
        while not any(words in line for line in self.said):
            line = self._lines.get(timeout=PATIENCE_S)
            assert line is not None, self.said
            self.said.append(line)

    def end(self) -> tuple[int, str]:
        assert self.process.stdout is not None
        out = self.process.stdout.read()
        status = self.process.wait(PATIENCE_S)
        self._reader.join(PATIENCE_S)
        while not self._lines.empty():
            self.said.append(self._lines.get() or "")
        return status, out

    def __enter__(self) -> Command:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait(PATIENCE_S)
        self._reader.join(PATIENCE_S)
        for stream in (self.process.stdout, self.process.stderr):
            assert stream is not None
            stream.close()


@pytest.mark.long
def test_two_curves_that_a_person_starts_and_their_replay(tmp_path, here, dialect):
    with (
        instrument("--pty") as (url, person),  # the others are behind --tcp
        Command(
            "measure", "--port", f"{url}?dialect={dialect}", *SKIN, "--repeats", "2",
            "--out", "s.h5", "--json", cwd=tmp_path,
        ) as measuring,
    ):  # fmt: skip
        measuring.until("curve 1 of 2")
        assert "not under our control: its own limits hold" in "".join(measuring.said)
        person.does("run 100")
        measuring.until("curve 2 of 2")
        person.does("run 60")
        status, out = measuring.end()
    assert status == 0, measuring.said
    document = json.loads(out)
    assert [c["error"] for c in document["curves"]] == [None, None]

    session = read_session(tmp_path / "s.h5")
    assert [c.setup.cycle for c in session.curves] == [1, 2]
    for curve, peak in zip(session.curves, (100.0, 60.0), strict=True):
        assert not curve.partial
        assert curve.time_s[0] == 0.0
        assert curve.pressure_mbar.max() == pytest.approx(peak)
        # Readings at rest are no part of it, but for the foot and the end
        assert np.count_nonzero(curve.pressure_mbar <= 1.0) == 2
        assert set(curve.phase) == {"load", "unload"}
    assert session.meta["control"].startswith("this instrument is not under our control")
    assert session.meta["dialect"]["toml"] == (tmp_path / dialect).read_text()
    assert session.meta["instrument"]["read_only"] is True
    assert not [r for r in session.records if r.kind is Kind.SENT]  # not a byte

    (tmp_path / dialect).unlink()  # the session needs no other file
    again = here("replay", "s.h5", "--verify")
    assert again.returncode == 0, again.stderr + again.stdout
    assert "2 curves and 2 stored results agree" in again.stdout
    for command in (["session", "verify", "s.h5"], ["session", "info", "s.h5"]):
        told = here(*command)
        assert told.returncode == 0, told.stderr
    assert "read-only" in told.stdout
    assert "plain_line" in told.stdout
    assert "1 mm skin, program not stated, cycle 1" in told.stdout
    assert re.search(r"^    X1 0\.\d+ MPa, X2 [\d.]+ MPa, ν 0\.\d+, fit error", told.stdout, re.M)


@pytest.mark.long
def test_with_its_program_a_curve_ends_with_it(tmp_path, here, dialect):
    with (
        instrument("--tcp") as (url, person),
        Command(
            "measure", "--port", url, "--dialect", dialect, *SKIN, "--program", "ramp:100@20",
            "--out", "s.h5", cwd=tmp_path,
        ) as measuring,
    ):  # fmt: skip
        measuring.until("start the instrument")
        person.does("run 100")
        status, _ = measuring.end()
    assert status == 0, measuring.said
    (curve,) = read_session(tmp_path / "s.h5").curves
    assert not curve.partial
    assert curve.time_s[-1] == pytest.approx(5.0)
    assert set(curve.phase) == {"load"}
    assert here("replay", "s.h5", "--verify").returncode == 0


@pytest.mark.long
def test_ctrl_c_saves_a_cut_curve_that_replays_the_same(tmp_path, here, dialect):
    with (
        instrument("--tcp") as (url, person),
        Command(
            "measure", "--port", url, "--dialect", dialect, *SKIN, "--repeats", "3",
            "--out", "s.h5", cwd=tmp_path,
        ) as measuring,
    ):  # fmt: skip
        measuring.until("curve 1 of 3")
        person.does("run 50")
        measuring.until("curve 2 of 3")
        person.does("up 80")
        measuring.until("curve 2: the pressure left zero")
        measuring.process.send_signal(signal.SIGINT)
        status, _ = measuring.end()
    assert status == 130, measuring.said
    session = read_session(tmp_path / "s.h5")
    assert [curve.partial for curve in session.curves] == [False, True]
    again = here("replay", "s.h5", "--verify")
    assert again.returncode == 0, again.stderr


@pytest.mark.long
def test_a_killed_measurement_is_recovered_with_its_dialect(tmp_path, here, dialect):
    with (
        instrument("--tcp") as (url, person),
        Command(
            "measure", "--port", url, "--dialect", dialect, *SKIN, "--repeats", "3",
            "--out", "s.h5", cwd=tmp_path,
        ) as measuring,
    ):  # fmt: skip
        measuring.until("curve 1 of 3")
        person.does("run 50")
        measuring.until("curve 2 of 3")
        measuring.process.kill()
        measuring.end()
    (tmp_path / dialect).unlink()
    done = here("recover", "s.h5.journal")
    assert done.returncode == 0, done.stderr
    assert "1 curve recovered" in done.stdout
    (curve,) = read_session(tmp_path / "s.h5").curves
    assert curve.pressure_mbar.max() == pytest.approx(50.0)


def test_a_limit_that_is_passed_is_said_and_the_curve_is_kept(tmp_path, here, dialect):
    with (
        instrument("--tcp") as (url, person),
        Command(
            "measure", "--port", url, "--dialect", dialect, *SKIN, "--out", "s.h5", cwd=tmp_path
        ) as measuring,
    ):
        measuring.until("start the instrument")
        person.does("up 540")  # and stays there: the curve cannot end by itself
        status, _ = measuring.end()
    assert status == 4
    told = "".join(measuring.said)
    assert "more than the 500 mbar that are allowed here" in told
    assert "cannot be vented from here: lift the probe" in told
    assert "told to vent" not in told
    (curve,) = read_session(tmp_path / "s.h5").curves
    assert curve.partial
    assert curve.pressure_mbar.max() > 500.0
    assert here("replay", "s.h5", "--verify").returncode == 0


def test_lines_that_nobody_understands_are_said(tmp_path, dialect):
    with (
        instrument("--tcp") as (url, person),
        Command(
            "measure", "--port", url, "--dialect", dialect, *SKIN, "--out", "s.h5", cwd=tmp_path
        ) as measuring,
    ):
        measuring.until("start the instrument")
        for _ in range(12):
            person.does("say 12;0,5")
        measuring.until("understands none")
        measuring.process.send_signal(signal.SIGINT)
        status, _ = measuring.end()
    assert status == 130
    assert not (tmp_path / "s.h5").exists()  # nothing was measured


def test_a_capture_keeps_its_dialect_and_says_what_it_understands(tmp_path, dialect):
    with (
        instrument("--tcp") as (url, person),
        Command(
            "capture", "--port", url, "--dialect", dialect, "--out", "c.jsonl", cwd=tmp_path
        ) as capturing,
    ):
        capturing.until("capturing to c.jsonl")
        person.does("zero 5")
        person.does("say nonsense")
        while (tmp_path / "c.jsonl").read_text().count("nonsense") == 0:
            time.sleep(0.01)
        capturing.process.send_signal(signal.SIGINT)
        capturing.end()
    assert "understands 5 frames, and not 1, the last one b'nonsense" in "".join(capturing.said)
    facts = json.loads((tmp_path / "c.jsonl").read_text().splitlines()[0])
    assert facts["dialect"]["name"] == "plain_line"
