"""`skinlab measure`, a process, at instruments that lie, each another one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).with_name("liars.py")
# What test_safety.py does not tell of; all of them, and how soon each is vented, are `make soak`
LIES = (
    "creeps up", "vents in name", "frozen height", "reads nothing",
    "arms late", "never starts", "says all twice",
    "hostile names", "stays high", "fault in name", "hello again",
)  # fmt: skip


def test_measure_vents_says_why_and_keeps_what_was_measured(tmp_path):
    done = subprocess.run(
        [sys.executable, SCRIPT, "--patient", "--save", "l.json", "--only", *LIES],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        timeout=300,
        check=False,
    )
    assert done.stdout, done.stderr
    lies = json.loads((tmp_path / "l.json").read_text())["lies"]
    assert set(lies) == set(LIES)
    assert {name: lie["first_wrong"] for name, lie in lies.items() if lie["wrong"]} == {}
