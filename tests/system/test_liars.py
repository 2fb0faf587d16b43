"""`skinlab measure`, a process, at instruments that lie, each another one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("liars.py")
# What test_safety.py does not tell of; all of them, and how soon each is vented, are `make soak`
LIES = ("frozen height", "arms late", "fault in name", "hostile names", "hello again")
# Of kinds that it tells of, in other words
LIKE_OTHERS = (
    "creeps up", "vents in name", "reads nothing", "never starts", "stays high", "says all twice",
)  # fmt: skip


@pytest.mark.parametrize(
    "names", [LIES, pytest.param(LIKE_OTHERS, marks=pytest.mark.long)], ids=["new", "like others"]
)
def test_measure_vents_says_why_and_keeps_what_was_measured(tmp_path, names):
    done = subprocess.run(
        [sys.executable, SCRIPT, "--patient", "--save", "l.json", "--only", *names],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        timeout=300,
        check=False,
    )
    assert done.stdout, done.stderr
    lies = json.loads((tmp_path / "l.json").read_text())["lies"]
    assert set(lies) == set(names)
    assert {name: lie["first_wrong"] for name, lie in lies.items() if lie["wrong"]} == {}
