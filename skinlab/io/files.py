"""Files that appear whole or not at all, and are for their owner only: they are about persons."""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from drivers.reading import require_file
from skinlab.errors import InputError

if sys.platform != "win32":
    import fcntl

_PRIVATE = 0o600
_BEGIN, _END = ".skinlab-", ".partial"  # of the name of a file that is not whole yet


def write_file(path: Path, content: bytes | memoryview | str, *, replace: bool = False) -> None:
    """Write a file; it is on the disk when this returns, and text is UTF-8.

    A device or pipe (`/dev/stdout`) is written to as it is.

    Raises:
        InputError: it cannot be written, or exists and is not to be replaced.
    """
    raw = content.encode() if isinstance(content, str) else content
    with cannot_write(path):
        if replace and path.exists() and not stat.S_ISREG(path.stat().st_mode):
            with path.open("wb") as stream:
                stream.write(raw)
            return
        with _whole(path, replace) as partial, partial.open("wb") as file:
            file.write(raw)


def check_can_write(path: Path) -> None:
    """Make sure before long work that a file can be written there; nothing is left behind.

    Raises:
        InputError: its folder can be neither written nor made.
    """
    import tempfile  # slow to import

    there = next(p for p in path.absolute().parents if os.path.lexists(p))
    with cannot_write(path), tempfile.TemporaryFile(dir=there):
        pass


def real_path(path: Path) -> Path:
    """Return the path without links; of links in a circle as far as they go."""
    return Path(os.path.realpath(path))


def file_hash(path: Path) -> str:
    """Return `sha256:…` of the file's bytes."""
    with open(path, "rb") as file:
        return "sha256:" + hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def whole_file(path: Path, *, replace: bool = False) -> Iterator[Path]:
    """Give the path of an empty file to fill, which takes its name at the end.

    Raises:
        InputError: it cannot be written, or exists and is not to be replaced.
    """
    with cannot_write(path), _whole(path, replace) as partial:
        yield partial


@contextmanager
def whole_text(path: Path) -> Iterator[TextIO]:
    """Give a stream for text that is too much to be held; the file takes its name at the end.

    Raises:
        InputError: it cannot be written.
    """
    with (
        whole_file(path, replace=True) as partial,
        partial.open("w", encoding="utf-8", newline="") as stream,
    ):
        yield stream


def make_folder(folder: Path) -> None:
    """Make a folder where there is none, and those that it is in, for their owner only.

    Raises:
        OSError: it cannot be made.
    """
    if not folder.parent.exists():
        make_folder(folder.parent)
    folder.mkdir(mode=0o700, exist_ok=True)


@contextmanager
def without_leftovers(folder: Path) -> Iterator[None]:
    """Remove partial files of killed writers from a folder, all of whose writers write in here.

    Writers share a lock of the folder, which the system takes from those that are gone. Who gets
    it alone knows that nobody else is writing. Without locks nothing is removed.

    Raises:
        OSError: there is no such folder.
    """
    if sys.platform == "win32":
        yield
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # others are writing, or there are no locks here
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for left in folder.glob(f"{_BEGIN}*{_END}"):
                left.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            fcntl.flock(number, fcntl.LOCK_SH)
        yield
    finally:
        os.close(number)


@contextmanager
def _whole(path: Path, replace: bool) -> Iterator[Path]:
    path = real_path(path) if replace else path  # not the link: what it leads to
    if not replace and os.path.lexists(path):
        raise FileExistsError
    require_file(path)  # a device would be gone for everybody
    make_folder(path.parent)
    import tempfile  # slow to import

    number, name = tempfile.mkstemp(_END, _BEGIN, path.parent)  # 0600
    os.close(number)
    partial = Path(name)
    try:
        yield partial
        _to_disk(partial)
        if replace:
            os.replace(partial, path)
        else:
            _take_name(partial, path)
        if hasattr(os, "O_DIRECTORY"):
            _to_disk(path.parent)  # the name too survives a power cut
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)


def _to_disk(path: Path) -> None:
    number = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def _take_name(partial: Path, path: Path) -> None:
    """Give the whole file its name, which must be free."""
    try:
        os.link(partial, path)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if path.exists():
            raise FileExistsError from None
        os.replace(partial, path)


def private(path: str, flags: int) -> int:
    """Open for the owner only; the `opener` of files that grow: logs, kept rows, traces."""
    return os.open(path, flags, _PRIVATE)


def append_text(path: Path, text: str) -> None:
    """Add text to a file that grows.

    Raises:
        InputError: it cannot be written.
    """
    with cannot_write(path):
        make_folder(path.parent)
        with open(path, "a", encoding="utf-8", opener=private) as file:
            with contextlib.suppress(OSError, AttributeError):
                os.fchmod(file.fileno(), _PRIVATE)  # one of an older version
            file.write(text)


@contextmanager
def named_in_errors(file: object) -> Iterator[None]:
    """Begin the sentence about what is wrong with a file, or in it, with the file's name.

    Raises:
        InputError: in the place of an OSError or a ValueError, of which it is one itself.
    """
    try:
        yield
    except OSError as error:
        raise InputError(f"{file}: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(f"{file}: {error}") from None


@contextmanager
def cannot_read(path: Path) -> Iterator[None]:
    """Say in a sentence why a file cannot be read, or even looked for.

    Raises:
        InputError: in the place of an OSError.
    """
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None


@contextmanager
def cannot_write(path: Path) -> Iterator[None]:
    """Say in a sentence why a file cannot be written.

    Raises:
        InputError: in the place of an OSError.
    """
    try:
        yield
    except OSError as error:
        if isinstance(error, FileExistsError) and os.path.lexists(path):  # not: its folder is one
            raise InputError(f"{path}: exists already and is never overwritten") from None
        why = error.strerror or str(error)
        raise InputError(f"{path}: cannot be written ({why})") from None
