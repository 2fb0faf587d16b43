"""The rows of a build that goes on, kept beside its output: a kill costs no more than the last.

A line of JSON (schema, a hash of what is computed, numbers a row), then a record a row: its entry
(int64), its numbers (float64, little endian) and a digest of both. Records are appended; one that a
kill cut off is dropped when the file is opened again.
"""

from __future__ import annotations

import hashlib
import json
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from skinlab.errors import InputError
from skinlab.io.files import cannot_write, private

Array = NDArray[np.float64]

SCHEMA = "skinlab.database.rows/1"
_DIGEST = 16


class KeptRows:
    """A file of rows; a context manager. It stays after the build, also where that fails."""

    def __init__(self, path: Path, what: str, width: int, *, resume: bool) -> None:
        """Open or begin the file.

        Raises:
            InputError: it is there and not to be resumed, is of something else, or cannot be
                written.
        """
        head = {
            "schema": SCHEMA,
            "of": "sha256:" + hashlib.sha256(what.encode()).hexdigest(),
            "width": width,
        }
        self._head = json.dumps(head).encode() + b"\n"
        self._path = path
        self._size = 8 + 8 * width + _DIGEST
        try:
            there = path.exists() and path.stat().st_size >= len(self._head) + self._size
            if there and not resume:
                raise InputError(
                    f"{path}: rows of a build that did not end; --resume goes on with them, or "
                    "remove the file"
                )
            # Not buffered: the system has each row, and a kill of this process takes nothing
            self._file: BinaryIO = open(  # noqa: SIM115 -- until the build ends
                path, "r+b" if there else "w+b", buffering=0, opener=private
            )
        except OSError as error:
            raise InputError(f"{path}: {error.strerror or error}") from None
        if not there:
            try:
                self._file.write(self._head)
            except OSError as error:
                self._file.close()
                raise InputError(f"{path}: cannot be written ({error.strerror})") from None
            return
        if self._file.readline() != self._head:
            self._file.close()
            raise InputError(
                f"{path}: rows of another build; expected those of this spec, solver "
                "and state of the plugins to resume"
            )

    def found(self) -> Iterator[tuple[int, Array]]:
        """Yield the entries and rows (width,) that are there; leave the file at their end."""
        end = len(self._head)
        self._file.seek(end)
        while len(record := self._file.read(self._size)) == self._size:
            body, digest = record[:-_DIGEST], record[-_DIGEST:]
            if _digest(body) != digest:
                break
            end += self._size
            (entry,) = struct.unpack_from("<q", body)
            yield entry, np.frombuffer(body, dtype="<f8", offset=8).astype(float)
        self._file.truncate(end)
        self._file.seek(end)

    def add(self, entry: int, row: Array) -> None:
        """Append a row (width,).

        Raises:
            InputError: it cannot be written.
        """
        body = struct.pack("<q", entry) + np.asarray(row, dtype="<f8").tobytes()
        with cannot_write(self._path):
            self._file.write(body + _digest(body))

    def __enter__(self) -> KeptRows:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.fsync(self._file.fileno())
        empty = self._file.tell() <= len(self._head)
        self._file.close()
        if empty:
            self._path.unlink(missing_ok=True)


def _digest(body: bytes) -> bytes:
    return hashlib.blake2b(body, digest_size=_DIGEST).digest()
