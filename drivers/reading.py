"""A file that a person named, read whole: never without end, and never for ever."""

from __future__ import annotations

import errno
import os
import select
import stat
from pathlib import Path

MOST_BYTES = 256 << 20
PIPE_PATIENCE_MS = 2000  # for whoever writes into a pipe to open it


def read_whole(path: str | Path, most_bytes: int = MOST_BYTES) -> bytes:
    """Return what is in a file, or comes through a pipe (`<(command)`).

    Raises:
        OSError: it cannot be read, or is a folder or device, or larger than most_bytes, or a pipe
            into which nobody writes.
    """
    _check_name(path)
    number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(number, "rb") as file:
        state = os.fstat(number)
        kind = state.st_mode
        if stat.S_ISDIR(kind):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if stat.S_ISFIFO(kind):
            pipe = select.poll()
            pipe.register(number, select.POLLIN)
            if not pipe.poll(PIPE_PATIENCE_MS):
                raise OSError(errno.EPIPE, "nobody writes into this pipe")
            os.set_blocking(number, True)
        elif not stat.S_ISREG(kind):
            raise OSError(errno.EINVAL, "a device, and no file")
        huge = stat.S_ISREG(kind) and state.st_size > most_bytes
        data = b"" if huge else file.read(most_bytes + 1)
    if huge or len(data) > most_bytes:
        raise OSError(errno.EFBIG, f"larger than {most_bytes >> 20} MB")
    return data


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
        raise OSError(errno.EINVAL, "a folder, device or pipe, and no file")


def _check_name(path: str | Path) -> None:
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "a zero byte in the name")
