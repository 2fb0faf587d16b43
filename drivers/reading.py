"""A file that a person named, read whole: never without end, and never for ever."""

from __future__ import annotations

import errno
import os
import select
import stat
from pathlib import Path

MOST_BYTES = 256 << 20
PIPE_PATIENCE_MS, PIPE_LOOKS = 2000, 40  # for whoever writes into a pipe to open it


def read_whole(path: str | Path, most_bytes: int = MOST_BYTES) -> bytes:
    """Return what is in a file, or comes through a pipe (`<(command)`).

    Raises:
        OSError: it cannot be read, or is a folder or device, or larger than most_bytes, or a pipe
            that nobody has open to write.
    """
    _check_name(path)
    number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(number, "rb") as file:
        state = os.fstat(number)
        kind = state.st_mode
        if stat.S_ISDIR(kind):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        begun = b""
        if stat.S_ISFIFO(kind):
            begun = _begun(number)
        elif not stat.S_ISREG(kind):
            raise OSError(errno.EINVAL, "a device; expected a file")
        huge = stat.S_ISREG(kind) and state.st_size > most_bytes
        data = b"" if huge else begun + file.read(most_bytes + 1)
    if huge or len(data) > most_bytes:
        most = f"{most_bytes >> 20} MB" if most_bytes >= 1 << 20 else f"{most_bytes} bytes"
        raise OSError(errno.EFBIG, f"larger than {most}")
    return data


def _begun(number: int) -> bytes:
    """Return the first byte of a pipe, if it is there by now, once somebody has it open to write.

    Who has may take any time: a command that computes what it writes.
    """
    pipe = select.poll()
    pipe.register(number, select.POLLIN)
    for _ in range(PIPE_LOOKS):
        ready = pipe.poll(PIPE_PATIENCE_MS / PIPE_LOOKS)
        try:
            first = os.read(number, 1)
        except BlockingIOError:  # open, and nothing came yet
            first = b""
            ready = [(number, 0)]
        if ready:
            os.set_blocking(number, True)
            return first
    raise OSError(errno.EPIPE, "nobody writes into this pipe")


def require_file(path: str | Path) -> None:
    """Refuse what exists and is no file, for readers that open it themselves.

    Raises:
        OSError: it is a folder, a device or a pipe.
    """
    _check_name(path)
    try:
        kind = os.stat(path).st_mode
    except FileNotFoundError:
        return  # whoever opens it says so
    if not stat.S_ISREG(kind):
        found = "folder" if stat.S_ISDIR(kind) else "pipe" if stat.S_ISFIFO(kind) else "device"
        raise OSError(errno.EINVAL, f"a {found}; expected a file")


def _check_name(path: str | Path) -> None:
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "a zero byte in the name")
