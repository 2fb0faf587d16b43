"""The first and the last moments of the process."""

from __future__ import annotations

import errno
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

FORWARD = (
    "forward --x1-mpa 0.03 --x2-mpa 1 --nu 0.3 --aperture-mm 6 --thickness-mm 1 --program ramp:9@9"
)

# Ctrl-C at the moment in which a module is about to be imported
CTRL_C = """
import os, runpy, signal, sys

class CtrlC:
    def find_spec(self, name, path=None, target=None):
        if name == wanted:
            os.kill(os.getpid(), signal.SIGINT)

# A background job, such as a CI's, starts with it ignored
signal.signal(signal.SIGINT, signal.default_int_handler)
wanted = sys.argv.pop(1)
sys.meta_path.insert(0, CtrlC())
runpy.run_module("skinlab", run_name="__main__", alter_sys=True)
"""


def shell(redirections: str, folder: Path, *more: str) -> subprocess.CompletedProcess[str]:
    command = shlex.join([sys.executable, "-m", "skinlab", *shlex.split(FORWARD), *more])
    return subprocess.run(
        ["sh", "-c", f"{command} {redirections}"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("module", ["skinlab.cli.main", "click", "numpy.linalg", "h5py"])
def test_ctrl_c_while_libraries_are_imported_is_one_word(module):
    done = subprocess.run(
        [sys.executable, "-c", CTRL_C, module, *shlex.split(FORWARD)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "skinlab: interrupted\n")


@pytest.fixture(scope="module")
def printed(tmp_path_factory) -> str:
    return shell("", tmp_path_factory.mktemp("printed")).stdout


@pytest.mark.parametrize("closed", [">&- 2>&- <&-", pytest.param(">&-", marks=pytest.mark.long)])
def test_closed_streams_are_no_failure_and_no_file_takes_their_place(tmp_path, printed, closed):
    done = shell(closed, tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert shell(closed, tmp_path, "--csv", "c.csv").returncode == 0
    assert (tmp_path / "c.csv").read_text() == printed


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_output_that_cannot_be_written_is_one_sentence(tmp_path):
    done = shell(">/dev/full", tmp_path)
    assert done.returncode == 3
    assert done.stderr == f"skinlab: standard output: {os.strerror(errno.ENOSPC)}\n"
