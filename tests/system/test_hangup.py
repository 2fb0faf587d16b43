"""A closed terminal: the command vents, saves, and ends with 130 like any interrupted one."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress

import pytest
from patience import module_command

from skinlab.recording.session import read_session

PATIENCE_S = 120.0


def start(*arguments, cwd):
    """Run a command on a terminal of its own, as the leader of its session."""
    master, slave = pty.openpty()
    process = subprocess.Popen(
        module_command("skinlab", *arguments),
        stdin=slave, stdout=slave, stderr=slave, start_new_session=True, cwd=cwd,
        preexec_fn=lambda: os.login_tty(slave),  # noqa: PLW1509 -- no thread runs here
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    os.close(slave)
    return master, process


def until(condition):
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_the_terminal_of_a_measurement_is_closed(tmp_path):
    out = tmp_path / "s.h5"
    master, process = start(
        "measure", "--port", "sim://?seed=1", "--aperture-mm", "6", "--thickness-mm", "1",
        "--program", "ramp:100@5", "--out", str(out), cwd=tmp_path,
    )  # fmt: skip
    journal = tmp_path / "s.h5.journal-wal"
    until(lambda: journal.exists() and journal.stat().st_size > 150_000)
    os.close(master)  # the system sends SIGHUP, and every write fails from now on
    assert process.wait(PATIENCE_S) == 130
    assert read_session(out).curves[0].partial


@pytest.mark.parametrize(
    "number", [signal.SIGHUP, pytest.param(signal.SIGTERM, marks=pytest.mark.long)]
)
def test_a_command_that_measures_nothing_ends_the_same_way(tmp_path, number):
    (tmp_path / "exports").mkdir()
    process = subprocess.Popen(
        module_command("skinlab", "database", "build", "--workers", "1", "--out", "d.h5"),
        cwd=tmp_path, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    until(lambda: (tmp_path / "d.h5.rows").exists() or process.poll() is not None)
    process.send_signal(number)
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("ignored", "sent"),
    [(signal.SIGINT, signal.SIGHUP),
     pytest.param(signal.SIGINT, signal.SIGTERM, marks=pytest.mark.long),
     pytest.param(signal.SIGHUP, signal.SIGTERM, marks=pytest.mark.long)],
)  # fmt: skip
def test_a_measurement_in_the_background(simulate, tmp_path, ignored, sent):
    """`&` of a script ignores Ctrl-C and `nohup` a hang-up: that stays so, and all else vents."""
    simulated = simulate("--tcp", "0")
    out = tmp_path / "s.h5"
    process = subprocess.Popen(
        module_command(
            "skinlab", "measure", "--port", simulated.url, "--aperture-mm", "6",
            "--thickness-mm", "1", "--program", "ramp:60@200,hold:50", "--out", str(out),
        ),
        cwd=tmp_path, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        text=True, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        preexec_fn=lambda: signal.signal(ignored, signal.SIG_IGN),  # noqa: PLW1509
    )  # fmt: skip
    try:
        simulated.until_suction()
        process.send_signal(ignored)
        told = simulated.rows()[-1][0]
        simulated.until(lambda rows: rows[-1][0] > told + 0.5)
        assert process.poll() is None
        assert simulated.rows()[-1][1] > 40  # so it did not vent
        process.send_signal(sent)
        simulated.until_vented()
        _, said = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    assert process.returncode == 130, said
    assert "Traceback" not in said
    assert read_session(out).curves[0].partial


# A second hang-up while the screen is taken down: what reads the terminal is never told to end
CUT_SHORT = """
from textual.app import App
from textual.drivers.linux_driver import LinuxDriver

from skinlab.tui.prompt_escape import look_sooner


class Cut(LinuxDriver):
    def disable_input(self):
        raise KeyboardInterrupt


class Quits(App):
    def on_ready(self):
        self.exit()


look_sooner()
Quits(driver_class=Cut).run()
"""


def test_whoever_reads_keys_does_not_keep_the_process():
    leader, follower = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", CUT_SHORT], stdin=follower, stdout=follower, stderr=follower
    )
    os.close(follower)

    def read_on():
        with suppress(OSError):  # the terminal is gone with its last user
            while os.read(leader, 4096):
                pass

    threading.Thread(target=read_on, daemon=True).start()
    try:
        process.wait(PATIENCE_S / 4)
    finally:
        process.kill()
