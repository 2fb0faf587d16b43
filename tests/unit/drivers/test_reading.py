from __future__ import annotations

import os
import threading

import pytest

from drivers.reading import read_whole, require_file
from skinlab.cli.main import run

NEEDS_PIPES = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")


def test_a_file_is_read_whole(tmp_path):
    (tmp_path / "f").write_bytes(b"abc\r\n")
    assert read_whole(tmp_path / "f", 5) == b"abc\r\n"
    with pytest.raises(OSError, match="larger than 4 bytes"):
        read_whole(tmp_path / "f", 4)


@NEEDS_PIPES
def test_a_pipe_is_read_to_its_end_and_one_that_nobody_fills_is_not_waited_for(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="nobody writes"):
        read_whole(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(b"x" * 300_000,))
    writer.start()
    assert read_whole(pipe) == b"x" * 300_000
    writer.join()


@NEEDS_PIPES
def test_a_command_that_computes_what_it_writes_is_waited_for(tmp_path, monkeypatch):
    """It has the pipe open, and is silent for longer than one would wait for a writer."""
    monkeypatch.setattr("drivers.reading.PIPE_PATIENCE_MS", 40)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    found: list[bytes] = []
    reader = threading.Thread(target=lambda: found.append(read_whole(pipe)))
    held = os.open(pipe, os.O_RDWR)  # the writer is there before the reader looks
    reader.start()
    reader.join(0.5)
    assert reader.is_alive()
    os.write(held, b"late")
    os.close(held)
    reader.join()
    assert found == [b"late"]


@NEEDS_PIPES
@pytest.mark.parametrize("name", ["/dev/zero", "/dev/null", "/"])
def test_devices_and_folders_are_no_files(name):
    with pytest.raises(OSError, match=r"device|directory"):
        read_whole(name)
    with pytest.raises(OSError, match="expected a file"):
        require_file(name)


@NEEDS_PIPES
@pytest.mark.parametrize(
    "command",
    [
        ["identify", "ODD"], ["cutometer", "ODD"],
        ["import", "ODD", "--aperture-mm", "6", "--thickness-mm", "1", "--out", "s.h5"],
        ["session", "info", "ODD"], ["session", "verify", "ODD"], ["replay", "ODD"],
        ["export", "ODD", "--to", "html", "out"], ["recover", "ODD"], ["database", "info", "ODD"],
        ["calibrate", "--port", "sim://", "--check", "ODD"],
        ["measure", "--port", "sim://?skin=ODD", "--aperture-mm", "6", "--thickness-mm", "1",
         "--program", "ramp:60@60", "--out", "s.h5"],
        ["measure", "--port", "sim://", "--protocol", "ODD", "--thickness-mm", "1",
         "--out", "s.h5"],
        ["capture", "--port", "sim://", "--dialect", "ODD", "--seconds", "0", "--out", "c"],
        ["compare", "ODD", "ODD"], ["discrepancy", "ODD"],
        ["database", "build", "--spec", "ODD", "--out", "d.h5"],
        ["study", "ODD", "--out", "s"], ["study", ".", "--out", "ODD"],
    ],
    ids=lambda words: "-".join(w for w in words if w.isalpha()),
)  # fmt: skip
@pytest.mark.parametrize("odd", ["pipe.toml", "endless.toml", "loop.toml"])
def test_no_command_waits_for_a_pipe_or_reads_a_device(command, odd, tmp_path, monkeypatch, capsys):
    """Several waited for ever, and /dev/zero took the computer's memory."""
    monkeypatch.chdir(tmp_path)
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "endless.toml").symlink_to("/dev/zero")
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    monkeypatch.setattr("drivers.reading.PIPE_PATIENCE_MS", 10)
    status = run([word.replace("ODD", odd) for word in command])
    said = capsys.readouterr().err
    assert status in {2, 3, 4}, said
    known = (
        "cannot be written",
        "pipe",
        "device",
        "no such f",
        "expected a folder",
        "symbolic links",
        "not found",
    )
    assert any(word in said for word in known), said
