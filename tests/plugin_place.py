"""Where plugins are installed for real: an environment of its own, and what an installer leaves."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

REPOSITORY = Path(__file__).parents[1]
SKIN = ["--aperture-mm", "6", "--thickness-mm", "1"]
FORWARD = ["forward", "--x1-mpa", "0.03", "--x2-mpa", "1", "--nu", "0.32", *SKIN]
EACH = """
import contextlib, io, json, sys
from skinlab.cli.main import run
done = []
for command in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run(command)
    done.append((status, out.getvalue(), err.getvalue()))
print(json.dumps(done))
"""


class Done(NamedTuple):
    returncode: int
    stdout: str
    stderr: str


class Place:
    """An environment of its own: this Python and its packages, and what is in a folder."""

    def __init__(self, *folders: Path) -> None:
        self.folders = folders
        self.environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(map(str, (*folders, REPOSITORY))),
            "OPENBLAS_NUM_THREADS": "1",
        }

    def run(self, *command: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, *map(str, command)],
            env=self.environment,
            cwd=cwd,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )

    def each(self, *commands: Sequence[object], cwd: Path | None = None) -> list[Done]:
        """Run commands of skinlab one after the other in one process."""
        given = json.dumps([[str(word) for word in command] for command in commands])
        done = self.run("-c", EACH, given, cwd=cwd)
        assert done.returncode == 0, done.stderr
        return [Done(*one) for one in json.loads(done.stdout)]

    def skinlab(self, *arguments: object, cwd: Path | None = None):
        return self.run("-m", "skinlab", *arguments, cwd=cwd)

    def says(self, code: str, tmp_path: Path, *arguments: object) -> str:
        """What a program prints, which is a file, because its workers import it."""
        script = tmp_path / "program.py"
        script.write_text(code)
        done = self.run(script, *arguments)
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout.strip()


def package(folder: Path, name: str, points: dict[str, dict[str, str]], **modules: str) -> Path:
    """What an installer leaves of a package: its modules, and metadata beside them."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "".join(
            f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in entries.items())
            for group, entries in points.items()
        )
    )
    for module, text in modules.items():
        (folder / f"{module}.py").write_text(text)
    return folder
