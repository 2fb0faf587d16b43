"""Recordings under what can happen to them: kill -9, a full disk, a folder that takes no files."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from patience import patient_command

from skinlab.recording.session_check import check

HERE = Path(__file__).parent
SKINLAB = patient_command("skinlab")
PATIENCE_S = 300.0
MEASURE = ["measure", "--aperture-mm", "6", "--thickness-mm", "1", "--program"]
ENVIRONMENT = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}


@pytest.mark.long
def test_five_kills_at_random_moments_damage_nothing(tmp_path):
    """The hundred, at longer measurements, and how much of the end is lost, are `make soak`."""
    options = ["--kills=5", "--program=ramp:100@60", "--save=k.json", "--patient"]
    done = subprocess.run(
        [sys.executable, HERE / "kills.py", *options],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env=ENVIRONMENT,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.stdout, done.stderr
    result = json.loads((tmp_path / "k.json").read_text())
    assert sum(not entry["ended_before"] for entry in result["entries"]) == 5
    for entry in result["entries"]:
        assert entry["problems"] == [], entry
        assert entry["as_sent"], entry
        assert entry["bystanders_unchanged"], entry
    assert done.returncode == 0
    assert result["samples_recovered"] > 50


def can_mount() -> bool:
    if shutil.which("unshare") is None:
        return False
    probe = ["unshare", "-rm", "mount", "-t", "tmpfs", "tmpfs", "/mnt"]
    return subprocess.run(probe, capture_output=True, check=False).returncode == 0


needs_mount = pytest.mark.skipif(not can_mount(), reason="no own file system can be mounted here")


def on_own_disk(folder: Path, options: str, *arguments: str) -> list[str]:
    """Command that runs skinlab with a small file system of its own in this folder."""
    script = 'mount -t tmpfs -o "$0" tmpfs "$1" && cd "$1" && shift && exec "$@"'
    command = ["unshare", "-rm", "sh", "-c", script, options, str(folder)]
    return [*command, *SKINLAB, *arguments]


@contextmanager
def running(command: list[str], **more: object) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        command,
        env=ENVIRONMENT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **more,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
            process.communicate()


def wait_for_bytes(journal: Path, size: int, process: subprocess.Popen[str]) -> None:
    """Return once the journal's WAL has grown to this size."""
    wal = Path(f"{journal}-wal")
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline and process.poll() is None:
        if wal.exists() and wal.stat().st_size > size:
            return
        time.sleep(0.02)
    raise AssertionError(f"nothing was recorded: {process.communicate(timeout=PATIENCE_S)}")


@needs_mount
def test_a_full_disk_is_told_before_the_suction(tmp_path):
    command = on_own_disk(
        tmp_path, "size=2m", *MEASURE, "ramp:100@20", "--port", "sim://?seed=1", "--out", "s.h5"
    )
    with running(command) as process:
        _, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 3
    assert "are free on this disk; expected at least" in told
    assert "vent" not in told


@needs_mount
@pytest.mark.parametrize(
    "options", ["ro,size=2m", pytest.param("size=2m,mode=0555,nr_inodes=1", marks=pytest.mark.long)]
)
def test_a_folder_that_takes_no_files_is_told_before_the_suction(tmp_path, options):
    command = on_own_disk(
        tmp_path, options, *MEASURE, "ramp:100@20", "--port", "sim://?seed=1", "--out", "s.h5"
    )
    with running(command) as process:
        _, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 3
    assert "s.h5.journal: cannot be written (" in told
    assert "Traceback" not in told


def fill(path: Path) -> None:
    with path.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(4096))


@pytest.mark.long
@needs_mount
def test_a_disk_that_fills_up_vents_and_keeps_what_is_there(tmp_path):
    """Somebody else fills it in the middle; with room again, all is recovered."""
    command = on_own_disk(
        tmp_path, "size=30m", *MEASURE, "ramp:100@20,hold:30", "--port", "sim://?seed=1",
        "--out", "s.h5",
    )  # fmt: skip
    kept = tmp_path / "kept"
    with running(command) as process:
        inside = Path(f"/proc/{process.pid}/root{tmp_path}")
        wait_for_bytes(inside / "s.h5.journal", 300_000, process)
        anchor = os.open(inside, os.O_RDONLY)  # the file system outlives the process
        try:
            fill(inside / "filler")
            _, told = process.communicate(timeout=PATIENCE_S)
            disk = Path(f"/proc/self/fd/{anchor}")
            assert not (disk / "s.h5").exists()
            kept.mkdir()
            for path in disk.glob("s.h5.journal*"):
                shutil.copy(path, kept)
        finally:
            os.close(anchor)
    assert process.returncode == 4
    assert "Traceback" not in told
    assert "the probe was told to vent" in told
    assert "full" in told
    assert "skinlab recover" in told
    recover(kept / "s.h5.journal")


def recover(journal: Path) -> None:
    done = subprocess.run(
        [*SKINLAB, "recover", journal.name],
        cwd=journal.parent,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    session, problems = check(journal.with_suffix(""))
    assert problems == []
    (curve,) = session.curves
    assert curve.partial
    assert len(curve) > 10


@pytest.mark.long
def test_a_file_that_may_not_grow_vents_and_keeps_what_is_there(tmp_path):
    """A limit of the system that no free space shows: it is met in the middle."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))

    command = [
        *SKINLAB, *MEASURE, "ramp:100@20,hold:50", "--rate-hz", "200", "--port",
        "sim://?seed=1", "--out", "s.h5",
    ]  # fmt: skip
    with running(command, cwd=tmp_path, preexec_fn=limit) as process:
        _, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 4
    assert "Traceback" not in told
    assert "the probe was told to vent" in told
    assert "skinlab recover" in told
    recover(tmp_path / "s.h5.journal")


def test_a_name_is_refused_before_anything_is_stored(tmp_path):
    done = subprocess.run(
        [
            *SKINLAB,
            *MEASURE,
            "ramp:100@50",
            "--port=sim://",
            "--out=s.h5",
            "--subject=Anna Schmidt",
        ],
        cwd=tmp_path,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 3
    assert "expected a pseudonym" in done.stderr
    assert list(tmp_path.iterdir()) == []
