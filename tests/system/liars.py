"""Real measurements of instruments that lie: how soon each is told to vent, and what is said.

    python tests/system/liars.py --rounds 20 --save benchmarks/results/liars.json

Instrument and `skinlab measure` are a process each. `after_ms` is by the instrument's own clock:
from the first sample that no honest instrument sends (docs/safety.md says which) to the word to
vent. What may be late then is the machine, so that a loaded one says more.

`--patient` forgives a process that did not run for a while, as the tests on a busy machine must.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import subprocess
import sys
import tempfile
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"

sys.path.insert(0, str(Path(__file__).parents[1]))

from patience import FORGIVING_S
from preloaded import measure, preload

from drivers.probe import DEFAULTS, Limits
from skinlab.errors import InputError
from skinlab.recording.session import read_session

LIAR = Path(__file__).parents[1] / "lying_instrument.py"
WITHIN_MS = 500.0
AT_ONCE = 8  # so that they do not keep each other waiting


@dataclass(frozen=True)
class Lie:
    """What an instrument is told to measure, when its lie can be known, and what must be said."""

    program: str
    seen_s: float | None  # since Start; None: nothing is pulled, or nothing is vented
    words: str
    status: int = 4
    repeats: int = 1
    partial: bool = True  # what was measured; not where it lies behind the program's end


HELD = "ramp:60@100000,hold:4"
SHORT = "ramp:60@100000,hold:1"
LIES = {
    "creeps up": Lie(HELD, 1.5, "overshoot"),
    "vents in name": Lie(HELD, 1.5, "lift the probe"),
    "holds on": Lie(SHORT, 1.0 + 0.15, "behind the program"),
    "jumps": Lie(HELD, 1.0, "ahead of the host's"),
    "wobbles": Lie(HELD, 1.02, "ahead of the host's"),
    "back again": Lie(HELD, 1.0, "back in segment"),
    "past the end": Lie(HELD, 1.0, "past the end"),
    "stands": Lie(HELD, 1.0 + 0.3, "stale"),
    "counts back": Lie(HELD, 0.78 + 0.3, "stale"),
    "frozen height": Lie("ramp:100@20", 0.5 + 0.5, "frozen deflection"),
    "frozen pressure": Lie("ramp:100@20", 1.5 + 0.5, "frozen pressure"),
    "half open": Lie("ramp:60@100000,hold:1,rest:2", 1.0, "overshoot: 40 mbar"),
    "pulls between runs": Lie(SHORT, 1.5, "suction of 30 mbar while", repeats=2, partial=False),
    "wrong sign": Lie(HELD, 0.0, "impossible pressure"),
    "reads nothing": Lie("ramp:60@100,hold:4", 0.2 + 1.0, "no skin"),
    "starts by itself": Lie(HELD, 0.0, "nobody has started it"),
    "arms late": Lie(HELD, None, "Arm"),
    "never starts": Lie(HELD, None, "Start"),
    "stays high": Lie("ramp:60@100000,hold:1", 1.0, "overshoot: 60 mbar", partial=False),
    "vents in silence": Lie(SHORT, 1.0, "stale", partial=False),
    "fault in name": Lie(SHORT, 1.0, "vented by itself", partial=False),
    "hello again": Lie(HELD, 1.0, "hello in the middle"),
    "states only": Lie(HELD, 1.0 + 0.3, "stale"),
    "hostile names": Lie(HELD, 1.0, "fault"),
    "refuses to vent": Lie(HELD, 1.5, "refuses to vent"),
    "old program": Lie("ramp:100@20", 0.0, "overshoot: 60 mbar"),
    "old times": Lie(HELD, 0.0, "ahead of the host's"),
    "floods": Lie(HELD, 1.0 + 0.3, "stale"),
    "floods with lines": Lie(HELD, 1.0 + 0.3, "stale"),
    "babbles": Lie(HELD, 1.0 + 0.3, "vent"),
    "floods for a name": Lie(HELD, None, "no answer to Identify"),
    "answers another": Lie(HELD, 0.0, "while armed"),
    "streams early": Lie(HELD, 0.0, "suction of 30 mbar while"),
    "leaks shut": Lie(SHORT, 1.0 + 1.0, "around 5 mbar or more for 1 s", partial=False),
    "says all twice": Lie(SHORT, None, "", 0),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--save", type=Path)
    parser.add_argument("--only", nargs="+", choices=LIES, default=list(LIES), metavar="LIE")
    parser.add_argument("--patient", action="store_true")
    arguments = parser.parse_args()
    if arguments.patient:
        DEFAULTS.limits = Limits(stale_s=FORGIVING_S, clock_s=FORGIVING_S)
    within_ms = math.inf if arguments.patient else WITHIN_MS
    preload()
    result: dict[str, Any] = {
        "command": "make soak",
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "rounds": arguments.rounds,
        "lies": {name: [] for name in arguments.only},
    }
    some = [arguments.only[k : k + AT_ONCE] for k in range(0, len(arguments.only), AT_ONCE)]
    for names in some * arguments.rounds:
        with tempfile.TemporaryDirectory(prefix="skinlab-liars-") as folder:
            for name, said in round_of_lies(Path(folder), names, within_ms).items():
                result["lies"][name].append(said)
    for name, tries in result["lies"].items():
        after = [t["after_ms"] for t in tries if t["after_ms"] is not None]
        result["lies"][name] = {
            "wrong": sum(bool(t["wrong"]) for t in tries),
            "most_after_ms": max(after, default=None),
            "said": tries[0]["said"],
            "first_wrong": next((t["wrong"] for t in tries if t["wrong"]), None),
        }
    text = json.dumps(result, indent=1)
    sys.stdout.write(text + "\n")
    if arguments.save is not None:
        arguments.save.write_text(text + "\n")
    return int(any(lie["wrong"] for lie in result["lies"].values()))


def round_of_lies(
    folder: Path, names: Sequence[str], within_ms: float
) -> dict[str, dict[str, Any]]:
    """Measure at each of these liars once, at all of them at the same time."""
    liars, hosts = {}, {}
    try:
        for number, name in enumerate(names):
            command = [sys.executable, str(LIAR), "--log", str(folder / f"{number}.log"), name]
            liars[name] = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        for number, name in enumerate(names):
            stream = liars[name].stdout
            assert stream is not None
            url = stream.readline().strip()
            again = ["--repeats", str(LIES[name].repeats), "--rest-s", "3"]
            hosts[name] = measure(url, LIES[name].program, folder / f"{number}.h5", again)
        ends = {name: os.waitstatus_to_exitcode(os.waitpid(h, 0)[1]) for name, h in hosts.items()}
    finally:
        for process in liars.values():
            process.kill()
            process.communicate()
    return {
        name: judged(LIES[name], ends[name], folder / f"{number}.h5", within_ms)
        for number, name in enumerate(names)
    }


def judged(lie: Lie, status: int, out: Path, within_ms: float) -> dict[str, Any]:
    """Say what is wrong with the end of one measurement, and how late the vent was."""
    said = out.with_suffix(".txt").read_text()
    log = [line.split() for line in out.with_suffix(".log").read_text().splitlines()]
    started = next((k for k, (_, word, _) in enumerate(log) if word == "Start"), 0)
    vents = [float(t) for t, word, _ in log[started:] if word == "Vent"]
    after_ms = None if lie.seen_s is None or not vents else round(1e3 * (vents[0] - lie.seen_s), 1)
    wrong = []
    if status != lie.status:
        wrong.append(f"status {status}")
    if lie.words not in said:
        wrong.append(f"not said: {lie.words}")
    if any(unicodedata.category(c) in {"Cc", "Cf"} for c in said.replace("\n", "")):
        wrong.append("what acts on a terminal")
    if "Traceback" in said or "internal error" in said:
        wrong.append("a bug")
    if lie.seen_s is not None and after_ms is None:
        wrong.append("not vented")
    if after_ms is not None and after_ms > within_ms:
        wrong.append(f"vented after {after_ms:g} ms")
    if lie.seen_s:
        try:
            (curve,) = read_session(out).curves
        except (InputError, ValueError):
            wrong.append("no curve kept")
        else:
            wrong += [] if curve.partial or not lie.partial else ["not marked partial"]
    return {"after_ms": after_ms, "said": said.strip().splitlines()[-3:], "wrong": wrong}


if __name__ == "__main__":
    raise SystemExit(main())
