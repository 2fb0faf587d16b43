"""Kill measurements with -9 at random moments, recover each, compare with what the probe sent.

    python tests/system/kills.py --kills 100 --seed 1 --save benchmarks/results/kills.json

Each measurement is a process of its own (forked from this one, to save the imports), and so is the
probe, whose log is the truth. `oldest_lost_ms`: how long before the kill the oldest sample that is
not in the recovered session was sent; null where none was lost. `starved_ms`: how long threads of
the measurement were ready and waited for a processor, all together, in the half second before the
kill (the kernel's own account): what a loaded machine adds, and no program can help.

`--patient` judges nothing that depends on how fast the machine is: what was recovered must be what
was sent, whole, from the beginning; how much of the end is lost is only reported.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import math
import os
import platform
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"

sys.path.insert(0, str(Path(__file__).parents[1]))

from patience import be_patient
from preloaded import measure, preload

from drivers.dialects.reference import DIALECT
from drivers.events import InstrumentState, Sample, State, TimedEvent
from skinlab.errors import InputError
from skinlab.recording.recorded_items import recorded_items
from skinlab.recording.recorder import recover
from skinlab.recording.records import Kind, Record
from skinlab.recording.session_check import check

SPEED = 4.0  # of the simulated probe
TICK_S = 0.005
MOST_LOST_MS = 100.0
WINDOW_S = 0.5
OPTIONS = ("--repeats", "2", "--rest-s", "0.1")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--program", default="ramp:100@40,ramp:0@40")
    parser.add_argument("--save", type=Path)
    parser.add_argument("--patient", action="store_true")
    arguments = parser.parse_args()
    if arguments.patient:
        be_patient(apart=True)
    rng = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory(prefix="skinlab-kills-") as name:
        folder = Path(name)
        script = Path(__file__).with_name("logged_probe.py")
        options = ["--speed", str(SPEED), "--seed", "1"]
        probe = subprocess.Popen(
            [sys.executable, script, folder / "log", *options],
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert probe.stdout is not None
            url = probe.stdout.readline().strip()
            most_lost_ms = math.inf if arguments.patient else MOST_LOST_MS
            result = study(folder, url, arguments.program, rng, arguments.kills, most_lost_ms)
        finally:
            probe.kill()
            probe.wait()
            if probe.stdout is not None:
                probe.stdout.close()
    rows = ",\n".join("  " + json.dumps(entry) for entry in result.pop("entries"))
    summary = json.dumps(result, indent=1)
    sys.stdout.write(summary + "\n")
    if arguments.save is not None:
        arguments.save.write_text(summary[:-2] + f',\n "entries": [\n{rows}\n ]\n}}\n')
    return 0 if result["failures"] == 0 else 1


def study(
    folder: Path,
    url: str,
    program: str,
    rng: random.Random,
    kills: int,
    most_lost_ms: float,
) -> dict[str, Any]:
    preload()
    started = time.monotonic()
    _, status = os.waitpid(measure(url, program, folder / "whole.h5", OPTIONS), 0)
    whole_s = time.monotonic() - started
    if status != 0:
        raise SystemExit((folder / "whole.txt").read_text())
    entries: list[dict[str, Any]] = []
    while sum(not e["ended_before"] for e in entries) < kills:
        number = len(entries)
        moment_s = rng.uniform(0.1, 1.02 * whole_s)
        settle(folder / "log")
        before = hashes(folder)
        entry = kill_once(folder, url, program, f"kill-{number:03d}", moment_s)
        after = hashes(folder)
        entry["bystanders_unchanged"] = all(after.get(k) == v for k, v in before.items())
        entries.append(entry)
    lost = [e["oldest_lost_ms"] for e in entries if e["oldest_lost_ms"] is not None]
    return {
        "command": "make soak",
        "program": program,
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "whole_measurement_s": round(whole_s, 3),
        "kills": kills,
        "ended_before_their_kill": len(entries) - kills,
        "failures": sum(bool(failure(e, most_lost_ms)) for e in entries),
        "worst_oldest_lost_ms": max(lost, default=None),
        "of_them_above_100_ms": sum(ms > 100.0 for ms in lost),
        "samples_sent": sum(e["sent"] for e in entries),
        "samples_recovered": sum(e["recovered"] for e in entries),
        "entries": entries,
    }


def failure(entry: dict[str, Any], most_lost_ms: float) -> str | None:
    """What is wrong with one kill: nothing older than this may be lost, nothing be damaged."""
    lost = entry["oldest_lost_ms"]
    if lost is not None and lost > most_lost_ms + entry["starved_ms"]:
        return f"a sample that had arrived {most_lost_ms:g} ms before is lost"
    if entry["problems"] or not entry["as_sent"] or not entry["bystanders_unchanged"]:
        return "damaged"
    return None


def kill_once(folder: Path, url: str, program: str, name: str, moment_s: float) -> dict[str, Any]:
    out = folder / f"{name}.h5"
    begun = time.monotonic()
    process = measure(url, program, out, OPTIONS)
    waited = [(begun, 0.0)]
    while (now := time.monotonic()) < begun + moment_s:
        waited.append((now, starved_s(process)))
        time.sleep(TICK_S)
    starved = starved_s(process)
    killed = time.monotonic()
    os.kill(process, signal.SIGKILL)
    _, status = os.waitpid(process, 0)
    before = max(total for t, total in waited if t <= max(begun, killed - WINDOW_S))
    truth = sent(folder / "log", begun, killed)
    journal = Path(f"{out}.journal")
    problems: list[str] = []
    records: tuple[Record, ...] = ()
    state = "nothing yet"
    if journal.exists():
        state = "session and journal" if out.exists() else "journal"
        try:
            recover(journal, out)
        except InputError as error:
            problems = [] if "before anything was recorded" in str(error) else [str(error)]
    elif out.exists():
        state = "session"
    if out.exists():
        session, problems = check(out)
        records = session.records
    got = samples(records)
    events = samples(truth)
    received = b"".join(r.data for r in records if r.kind is Kind.RECEIVED)
    lost = events[len(got) :]
    return {
        "moment_s": round(moment_s, 3),
        "ended_before": os.WIFEXITED(status),  # by itself: done, or vented on a stalled machine
        "left": state,
        "sent": len(events),
        "recovered": len(got),
        "oldest_lost_ms": round(1e3 * (killed - lost[0][0]), 1) if lost else None,
        "starved_ms": round(1e3 * max(0.0, starved - before), 1),
        "as_sent": [e for _, e in got] == [e for _, e in events[: len(got)]]
        and received in b"".join(r.data for r in truth),
        "problems": problems,
    }


def starved_s(process: int) -> float:
    """How long its threads have waited for a processor so far, all together."""
    total_ns = 0
    for task in Path(f"/proc/{process}/task").glob("*/schedstat"):
        with contextlib.suppress(OSError):  # a thread that has just ended
            total_ns += int(task.read_text().split()[1])
    return total_ns / 1e9


def settle(log: Path) -> None:
    """Wait until the probe has vented by itself, as it does when its host is gone."""
    end = time.monotonic() + 300.0
    while time.monotonic() < end:
        last = None
        for item in recorded_items(sent(log, 0.0, end), DIALECT):
            if isinstance(item, TimedEvent) and isinstance(item.event, State):
                last = item.event.state
        if last in {InstrumentState.IDLE, InstrumentState.LOADED}:
            return
        time.sleep(0.02)
    raise SystemExit("the probe did not vent by itself")


def sent(log: Path, begin: float, end: float) -> list[Record]:
    """What the probe sent between these times."""
    found = []
    for line in log.read_text().splitlines():
        time_s, _, data = line.partition(" ")
        if begin <= float(time_s) <= end:
            found.append(Record(Kind.RECEIVED, float(time_s), 0.0, bytes.fromhex(data)))
    return found


def samples(records: list[Record] | tuple[Record, ...]) -> list[tuple[float, Sample]]:
    """Samples of all runs, with the time of their bytes."""
    return [
        (item.host_time_s, item.event)
        for item in recorded_items(records, DIALECT)
        if isinstance(item, TimedEvent) and isinstance(item.event, Sample)
    ]


def hashes(folder: Path) -> dict[str, str]:
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.iterdir()
        if path.suffix in {".h5", ".journal"}
    }


if __name__ == "__main__":
    raise SystemExit(main())
