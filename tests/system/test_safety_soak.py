"""The rows of docs/safety.md that depend on the moment, at many moments. Run by `make soak`.

What it took is saved in benchmarks/results/safety.json.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.events import Alarm, LinkLost, Sample, Segment, SegmentKind
from drivers.probe import Probe

pytestmark = pytest.mark.soak

RESULTS = Path(__file__).parents[2] / "benchmarks" / "results" / "safety.json"
KILLS, UNPLUGS = 100, 50
PULL = (
    Segment(SegmentKind.RAMP, target_mbar=100, rate_mbar_per_s=200),
    Segment(SegmentKind.HOLD, duration_s=50),
)
# A host that does nothing but measure, so that a hundred of them start quickly
HOST = """
import sys
from drivers.events import Segment, SegmentKind
from drivers.probe import Probe
with Probe(sys.argv[1]) as probe:
    probe.open()
    probe.load((Segment(SegmentKind.RAMP, 100, 200), Segment(SegmentKind.HOLD, 0, 0, 50)), 100)
    probe.arm()
    probe.start()
    while probe.is_open:
        probe.next_event(1.0)
"""


def save(name, **figures):
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {"command": "make soak"}
    results[name] = figures
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")


def spread(values, digits=3):
    ordered = sorted(values)
    middle = ordered[len(ordered) // 2]
    return {"median": round(middle, digits), "most": round(ordered[-1], digits)}


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
def test_hosts_that_end_at_any_moment(simulate, how):
    """By the device's clock: from the host's end to a true pressure below 5 mbar."""
    rng = random.Random(4)
    took, pressures = [], []
    for number in range(KILLS):
        if number % 10 == 0:  # a new one now and then: its trace is read again and again
            simulated = simulate("--tcp", "0")
        host = subprocess.Popen(
            [sys.executable, "-c", HOST, simulated.url],
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )
        wanted = rng.uniform(5, 99)
        simulated.until(lambda rows, wanted=wanted: rows[-1][1] > wanted)
        host.send_signal(how)
        ended, pressure, _ = simulated.rows()[-1]
        pressures.append(pressure)
        simulated.until_vented()
        took.append(
            next(t - ended for t, p, state in simulated.rows()
                 if t > ended and p < 5 and state != "running")
        )  # fmt: skip
        host.kill()
        host.wait(60)
    assert max(took) < 0.5 + 1.0 + 0.1  # keep-alive, vent, and what passed before the signal
    save(f"host {how.name}", hosts=KILLS, vented_s=spread(took), pressure_mbar=spread(pressures))


@pytest.mark.parametrize("way", [("--pty",), ("--tcp", "0")], ids=["pty", "tcp"])
def test_cables_that_are_pulled_at_any_moment(simulate, way):
    """By the host's clock: from the last sample to the word that the link is lost."""
    rng = random.Random(5)
    took = []
    for _ in range(UNPLUGS):
        at_s = rng.uniform(0.1, 1.0)
        simulated = simulate(*way, faults=f'[[fault]]\nkind = "unplug"\nat_s = {at_s}\n')
        with Probe(simulated.url) as probe:
            probe.open()
            probe.load(PULL, 100)
            probe.arm()
            probe.start()
            last = lost = None
            while lost is None:
                timed = probe.next_event(30)
                if isinstance(timed.event, Sample):
                    last = timed.host_time_s
                elif isinstance(timed.event, LinkLost):
                    lost = timed.host_time_s
            assert isinstance(probe.next_event(30).event, Alarm)
        simulated.until_vented()
        simulated.end()
        took.append(lost - last)
    save(f"unplugged, {way[0][2:]}", cables=UNPLUGS, told_after_s=spread(took))
