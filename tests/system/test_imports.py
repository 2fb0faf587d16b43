"""What a command does not need it does not import: that is most of the time that it takes."""

import json
import subprocess
import sys

import pytest

from skinlab.mechanics.fem import kernel

SLOW = (
    "matplotlib",
    "openpyxl",
    "pandas",
    "textual",
    "serial",
    "scipy",
    "pyarrow",
    "email",
)  # email: by importlib.metadata
LOADED = """
import json, sys
from skinlab.cli.main import run
status = run(sys.argv[1:])
print(json.dumps([status, sorted({name.split(".")[0] for name in sys.modules})]), file=sys.stderr)
"""


def loaded_by(*arguments):
    done = subprocess.run(
        [sys.executable, "-c", LOADED, *arguments], capture_output=True, text=True, check=True
    )
    status, modules = json.loads(done.stderr.splitlines()[-1])
    assert status == 0, done.stderr
    return [name for name in SLOW if name in modules]


@pytest.mark.skipif(kernel.library() is None, reason="without the kernel, scipy does its work")
def test_identification_and_finite_elements_load_nothing_slow(tmp_path):
    curve = tmp_path / "curve.csv"
    by_finite_elements = [
        "forward", "--direct", "--x1-mpa", "0.03", "--x2-mpa", "1", "--nu", "0.32", "--aperture-mm",
        "6", "--thickness-mm", "1", "--program", "ramp:100@20", "--csv", str(curve),
    ]  # fmt: skip
    assert loaded_by(*by_finite_elements) == []
    assert loaded_by("identify", str(curve), "--aperture-mm", "6", "--thickness-mm", "1") == []


def test_help_loads_nothing_slow():
    assert loaded_by("--help") == []
