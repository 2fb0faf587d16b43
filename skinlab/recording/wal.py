"""Read a database whose write-ahead log is damaged: SQLite stops there, and deletes the rest.

A journal is nearly all in that file until it is closed, so one flipped bit would cost what was
measured behind it. Here only the page that is damaged is given up. The format:
https://www.sqlite.org/fileformat2.html#the_write_ahead_log
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from skinlab.io.files import cannot_read, write_file

_HEADER_BYTES = 32
_FRAME_BYTES = 24  # and the page behind it
_MAGIC = 0x377F0682  # or one more, where the sums are of big-endian words
_VERSION = 3007000
_PAGES = frozenset(1 << k for k in range(9, 17))  # sizes in bytes
_USUAL_PAGE = 4096
_MOST_BYTES = 1 << 28  # of a log that skinlab wrote: 16 MB, and what came while it was moved over
_MASK = 0xFFFFFFFF

Sum = tuple[int, int]


def _add(sums: Sum, data: bytes, order: str) -> Sum:
    """Return SQLite's checksum, gone on over this."""
    a, b = sums
    for x, y in struct.iter_unpack(f"{order}II", data):
        a = (a + x + b) & _MASK
        b = (b + y + a) & _MASK
    return a, b


def mended(log: bytes) -> tuple[bytes, int] | None:
    """Return a log that SQLite reads to its last commit, and the first byte that was damaged.

    None: it does so already, or there is nothing in it.
    """
    if len(log) < _HEADER_BYTES + _FRAME_BYTES:
        return None
    magic, version, page, sequence, *salts, sum_a, sum_b = struct.unpack(">8I", log[:_HEADER_BYTES])
    order = ">" if magic & 1 else "<"
    sums = _add((0, 0), log[: _HEADER_BYTES - 8], order)
    bad_at = None if sums == (sum_a, sum_b) and magic & ~1 == _MAGIC else 0
    if bad_at is not None:
        page = page if page in _PAGES else _USUAL_PAGE
        version, order = _VERSION, "<"
        salts = list(struct.unpack_from(">2I", log, _HEADER_BYTES + 8))
        head = struct.pack(">6I", _MAGIC, version, page, sequence, *salts)
        sums = _add((0, 0), head, order)
    else:
        head = log[: _HEADER_BYTES - 8]
    whole = bytearray(head + struct.pack(">2I", *sums))
    kept = 0  # bytes of it up to the last commit
    lost = False  # a commit that SQLite would not reach
    for at in range(_HEADER_BYTES, len(log) - _FRAME_BYTES - page + 1, _FRAME_BYTES + page):
        number, commit, *rest = struct.unpack_from(">6I", log, at)
        data = log[at + _FRAME_BYTES : at + _FRAME_BYTES + page]
        ours = rest[:2] == list(salts) and number > 0
        found = _add(_add(sums, log[at : at + 8], order), data, order)
        if bad_at is None and (not ours or found != tuple(rest[2:])):
            bad_at = at
        if not ours:  # its head is damaged, or it is left from before and not written over yet
            continue
        sums = found
        whole += struct.pack(">6I", number, commit, *salts, *sums) + data
        if commit:
            kept, lost = len(whole), lost or bad_at is not None
    return (bytes(whole[:kept]), bad_at) if lost and bad_at is not None else None


@contextmanager
def readable(path: Path, skipped: list[str]) -> Iterator[Path]:
    """Yield a database whose log can be read to its end: itself, or a copy that is mended.

    What was damaged is added to `skipped`; the files themselves stay as they are.
    """
    log = path.with_name(f"{path.name}-wal")
    with cannot_read(log):
        data = log.read_bytes() if log.is_file() and log.stat().st_size < _MOST_BYTES else b""
    found = mended(data)
    if found is None and (not data or path.stat().st_size):
        yield path
        return
    with TemporaryDirectory(prefix="skinlab-") as folder:
        copy = Path(folder) / "journal"
        with cannot_read(path):
            content = path.read_bytes()
        # SQLite would delete the log of an empty file
        write_file(copy, content or bytes(_USUAL_PAGE))
        write_file(copy.with_name("journal-wal"), data if found is None else found[0])
        if found is None:
            skipped.append(f"is empty; all is from {log.name}")
        else:
            at = found[1]
            skipped.append(f"{log.name} is damaged at byte {at}: what stands there may be wrong")
        yield copy
