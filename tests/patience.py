"""Time that stands still while the machine keeps a process waiting.

The watchdogs are right to vent where a process did not run for some tenths of a second, and a test
would fail with them on a busy machine. So the tests' probes live in a time of their own: between
two looks at the clock at most `LONGEST_S` pass. What happens in which order, and after how many of
these seconds, is as ever.

`python tests/patience.py [--apart] MODULE ARGUMENTS` is `python -m MODULE ARGUMENTS` in such a
time. `--apart` is for a probe and a host in two processes, where each must forgive the other, too;
with `--real-time` the clock is the real one. A simulated skin is solved coarsely in all of them:
most of a simulated probe's processor time is its finite elements, and nobody looks at them here.
"""

from __future__ import annotations

import runpy
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.errors import LinkError

if TYPE_CHECKING:
    from drivers.probe import Probe

LONGEST_S = 0.02
FORGIVING_S = 60.0  # instead of the limits that would notice that another process did not run


class PatientClock:
    """Seconds; never goes back."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._real_s = self._now_s = time.monotonic()

    def __call__(self) -> float:
        with self._lock:
            real_s = time.monotonic()
            self._now_s += min(real_s - self._real_s, LONGEST_S)
            self._real_s = real_s
            return self._now_s


def be_patient(*, apart: bool = False) -> None:
    """Let probes and simulated probes that are made from now on live in a patient time."""
    from drivers.probe import DEFAULTS, Limits
    from sim_device.timing import TIMING

    DEFAULTS.clock = TIMING.clock = PatientClock()
    # It may be another process whose clock is compared, and each loses its own seconds; of a probe
    # that runs 50 times as fast, one step of this clock is a second of suction
    DEFAULTS.limits = Limits(clock_s=FORGIVING_S, suction_slack_s=FORGIVING_S)
    if apart:
        TIMING.keep_alive_s = DEFAULTS.open_timeout_s = DEFAULTS.command_timeout_s = FORGIVING_S
        DEFAULTS.limits = Limits(
            stale_s=FORGIVING_S,
            clock_s=FORGIVING_S,
            suction_slack_s=FORGIVING_S,
            vent_time_s=FORGIVING_S,
        )


def reopen(probe: Probe) -> None:
    """Open a probe again whose device comes back; often, because its time passes where one looks.

    Raises LinkError where it does not come.
    """
    end = time.monotonic() + 300.0
    while True:
        try:
            probe.reopen()
            return
        except LinkError:
            if time.monotonic() > end:
                raise
            time.sleep(0.01)


def probe_command(*arguments: str, patient: bool) -> list[str]:
    """Return the command line of a simulated probe, for a host in another process."""
    flag = "--apart" if patient else "--real-time"
    return [sys.executable, str(Path(__file__)), flag, "sim_device", *arguments]


def module_command(module: str, *arguments: str) -> list[str]:
    """Return the command line that runs a module as a user does."""
    return [sys.executable, "-m", module, *arguments]


def patient_command(module: str, *arguments: str, apart: bool = False) -> list[str]:
    """Return the command line that runs a module in a patient time."""
    flags = ["--apart"] if apart else []
    return [sys.executable, str(Path(__file__)), *flags, module, *arguments]


if __name__ == "__main__":
    sys.argv.pop(0)
    flag = sys.argv.pop(0) if sys.argv[0] in {"--apart", "--real-time"} else ""
    sys.path[0] = ""  # as with `python -m`, and not the folder of this file
    from sim_device.timing import TIMING

    TIMING.coarse_skin = True
    if flag != "--real-time":
        be_patient(apart=flag == "--apart")
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
