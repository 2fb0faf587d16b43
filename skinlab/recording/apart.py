"""Read a damaged file in a process of its own: HDF5's library may crash over damaged bytes.

Or it goes round in a circle for ever: then the process is ended.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from skinlab.errors import InputError

_LONGEST_S = 30.0  # to start, and for a session of a visit
_LONGEST_S_PER_BYTE = 30e-6  # a session of 8 MB takes 2e-6


def ask(module: str, path: Path, *arguments: str) -> list[str]:
    """Return the sentences that a module has to say of a file, which may be damaged.

    Raises:
        InputError: the file cannot be read any more.
    """
    command = [sys.executable, "-m", module, str(path), *arguments]
    longest_s = _LONGEST_S + _LONGEST_S_PER_BYTE * path.stat().st_size
    try:
        done = subprocess.run(
            command, capture_output=True, encoding="utf-8", check=False, timeout=longest_s
        )
        said: dict[str, list[str]] = json.loads(done.stdout)
    except (json.JSONDecodeError, subprocess.TimeoutExpired):
        said = {}
    if "found" not in said:
        raise InputError(
            said["unreadable"][0]
            if "unreadable" in said
            else f"{path}: was changed since it was written, and cannot be read any more"
        )
    return said["found"]


def answer(find: Callable[[], list[str]]) -> None:
    """Be the other process: print what `ask` gets."""
    try:
        said = {"found": find()}
    except InputError as error:
        said = {"unreadable": [str(error)]}
    sys.stdout.write(json.dumps(said))
