"""A whole day at 100 Hz in fast time: does memory stay flat? Prints and saves JSON.

    python benchmarks/day.py [--hours 24] [--rate-hz 100] [--save benchmarks/results/day.json]

The bytes of an instrument that repeats a program for so long go through what a measurement has
between link and session: connection, watchdog, journal, assembler and gates, at the times at which
they would come. Only the waiting is left out, the link, and the identification. The journal
is written to the disk, and is not made a session here: that reads it whole.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from drivers.connection import Connection
from drivers.dialects import get_dialect
from drivers.events import (
    PROGRAM_DONE,
    PROGRAM_END,
    Arm,
    Event,
    Hello,
    HostVented,
    Identify,
    Load,
    Loaded,
    Sample,
    Start,
    State,
    TimedEvent,
)
from drivers.events import InstrumentState as S
from drivers.limits import Limits, program_bounds
from drivers.watchdog import Watchdog
from skinlab.acquisition.pipeline import Pipeline
from skinlab.acquisition.sources import wire_segments
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.inference.identify import Identifier
from skinlab.recording.recorder import Recording
from skinlab.recording.stream import CurveCompleted, Message, Planned, setup_to_json
from skinlab.tables.store import shipped_table

WIRE = get_dialect("reference")
PROGRAM = parse_program("ramp:60@20,hold:50,ramp:0@20")
PERIOD_S = 60.0
CHUNK_S = 0.05  # of which bytes come together
HELLO = Hello("reference", 1, "day", "1", "1", 6.0, 500.0, 60.0, 1.0, 1000.0, simulated=True)


def resident_mb() -> float:
    """Memory of this process now, MB."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * resource.getpagesize() / 1e6
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def run_bytes(rate_hz: float) -> Iterator[tuple[float, bytes]]:
    """Give the bytes of one run, and when they come, s since its Start."""
    ends = PROGRAM.boundaries_s()
    yield 0.0, WIRE.encode_event(State(S.RUNNING, "started", 0.0))
    due, held = CHUNK_S, b""
    for k in range(int(ends[-1] * rate_hz)):
        t = k / rate_hz
        pressure = float(PROGRAM.pressure_mbar(t))
        index = int((t >= ends[1:-1]).sum())
        height = 5e-3 * pressure + 1e-5 * (k % 7)
        held += WIRE.encode_event(Sample(k, t, round(pressure, 1), round(height, 6), index))
        if t >= due:
            yield due, held
            due, held = due + CHUNK_S, b""
    yield ends[-1], held + WIRE.encode_event(State(S.VENTING, PROGRAM_END, 1.0))
    yield ends[-1] + 0.1, WIRE.encode_event(State(S.LOADED, PROGRAM_DONE, 0.5))


def day(hours: float, rate_hz: float, folder: Path) -> dict[str, object]:
    """Run it; return what it took."""
    clock = [0.0]
    out = folder / "day.h5"
    identifier = Identifier(shipped_table())
    recording = Recording(out, identifier, clock=lambda: clock[0], now=lambda: clock[0])
    journal = recording.journal
    curves = vents = samples = 0

    def count(message: Message) -> None:
        nonlocal curves
        curves += isinstance(message, CurveCompleted)

    pipeline = Pipeline(None, [recording, count])
    connection = Connection(WIRE)
    dog = Watchdog(Limits(max_dose_mbar_s=1e12))
    setup = Setup(6.0, 1.0, PROGRAM)
    segments = wire_segments(PROGRAM)
    bounds = program_bounds(segments)
    load = Load(segments, rate_hz, bounds.max_pressure_mbar, bounds.max_suction_s)

    def hear(data: bytes) -> None:
        nonlocal vents, samples
        journal.raw("rx", clock[0], data)
        connection.receive_data(data)
        while (event := connection.next_event()) is not None:
            samples += isinstance(event, Sample)
            said: list[Event] = [event, *dog.on_event(event, clock[0])]
            for one in said:
                vents += isinstance(one, HostVented)
                pipeline.handle(TimedEvent(clock[0], one))
        vents += sum(isinstance(e, HostVented) for e in dog.check(clock[0]))

    connection.send(Identify())
    hear(WIRE.encode_event(HELLO) + WIRE.encode_event(State(S.IDLE, "", 0.0)))
    piece = list(run_bytes(rate_hz))
    memory: list[float] = []
    began = time.perf_counter()
    for number in range(round(3600 * hours / PERIOD_S)):
        start_s = clock[0] = number * PERIOD_S
        frame = connection.send(load)
        dog.commanded(load, clock[0])
        command_number = WIRE.decode_command(frame)[1]
        hear(
            WIRE.encode_event(Loaded(segments, rate_hz, load.max_pressure_mbar, load.max_suction_s),
                              command_number)
            + WIRE.encode_event(State(S.LOADED, "loaded", 0.0))
        )  # fmt: skip
        journal.plan(clock[0], setup_to_json(setup))
        pipeline.handle(Planned(setup))
        for command, state in ((Arm(), S.ARMED), (Start(), None)):
            connection.send(command)
            dog.commanded(command, clock[0])
            if state is not None:
                hear(WIRE.encode_event(State(state, "armed", 0.0)))
        for after_s, data in piece:
            clock[0] = start_s + after_s
            hear(data)
        if number % 10 == 0:
            journal.flush()  # the disk is slower than a day in minutes
        if number % max(1, round(hours * 60 / 48)) == 0:
            memory.append(round(resident_mb(), 1))
    seconds = time.perf_counter() - began
    pipeline.end()
    journal.close()
    size_mb = journal.path.stat().st_size / 1e6
    half = len(memory) // 2
    return {
        "hours": hours,
        "rate_hz": rate_hz,
        "samples": samples,
        "curves": curves,
        "vents_of_the_host": vents,
        "seconds": round(seconds, 1),
        "journal_mb": round(size_mb, 1),
        "memory_mb": memory,
        "grown_mb_in_the_second_half": round(max(memory[half:]) - memory[half], 1),
    }


def main() -> None:
    """Run and save."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--rate-hz", type=float, default=100.0)
    parser.add_argument("--save", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = {
            "python": platform.python_version(),
            **day(asked.hours, asked.rate_hz, Path(folder)),
        }
    text = json.dumps(found, indent=1)
    if asked.save is not None:
        asked.save.write_text(text + "\n")
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
