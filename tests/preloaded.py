"""`skinlab measure` as processes that start at once: forked from one that has imported all."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from skinlab.cli.main import run
from skinlab.tables.store import shipped_table


def preload() -> None:
    """Import and load what a measurement needs, once."""
    for module in (
        "h5py", "drivers.probe", "skinlab.cli.measure", "skinlab.acquisition.measure",
        "skinlab.acquisition.pipeline", "skinlab.report.text",
    ):  # fmt: skip
        importlib.import_module(module)
    shipped_table()


def measure(url: str, program: str, out: Path, options: Sequence[str] = ()) -> int:
    """Fork a process that measures, and says what it has to say in a .txt; return its id."""
    process = os.fork()
    if process:
        return process
    log = os.open(out.with_suffix(".txt"), os.O_CREAT | os.O_WRONLY)
    os.dup2(log, 1)
    os.dup2(log, 2)
    status = 70
    try:
        geometry = ["--aperture-mm", "6", "--thickness-mm", "1"]
        command = ["measure", "--port", url, "--program", program, "--out", str(out)]
        status = run([*command, *geometry, *options])
    finally:
        sys.stdout.flush()
        os._exit(status)
