"""Compile the inner loops of the finite elements on installation, where there is a compiler.

Without one the package is the same, and slower: numpy computes what they would.
"""

from __future__ import annotations

import hashlib
import os
import shlex
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDER = Path("skinlab/mechanics/fem")


class CompileKernel(BuildHookInterface):  # type: ignore[type-arg]
    """Puts `_kernel.so` beside `kernel.c`."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and say in the wheel's tag that it is of this platform."""
        if self.target_name != "wheel":
            return
        root = Path(self.root)
        library = root / FOLDER / "_kernel.so"
        if not compile_kernel(root / FOLDER / "kernel.c", library):
            return
        platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{platform}"
        if version != "editable":
            build_data["force_include"][str(library)] = str(FOLDER / library.name)


def compile_kernel(source: Path, library: Path, compiler: Sequence[str] = ()) -> bool:
    """Return whether there is a library of this source now; `compiler`: default `$CC`."""
    library.unlink(missing_ok=True)
    stamp = hashlib.sha256(source.read_bytes()).hexdigest()
    command = [
        *(compiler or shlex.split(os.environ.get("CC", "cc"))), "-O3", "-fPIC", "-shared",
        "-fno-math-errno",
        f'-DSKINLAB_SOURCE="{stamp}"',
        "-o", str(library), str(source), "-lm",
    ]  # fmt: skip
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        reason = str(error)
    else:
        if done.returncode == 0:
            return True
        reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
    library.unlink(missing_ok=True)
    print(f"skinlab: numpy computes the finite elements ({reason})", file=sys.stderr)  # noqa: T201
    return False
