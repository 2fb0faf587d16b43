"""Every file appears whole, for its owner only."""

from __future__ import annotations

import os
import stat
import sys
import threading

import pytest

from skinlab.errors import InputError
from skinlab.io.files import append_text, whole_file, without_leftovers, write_file
from skinlab.io.log import log_exception


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


@pytest.fixture(autouse=True)
def _open_umask():
    before = os.umask(0)
    yield
    os.umask(before)


def test_a_file_is_its_owners_and_is_not_overwritten_unasked(tmp_path):
    path = tmp_path / "new" / "a.txt"
    write_file(path, "one")
    assert mode(path) == 0o600
    with pytest.raises(InputError, match="exists already"):
        write_file(path, "two")
    path.chmod(0o644)
    write_file(path, b"three", replace=True)
    assert (path.read_bytes(), mode(path)) == (b"three", 0o600)
    assert [p.name for p in path.parent.iterdir()] == ["a.txt"]


def test_a_writer_that_fails_leaves_what_was_there(tmp_path):
    path = tmp_path / "a.txt"
    write_file(path, "one")
    with pytest.raises(InputError), whole_file(path, replace=True) as partial:
        partial.joinpath("of a file").write_text("half")
    assert path.read_text() == "one"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.skipif(sys.platform == "win32", reason="no pipes in folders")
def test_a_device_or_pipe_is_never_replaced_by_a_file(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    with pytest.raises(InputError, match="cannot be written"), whole_file(path, replace=True):
        pass
    assert stat.S_ISFIFO(path.stat().st_mode)
    assert [p.name for p in tmp_path.iterdir()] == ["pipe"]


@pytest.mark.skipif(sys.platform == "win32", reason="locks of folders are not for Windows")
def test_what_a_killed_writer_left_goes_and_what_is_being_written_stays(tmp_path):
    left = tmp_path / ".skinlab-killed.partial"
    left.write_text("half")
    with without_leftovers(tmp_path):
        assert not list(tmp_path.iterdir())
        with whole_file(tmp_path / "a.txt") as partial:
            with without_leftovers(tmp_path):  # another writer: locks are of whoever opened
                write_file(tmp_path / "b.txt", "two")
            partial.write_text("one")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.txt", "b.txt"]
    assert (tmp_path / "a.txt").read_text() == "one"
    left.write_text("half")
    with without_leftovers(tmp_path):
        pass
    assert not left.exists()
    with pytest.raises(FileNotFoundError), without_leftovers(tmp_path / "none"):
        pass


def test_a_link_is_followed_and_a_pipe_is_written_to(tmp_path):
    (tmp_path / "real.txt").write_text("one")
    (tmp_path / "link.txt").symlink_to("real.txt")
    write_file(tmp_path / "link.txt", "two", replace=True)
    assert (tmp_path / "real.txt").read_text() == "two"
    assert (tmp_path / "link.txt").is_symlink()
    pipe, found = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: found.append(pipe.read_text()))
    reader.start()
    write_file(pipe, "three", replace=True)
    reader.join()
    assert found == ["three"]


def test_what_cannot_be_written_is_a_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file" / "x", tmp_path, tmp_path / ("n" * 300)):
        with pytest.raises(InputError, match=r"cannot be written|exists already"):
            write_file(path, "x")


def test_the_log_is_its_owners_and_inert(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    path = log_exception(ValueError("\x1b]0;evil\x07"))
    assert mode(path) == 0o600
    assert "\x1b" not in path.read_text(encoding="utf-8")
    path.chmod(0o644)
    append_text(path, "more")
    assert mode(path) == 0o600
