"""What survives a crash: every byte both ways, every plan and result, as it happens.

An SQLite file in WAL mode: a process killed in the middle leaves all that was committed, and
nothing half-written. The session file is made from it at the end, or by `skinlab recover`.
"""

from __future__ import annotations

import json
import queue
import sqlite3
import threading
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

from skinlab.errors import InputError

SCHEMA = "skinlab.journal/1"
_COMMIT_S = 0.05  # how long a record may wait for its commit


class Kind(IntEnum):
    """What a record holds."""

    RECEIVED = 0  # bytes from the instrument
    SENT = 1  # bytes to it
    PLAN = 2  # JSON of a Setup: what the next run belongs to
    RESULT = 3  # JSON of an identification, with the number of its curve


@dataclass(frozen=True, slots=True)
class Record:
    """One record, in the order in which it happened."""

    kind: Kind
    host_time_s: float  # the host's monotonic clock
    data: bytes


class Journal:
    """Writes records from any thread; a thread of its own commits them.

    Raises:
        InputError: the file exists or cannot be created.
    """

    def __init__(self, path: Path, meta: dict[str, Any]) -> None:
        self.path = path
        if path.exists():
            raise InputError(f"{path}: exists already; `skinlab recover` makes a session of it")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch(mode=0o600)  # about a person: for its owner only
            self._db = sqlite3.connect(path, check_same_thread=False)
            self._db.execute("PRAGMA journal_mode=WAL")
            self._db.execute("PRAGMA synchronous=NORMAL")
            self._db.execute("CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL)")
            self._db.execute(
                "CREATE TABLE record (number INTEGER PRIMARY KEY, kind INTEGER NOT NULL, "
                "host_time_s REAL NOT NULL, data BLOB NOT NULL)"
            )
            self._db.commit()
        except (OSError, sqlite3.Error) as error:
            raise InputError(f"{path}: cannot be written ({error})") from None
        self._records: queue.SimpleQueue[Record | None] = queue.SimpleQueue()
        self._error: Exception | None = None
        self.set_meta(schema=SCHEMA, **meta)
        self._thread = threading.Thread(target=self._write, name="journal", daemon=True)
        self._thread.start()

    def set_meta(self, **meta: Any) -> None:
        """Store facts about the session, as JSON; call before records come."""
        rows = [(key, json.dumps(value)) for key, value in meta.items()]
        self._db.executemany("INSERT OR REPLACE INTO meta VALUES (?, ?)", rows)
        self._db.commit()

    def raw(self, direction: str, host_time_s: float, data: bytes) -> None:
        """Record raw bytes ("rx" or "tx"); the tap that a Probe takes as `on_bytes`.

        Raises:
            InputError: an earlier record could not be written (disk full): the probe vents.
        """
        self._put(Kind.RECEIVED if direction == "rx" else Kind.SENT, host_time_s, data)

    def plan(self, host_time_s: float, setup: dict[str, Any]) -> None:
        """Record what the next run belongs to."""
        self._put(Kind.PLAN, host_time_s, json.dumps(setup).encode())

    def result(self, host_time_s: float, curve: int, result: dict[str, Any]) -> None:
        """Record the identification of curve number `curve`."""
        data = json.dumps({"curve": curve, "result": result}).encode()
        self._put(Kind.RESULT, host_time_s, data)

    def _put(self, kind: Kind, host_time_s: float, data: bytes) -> None:
        if self._error is not None:
            raise InputError(f"{self.path}: cannot be written ({self._error})")
        self._records.put(Record(kind, host_time_s, data))

    def _write(self) -> None:
        ended = False
        while not ended:
            batch = [self._records.get()]
            deadline_passed = False
            while not deadline_passed and batch[-1] is not None:
                try:
                    batch.append(self._records.get(timeout=_COMMIT_S))
                    deadline_passed = len(batch) >= 16
                except queue.Empty:
                    deadline_passed = True
            ended = batch[-1] is None
            rows = [(int(r.kind), r.host_time_s, r.data) for r in batch if r is not None]
            try:
                self._db.executemany(
                    "INSERT INTO record (kind, host_time_s, data) VALUES (?, ?, ?)", rows
                )
                self._db.commit()
            except sqlite3.Error as error:
                self._error = error
                return

    def close(self) -> None:
        """Commit everything.

        Raises:
            InputError: something could not be written.
        """
        self._records.put(None)
        self._thread.join()
        if self._error is not None:
            raise InputError(f"{self.path}: cannot be written ({self._error})")
        self._db.close()

    def remove(self) -> None:
        """Delete the closed journal: its session is on disk."""
        for suffix in ("", "-wal", "-shm"):
            self.path.with_name(self.path.name + suffix).unlink(missing_ok=True)


def read_journal(path: Path) -> tuple[dict[str, Any], list[Record]]:
    """Return the facts and records of a journal, one that a crash left included.

    Raises:
        InputError: no such file, or no journal.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        db = sqlite3.connect(path)
        meta = {key: json.loads(value) for key, value in db.execute("SELECT key, value FROM meta")}
        records = [
            Record(Kind(kind), host_time_s, bytes(data))
            for kind, host_time_s, data in db.execute(
                "SELECT kind, host_time_s, data FROM record ORDER BY number"
            )
        ]
        db.close()
    except (sqlite3.Error, ValueError) as error:
        raise InputError(f"{path}: not a journal that skinlab wrote ({error})") from None
    if meta.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema {meta.get('schema')!r}; expected {SCHEMA!r}")
    return meta, records
