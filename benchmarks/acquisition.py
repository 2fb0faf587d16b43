"""What acquisition costs, loses and delays, over a pseudo terminal. Prints and saves JSON.

    python benchmarks/acquisition.py [--minutes 10] [--rates 1000 100] [--minutes-others 2]

The simulated probe runs in a process of its own and notes when it wrote each sample. The host is
what `skinlab measure` is: probe, journal, assembler, identification, one listener. Its processor
time is that of its process alone (resource.getrusage), from Start to the curve's last sample; what
follows (identifying, writing the session) is reported apart, and the samples of the final vent are
not looked at. Latency runs from the probe's write to the listener's call, by the one monotonic
clock that both processes have (Linux). On a machine that is busy with other things the probe's
process may be silent for longer than the 300 ms after which the host vents; `trouble` says so then.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from array import array
from multiprocessing import get_context
from pathlib import Path
from types import FrameType
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from drivers.events import Damaged, Gap
from skinlab.acquisition.gc_tuning import shorten_pauses
from skinlab.recording.stream import CurveCompleted, CurveStarted, Happened, Sampled

FOLDER = Path(__file__).resolve().parent
CYCLE = "ramp:100@20,hold:45,release,rest:9"  # 59 s and the time to vent
CYCLE_S = 59.0


# ---- the probe's process -----------------------------------------------------------------------


def be_the_probe(log: Path) -> None:
    """Serve on a pty until terminated; then write when each sample left."""
    from sim_device.build import build_device
    from sim_device.serve import PtyHost, serve

    written, counts = array("d"), array("q")

    class Host(PtyHost):
        def send(self, data: bytes) -> None:
            samples = data.count(b"$S,")
            if samples:
                written.append(time.monotonic())
                counts.append(samples)
            super().send(data)

    def end(_signal: int, _frame: FrameType | None) -> None:
        raise SystemExit(0)

    signal.signal(signal.SIGTERM, end)
    device = build_device(None, seed=1, speed=1.0, aperture_mm=6.0)
    shorten_pauses()
    with Host() as host:
        print(host.url, flush=True)
        try:
            serve(device, host, 1.0)
        finally:
            np.save(log, np.repeat(np.array(written), np.array(counts)))


# ---- the host ----------------------------------------------------------------------------------


class Listener:
    """Notes when each sample came, and what was lost; processor and wall time of the run."""

    def __init__(self) -> None:
        self.came: list[float] = []
        self.lost = 0
        self.cut: str | None = None
        self.damaged = 0
        self.begin = self.end = (0.0, 0.0)

    def __call__(self, message: object) -> None:
        """Take one message of the pipeline."""
        match message:
            case Sampled() if self.end == (0.0, 0.0):
                self.came.append(time.monotonic())
            case CurveStarted():
                self.begin = clocks()
            case CurveCompleted():
                self.cut = message.cut
                self.end = clocks()
            case Happened(Gap(expected, received)):
                self.lost += received - expected
            case Happened(Damaged()):
                self.damaged += 1
            case _:
                pass


def clocks() -> tuple[float, float]:
    """Return the wall's clock and this process' processor time, in s."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return time.monotonic(), usage.ru_utime + usage.ru_stime


def acquire(rate_hz: float, cycles: int) -> dict[str, Any]:
    """Measure one run of so many cycles and return its figures."""
    from drivers.probe import Probe
    from skinlab.acquisition.measure import measure
    from skinlab.acquisition.measurement_messages import Plan
    from skinlab.acquisition.pipeline import Pipeline
    from skinlab.acquisition.sources import LiveSource
    from skinlab.api.identifiers import compose_identifier
    from skinlab.curves.curve import Setup
    from skinlab.curves.program import parse_program
    from skinlab.errors import AcquisitionError
    from skinlab.recording.recorder import Recording
    from skinlab.recording.session import read_session

    identifier = compose_identifier()
    listener = Listener()
    with tempfile.TemporaryDirectory() as folder:
        log, out = Path(folder) / "written.npy", Path(folder) / "s.h5"
        probe_process = subprocess.Popen(
            [sys.executable, str(Path(__file__).resolve()), "--be-the-probe", str(log)],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert probe_process.stdout is not None
        try:
            url = probe_process.stdout.readline().strip()
            setup = Setup(6.0, 1.0, parse_program(",".join([CYCLE] * cycles)))
            recording = Recording(out, identifier, url=url)
            shorten_pauses()
            with Probe(url, on_bytes=recording.journal.raw) as probe:
                probe.open()
                source = LiveSource(probe, recording.journal)
                plan, pipeline = (
                    Plan(setup, rate_hz=rate_hz),
                    Pipeline(identifier, [recording, listener]),
                )
                trouble = None
                try:
                    measure(source, plan, pipeline)
                except AcquisitionError as error:
                    trouble = str(error)
            recording.finish()
            finished = clocks()
        finally:
            probe_process.terminate()
            probe_process.wait()
            probe_process.stdout.close()
        written = np.load(log)
        stored = sum(len(curve) for curve in read_session(out).curves)
    came = np.array(listener.came)
    wall, cpu = (b - a for a, b in zip(listener.begin, listener.end, strict=True))
    late_ms = 1e3 * (came - written[: len(came)])
    return {
        "rate_hz": rate_hz,
        "trouble": trouble or listener.cut,
        "minutes": wall / 60,
        "samples_heard": len(came),
        "samples_in_session": stored,
        "lost": listener.lost + abs(stored - len(came)),
        "damaged_frames": listener.damaged,
        "host_cpu_share": cpu / wall,
        "latency_ms": {
            "median": float(np.median(late_ms)),
            "p99": float(np.percentile(late_ms, 99)),
            "worst": float(late_ms.max()),
        },
        "longest_silence_ms": {
            "probe": float(1e3 * np.diff(written).max()),
            "host": float(1e3 * np.diff(came).max()),
        },
        "afterwards_s": finished[0] - listener.end[0],
        "peak_memory_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "load_average": os.getloadavg()[0],
        "nice": os.nice(0),
    }


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="of the first rate")
    parser.add_argument("--rates", type=float, nargs="+", default=[1000.0, 100.0])
    parser.add_argument("--minutes-others", type=float, default=2.0, help="of the other rates")
    parser.add_argument("--out", type=Path, default=FOLDER / "results" / "acquisition.json")
    parser.add_argument("--be-the-probe", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.be_the_probe is not None:
        be_the_probe(arguments.be_the_probe)
        return
    runs = []
    for number, rate in enumerate(arguments.rates):  # each in a process of its own
        minutes = arguments.minutes_others if number else arguments.minutes
        cycles = math.ceil(60 * minutes / CYCLE_S)
        with get_context("spawn").Pool(1) as pool:
            runs.append(pool.apply(acquire, (rate, cycles)))
    text = json.dumps({"python": sys.version.split()[0], "runs": runs}, indent=1)
    arguments.out.write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
