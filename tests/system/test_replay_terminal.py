"""`skinlab replay` on a real terminal: its keys steer it, and the terminal is as before."""

from __future__ import annotations

import os
import pty
import select
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest

from drivers.probe import Probe
from skinlab.acquisition.measure import measure
from skinlab.acquisition.measurement_messages import Plan
from skinlab.acquisition.pipeline import Pipeline
from skinlab.acquisition.sources import LiveSource
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.inference.identify import Identifier
from skinlab.inference.problem import Options
from skinlab.recording.recorder import Recording

PATIENCE_S = 300.0


class Terminal:
    """A process on a terminal of its own."""

    def __init__(self, *arguments: str) -> None:
        self.master, slave = pty.openpty()
        self.before = termios.tcgetattr(slave)
        self.slave = slave
        command = [sys.executable, "-m", "skinlab", *arguments]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        self.process = subprocess.Popen(
            command, stdin=slave, stdout=slave, stderr=slave, env=environment
        )
        self.text = ""

    def until(self, *wanted: str) -> None:
        """Read until all of this was written."""
        deadline = time.monotonic() + PATIENCE_S
        while not all(w in self.text for w in wanted):
            assert time.monotonic() < deadline, self.text
            if select.select([self.master], [], [], 0.1)[0]:
                self.text += os.read(self.master, 65536).decode()
            else:
                assert self.process.poll() is None, self.text

    def press(self, keys: str) -> None:
        self.text = ""
        os.write(self.master, keys.encode())

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self.slave)
        os.close(self.master)


@pytest.fixture(scope="module")
def session(tmp_path_factory, grid) -> Path:
    path = tmp_path_factory.mktemp("session") / "s.h5"
    identifier = Identifier(grid, method="sto", options=Options(samples=100))
    recording = Recording(path, identifier, url="sim://")
    with Probe("sim://?seed=1&speed=20", on_bytes=recording.journal.raw) as probe:
        probe.open()
        setup = Setup(6.0, 1.0, parse_program("ramp:100@20"))
        source = LiveSource(probe, recording.journal)
        measure(source, Plan(setup), Pipeline(identifier, [recording]))
    recording.finish()
    return path


def test_keys_step_go_on_and_the_terminal_is_left_as_it_was(session):
    terminal = Terminal("replay", str(session), "--paused", "--verify")
    try:
        terminal.until("space pauses")
        terminal.press(".")
        terminal.until("0.00 s", "paused")
        terminal.press("..")
        terminal.until("0.10 s")
        terminal.press("m ")
        terminal.until("agree bit for bit")
        assert terminal.process.wait(PATIENCE_S) == 0
        assert termios.tcgetattr(terminal.slave) == terminal.before
    finally:
        terminal.close()


@pytest.mark.long
def test_q_ends_it(session):
    terminal = Terminal("replay", str(session), "--paused")
    try:
        terminal.until("space pauses")
        terminal.press("q")
        terminal.until("interrupted")
        assert terminal.process.wait(PATIENCE_S) == 130
        assert termios.tcgetattr(terminal.slave) == terminal.before
    finally:
        terminal.close()
