"""A folder in which other software leaves its exports: which files have landed, and are complete.

Looking is enough: no library is needed for one folder once a second, and what watches by the
system's events misses network drives, where such folders often are.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

from skinlab.exchange.importing.reader import MOST_BYTES
from skinlab.io.files import named_in_errors

SUFFIXES = frozenset({".csv", ".txt", ".tsv", ".dat", ".asc", ".crd", ".xlsx"})

_Signature = tuple[int, int, int]  # inode, size, time of the last change in ns


@dataclass(frozen=True)
class Arrival:
    """A complete file."""

    path: Path
    data: bytes
    continues: bool  # a file of this name was taken before, and this one goes on where it ended
    lay_there: bool = False  # as it is now since before the first look: nobody saw it land


@dataclass
class _Seen:
    signature: _Signature
    since_s: float


@dataclass(frozen=True)
class _Taken:
    sha256: str
    size: int


class Folder:
    """Tells files that have landed. A file is complete once it stayed as it is for `settle_s`.

    A file is taken once, whatever it is called later; one whose content changes is taken again.
    """

    def __init__(self, path: Path, settle_s: float = 1.0) -> None:
        self.path = path
        self._settle_s = settle_s
        self._seen: dict[str, _Seen] = {}
        self._done: set[_Signature] = set()
        self._taken: dict[str, _Taken] = {}
        self._first: frozenset[_Signature] | None = None  # what lay there at the first look

    def poll(self, now_s: float) -> list[Arrival]:
        """Return the files that are complete now and were not taken, the oldest first.

        Raises:
            InputError: the folder cannot be read.
        """
        present = self._look()
        if self._first is None:
            self._first = frozenset(present.values())
        for name in self._seen.keys() - present.keys():
            del self._seen[name]
        arrived = []
        for name, signature in sorted(present.items(), key=lambda item: (item[1][2], item[0])):
            seen = self._seen.get(name)
            if seen is None or seen.signature != signature:
                self._seen[name] = _Seen(signature, now_s)
            elif now_s - seen.since_s >= self._settle_s and signature not in self._done:
                arrival = self._take(name, signature)
                if arrival is not None:
                    arrived.append(arrival)
        return arrived

    def _look(self) -> dict[str, _Signature]:
        found: dict[str, _Signature] = {}
        with named_in_errors(self.path), os.scandir(self.path) as entries:
            for entry in entries:
                signature = _signature(Path(entry.path))
                if signature is not None and signature[1] > 0 and _wanted(entry.name):
                    found[entry.name] = signature
        return found

    def _take(self, name: str, signature: _Signature) -> Arrival | None:
        path = self.path / name
        try:
            with path.open("rb") as file:
                data = file.read(MOST_BYTES + 1)  # whoever imports it refuses what is larger
        except OSError:
            return None  # still held by its writer; the next look tries again
        if _signature(path) != signature:
            return None
        self._done.add(signature)
        before, now = self._taken.get(name), _Taken(_sha256(data), len(data))
        if before is not None and before.sha256 == now.sha256:
            return None  # touched, and the same
        self._taken[name] = now
        continues = before is not None and before.sha256 == _sha256(data[: before.size])
        return Arrival(path, data, continues, signature in (self._first or ()))


def _wanted(name: str) -> bool:
    return Path(name).suffix.lower() in SUFFIXES and not name.startswith((".", "~"))


def _signature(path: Path) -> _Signature | None:
    """Return what tells that a file changed; None where there is no plain file."""
    try:
        stat = path.stat()
    except OSError:
        return None
    return (stat.st_ino, stat.st_size, stat.st_mtime_ns) if path.is_file() else None


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
