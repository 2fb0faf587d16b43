"""The simulated probe as a process of its own, whose true pressure can be watched."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from patience import probe_command

from skinlab.cli.main import run

PATIENCE_S = 300.0  # how long to wait for what must come; only a failure takes it


class SimulatedProbe:
    """`python -m sim_device`: where it is, and what its pressure really is."""

    def __init__(
        self, folder: Path, *options: str, faults: str, speed: float, patient: bool
    ) -> None:
        self.folder = folder
        self._rows: list[tuple[float, float, str]] = []
        self._read = 0  # bytes of the trace
        self.trace = folder / f"trace{len(list(folder.glob('trace*')))}.csv"
        arguments = ["--trace", str(self.trace), "--speed", str(speed), *options]
        if faults:
            (folder / "FAULTS.toml").write_text(faults)
            arguments += ["--faults", str(folder / "FAULTS.toml")]
        self.process = subprocess.Popen(
            probe_command(*arguments, patient=patient),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )
        assert self.process.stdout is not None
        self.url = self.process.stdout.readline().strip()
        assert self.url, self.process.communicate()

    def rows(self) -> list[tuple[float, float, str]]:
        """Time (s), true pressure (mbar) and state, by the device's own clock, up to now."""
        with self.trace.open("rb") as file:
            file.seek(self._read)
            new = file.read()
        whole = new[: new.rfind(b"\n") + 1]
        lines = whole.decode().splitlines()[0 if self._read else 1 :]  # without the header
        self._read += len(whole)
        self._rows += [(float(t), float(p), state) for t, p, state in csv.reader(lines)]
        return self._rows

    def until(self, condition: Callable[[list[tuple[float, float, str]]], object]) -> None:
        """Wait until the trace meets the condition."""
        end = time.monotonic() + PATIENCE_S
        while not (rows := self.rows()) or not condition(rows):
            assert time.monotonic() < end, rows[-3:]
            try:
                status = self.process.wait(0.02)
            except subprocess.TimeoutExpired:
                continue
            raise AssertionError(f"the simulated probe ended with status {status}")

    def until_suction(self, mbar: float = 40.0) -> None:
        """Wait until it has pulled; nobody can wait for it to be pulling still."""
        self.until(lambda rows: any(pressure > mbar for _, pressure, _ in rows))

    def until_vented(self) -> None:
        """Wait until the true pressure is below 5 mbar and the pump is off."""
        self.until(lambda rows: rows[-1][1] < 5 and rows[-1][2] in {"idle", "loaded", "fault"})

    def end(self, how: signal.Signals = signal.SIGTERM) -> tuple[int, str, str]:
        if self.process.poll() is None:
            self.process.send_signal(how)
        out, err = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, out, err


@pytest.fixture
def simulate(tmp_path):
    """Start simulated probes; all of them are gone afterwards.

    A patient one does not mind a host that did not run for a while: see `patience`.
    """
    running: list[SimulatedProbe] = []

    def start(
        *options: str, faults: str = "", speed: float = 1, patient: bool = False
    ) -> SimulatedProbe:
        running.append(
            SimulatedProbe(tmp_path, *options, faults=faults, speed=speed, patient=patient)
        )
        return running[-1]

    yield start
    for simulated in running:
        simulated.end()


@pytest.fixture
def here(tmp_path, monkeypatch, capsys) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run a command on what a process has left in the test's folder; it needs none of its own."""

    def command(*arguments: str) -> subprocess.CompletedProcess[str]:
        monkeypatch.chdir(tmp_path)
        capsys.readouterr()
        status = run(list(arguments))
        return subprocess.CompletedProcess(arguments, status, *capsys.readouterr())

    return command
