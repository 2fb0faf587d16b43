"""What survives a crash: every byte both ways, every plan, result and deed, as it happens.

An SQLite file in WAL mode: a process killed in the middle leaves all that was committed, and
nothing half-written. The session file is made from it at the end, or by `skinlab recover`.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import shutil
import sqlite3
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.reading import require_file
from skinlab.errors import InputError
from skinlab.io.documents import read_json
from skinlab.io.files import cannot_read, make_folder, private
from skinlab.io.sqlite import check_only_tables
from skinlab.recording import audit
from skinlab.recording.records import MOST_RECORD_BYTES, Kind, Record, checked_record, in_place
from skinlab.recording.wal import readable

if sys.platform != "win32":
    import fcntl

__all__ = ["Journal", "Kind", "Record", "read_journal"]

SCHEMA = "skinlab.journal/1"
_COMMIT_S = 0.03  # how long a record may wait for its commit: a killed process loses no more
_SYNC_S = 1.0  # how long a commit may wait for the disk itself: a power cut loses no more
_WAL_PAGES = 4000  # 16 MB between checkpoints, which hold up the commits
_INSERT = "INSERT INTO record (kind, host_time_s, utc_s, data) VALUES (?, ?, ?, ?)"

# Disk space of a run, by measurement (tests/unit/recording/test_journal.py) and rounded up: a
# commit is a page or two of the WAL, and a sample stands in journal and session.
_ROOM_BYTES = 8_000_000
_COMMIT_BYTES = 9_000
_SAMPLE_BYTES = 400

# Of a journal that may be damaged.
_MOST_FACTS = 100
_LEAST_RECORD_BYTES = 20


_KINDS = {"rx": Kind.RECEIVED, "tx": Kind.SENT, "mark": Kind.MARK}


def room_bytes(duration_s: float, rate_hz: float) -> int:
    """Return the disk space that a run may need, until its session is written."""
    commits = min(duration_s / _COMMIT_S, duration_s * (rate_hz + 20.0))
    wal = min(commits * _COMMIT_BYTES, _WAL_PAGES * 4096 * 2)
    return int(_ROOM_BYTES + wal + duration_s * rate_hz * _SAMPLE_BYTES)


class Journal:
    """Writes records from any thread; a thread of its own commits them.

    `now` is Unix time in s.

    Raises:
        InputError: the file exists or cannot be created.
    """

    def __init__(
        self, path: Path, meta: dict[str, Any], now: Callable[[], float] = time.time
    ) -> None:
        self.path = path
        self._now = now
        if os.path.exists(path):
            raise _exists(path)
        try:
            make_folder(path.parent)
            # SQLite makes its side files for the owner only too.
            os.close(private(str(path), os.O_CREAT | os.O_EXCL | os.O_RDWR))
        except FileExistsError:
            raise (_exists(path) if path.exists() else _no_folder(path)) from None
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
        try:
            self._db = _create(path, {"schema": SCHEMA, **meta})
            self._wal = os.open(_side_file(path, "-wal"), os.O_RDWR)
            _claim(self._wal)
        except (OSError, sqlite3.Error) as error:
            _remove(path)
            raise InputError(f"{path}: cannot be written ({error})") from None
        self._records: queue.SimpleQueue[Record | Future[None] | None] = queue.SimpleQueue()
        self._unwritten: list[Record] = []  # of commits that failed
        self._chain = audit.Chain()
        self._error: sqlite3.Error | None = None  # of the last commit; the next one may do better
        self._lost: OSError | None = None  # what the disk did with commits is not known any more
        self._closing = threading.Event()
        self._writer = threading.Thread(target=self._write, name="journal", daemon=True)
        self._syncer = threading.Thread(target=self._sync, name="journal sync", daemon=True)
        self._writer.start()
        self._syncer.start()

    @property
    def trouble(self) -> str | None:
        """Why nothing can be written at present, or None."""
        if self._lost is not None:
            return f"{self.path}: cannot be written ({self._lost})"
        if self._error is not None:
            return (
                f"{self.path}: cannot be written ({self._error}); make room: the next record tries "
                "again"
            )
        return None

    # ---- from any thread ------------------------------------------------------------------------

    def require_room(self, duration_s: float, rate_hz: float) -> None:
        """Refuse a run that the disk has no room for, before it begins.

        Raises:
            InputError: too little space is free, or an earlier record still cannot be written.
        """
        self.try_again()
        free, need = shutil.disk_usage(self.path.parent).free, room_bytes(duration_s, rate_hz)
        if free < need:
            raise InputError(
                f"{self.path.parent}: {free / 1e6:.1f} MB are free on this disk; expected at least "
                f"{need / 1e6:.1f} MB for {duration_s:g} s at {rate_hz:g} Hz"
            )

    def raw(
        self, direction: str, host_time_s: float, data: bytes, utc_s: float | None = None
    ) -> None:
        """Record raw bytes ("rx" or "tx") or a "mark"; the tap that a Probe takes as `on_bytes`.

        `utc_s` is for bytes that came before there was a journal; None: now.

        Raises:
            InputError: an earlier record could not be written (disk full): the probe vents. This
                one is kept, and written with it.
        """
        self.put(_KINDS[direction], host_time_s, data, utc_s, keep=True)

    def plan(self, host_time_s: float, setup: dict[str, Any]) -> None:
        """Record what the next run belongs to."""
        self.put(Kind.PLAN, host_time_s, json.dumps(setup).encode())

    def result(self, host_time_s: float, curve: int, result: dict[str, Any]) -> None:
        """Record the identification of curve number `curve`.

        Raises:
            InputError: as `raw`; it is kept.
        """
        data = json.dumps({"curve": curve, "result": result}).encode()
        self.put(Kind.RESULT, host_time_s, data, keep=True)

    def audit(self, host_time_s: float, who: str, what: str, **detail: Any) -> None:
        """Record who did what; the entry is bound to all that was recorded before it."""
        utc_s = self._now()
        entry = audit.note(host_time_s, utc_s, who, what, detail)
        self.put(entry.kind, host_time_s, entry.data, utc_s)

    def flush(self) -> None:
        """Return once all that was recorded so far is committed; what failed is tried again.

        Raises:
            InputError: it cannot be written.
        """
        done: Future[None] = Future()
        self._records.put(done)
        wait([done])
        if self.trouble is not None:
            raise InputError(self.trouble)

    def try_again(self) -> None:
        """Write what could not be written, where there is any.

        Raises:
            InputError: it still cannot.
        """
        if self.trouble is not None:
            self.flush()

    def put(
        self,
        kind: Kind,
        host_time_s: float,
        data: bytes,
        utc_s: float | None = None,
        *,
        keep: bool = False,
    ) -> None:
        """Write a record as it is; utc_s: None: now.

        Never waits for the disk: a probe may be about to vent. What failed is tried again for the
        next one.

        Raises:
            InputError: one before it could not be written; with `keep` this one waits with it.
        """
        trouble = self.trouble
        if trouble is None or keep:
            utc_s = self._now() if utc_s is None else utc_s
            self._records.put(Record(kind, host_time_s, utc_s, data))
        else:
            self._records.put(Future())  # to try again
        if trouble is not None:
            raise InputError(trouble)

    # ---- the threads ----------------------------------------------------------------------------

    def _write(self) -> None:
        ended = False
        while not ended:
            batch, waiting, ended = self._collect()
            self._unwritten += batch
            try:
                self._commit(self._unwritten + self._told())
            except sqlite3.Error as error:
                self._error = error
            else:
                self._error, self._unwritten = None, []
            for done in waiting:
                done.set_result(None)

    def _told(self) -> list[Record]:
        """Return the entry that says that writing failed before, if it did."""
        if self._error is None or not self._unwritten:
            return []
        at_s, detail = self._unwritten[-1].host_time_s, {"error": str(self._error)}
        what = "journal written again"
        return [audit.note(at_s, self._now(), audit.operator(), what, detail)]

    def _collect(self) -> tuple[list[Record], list[Future[None]], bool]:
        """Return what comes within the time of a commit, who waits for it, and whether all came."""
        batch: list[Record] = []
        waiting: list[Future[None]] = []
        record = self._records.get()
        if not self._closing.is_set():
            time.sleep(_COMMIT_S)  # one wake-up for all that comes meanwhile, not one for each
        while record is not None:
            if isinstance(record, Future):
                waiting.append(record)
            else:
                batch.append(record)
            try:
                record = self._records.get_nowait()
            except queue.Empty:
                return batch, waiting, False
        return batch, waiting, True

    def _commit(self, batch: list[Record]) -> None:
        chain = self._chain.copy()
        stored = [chain.add(record) for record in batch]
        rows = [(int(r.kind), r.host_time_s, r.utc_s, r.data) for r in stored]
        self._db.execute("BEGIN")
        try:
            self._db.executemany(_INSERT, rows)
            self._db.execute("COMMIT")
        except sqlite3.Error:
            with contextlib.suppress(sqlite3.Error):  # where SQLite has rolled back by itself
                self._db.execute("ROLLBACK")
            raise
        self._chain = chain

    def _sync(self) -> None:
        """Bring commits to the disk, apart from the writer: a slow disk must not hold it up."""
        try:
            while not self._closing.wait(_SYNC_S):
                os.fsync(self._wal)
        except OSError as error:
            self._lost = error
        finally:
            os.close(self._wal)

    # ---- the end --------------------------------------------------------------------------------

    def close(self) -> None:
        """Commit everything; what failed before is tried once more.

        Raises:
            InputError: something could not be written; the rest is in the file.
        """
        self._records.put(None)
        self._closing.set()
        self._writer.join()
        self._syncer.join()
        try:
            while not self._records.empty():
                record = self._records.get()
                self._unwritten += [record] if isinstance(record, Record) else []
            if self._unwritten:
                self._commit(self._unwritten + self._told())
            self._db.close()
        except sqlite3.Error as error:
            with contextlib.suppress(sqlite3.Error):
                self._db.close()
            raise InputError(
                f"{self.path}: cannot be written ({error}); all but the last moment is kept there: "
                f"make room, then `skinlab recover {self.path}`"
            ) from None

    def remove(self) -> None:
        """Delete the closed journal: its session is on disk."""
        _remove(self.path)


def _create(path: Path, meta: dict[str, Any]) -> sqlite3.Connection:
    """Make the tables and facts in one step: a journal is whole, or empty."""
    db = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
    try:
        db.execute("PRAGMA journal_mode=WAL")
        db.execute("PRAGMA synchronous=NORMAL")
        db.execute(f"PRAGMA wal_autocheckpoint={_WAL_PAGES}")
        db.execute("BEGIN")
        db.execute("CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL)")
        db.execute(
            "CREATE TABLE record (number INTEGER PRIMARY KEY, kind INTEGER NOT NULL, "
            "host_time_s REAL NOT NULL, utc_s REAL NOT NULL, data BLOB NOT NULL)"
        )
        rows = [(key, json.dumps(value)) for key, value in meta.items()]
        db.executemany("INSERT INTO meta VALUES (?, ?)", rows)
        db.execute("COMMIT")
    except sqlite3.Error:
        db.close()
        raise
    return db


def _side_file(path: Path, suffix: str) -> Path:
    return path.with_name(path.name + suffix)


def _remove(path: Path) -> None:
    for suffix in ("-wal", "-shm", ""):  # the file itself last: alone it is whole
        _side_file(path, suffix).unlink(missing_ok=True)


def _no_folder(path: Path) -> InputError:
    return InputError(f"{path}: cannot be written (its folder is a file)")


def is_live(path: Path) -> bool:
    """Return whether somebody records into this journal at this moment."""
    if sys.platform == "win32" or not path.name:
        return False
    try:
        number = os.open(_side_file(path, "-wal"), os.O_RDWR)
    except OSError:
        return False
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks
        return False
    finally:
        os.close(number)
    return False


def journal_of(session: Path) -> Path:
    """Return the journal that a session is recorded into."""
    return _side_file(session, ".journal")


def left_behind(session: Path) -> Path | None:
    """Return the journal of a session that a crash left, and that says more; None: none does.

    What was written to it before the session was last saved is in the session.
    """
    journal = journal_of(session)
    try:
        parts = [p for p in (journal, _side_file(journal, "-wal")) if p.is_file()]
        said = max((p.stat().st_mtime for p in parts), default=None)
        if said is None or (session.is_file() and session.stat().st_mtime >= said):
            return None
    except OSError:  # gone meanwhile, or not ours to read
        return None
    return None if is_live(journal) else journal


def all_left_behind(folder: Path) -> list[Path]:
    """Return the journals in a folder that crashes left, by name."""
    sessions = [journal.with_suffix("") for journal in sorted(folder.glob("*.journal"))]
    return [left for session in sessions if (left := left_behind(session)) is not None]


def _claim(number: int) -> None:
    """Mark the journal as live: the system takes the mark away when the process is gone."""
    if sys.platform != "win32":
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _exists(path: Path) -> InputError:
    if is_live(path):
        return InputError(
            f"{path}: exists already: another measurement is recording there now; expected another "
            "--out"
        )
    if path.stat().st_size == 0:
        return InputError(
            f"{path}: exists already, and is empty: another measurement is just beginning, or was "
            "killed before anything was recorded; then delete it"
        )
    return InputError(
        f"{path}: exists already, from a measurement that did not end; "
        f"`skinlab recover {path}` makes a session of it"
    )


@dataclass(frozen=True)
class Read:
    """What can be read of a journal; `skipped` says in a sentence each what cannot."""

    meta: dict[str, Any]
    records: list[Record]
    skipped: list[str]


def read_journal(path: Path, *, left: bool = False) -> Read:
    """Return the facts and records of a journal; `left` by a crash, so that nobody writes to it.

    Then a log that is damaged is read to its end, which takes too long while a probe is served. A
    damaged record costs itself; facts that are damaged are taken from the audit trail.

    Raises:
        InputError: no such file, or no journal.
    """
    with cannot_read(path):
        require_file(path)
    if not path.exists():
        raise InputError(f"{path}: no such file")
    skipped: list[str] = []
    behind = path.with_name(f"{path.name}-wal")  # where all is until sqlite moves it over
    alone = not behind.is_file()  # as it was found: SQLite makes one
    size_bytes = sum(part.stat().st_size for part in (path, behind) if part.is_file())
    try:
        whole = readable(path, skipped) if left else contextlib.nullcontext(path)
        with whole as file, contextlib.closing(sqlite3.connect(file)) as db:
            db.text_factory = bytes
            db.execute("PRAGMA writable_schema=ON")  # else a file that was cut off is not read
            check_only_tables(db)
            tables = {name for (name,) in db.execute("SELECT name FROM sqlite_master")}
            if not tables:
                raise InputError(f"{path}: is empty: {_why_empty(path, behind, alone=alone)}")
            if not tables >= {b"meta", b"record"}:
                raise InputError(f"{path}: not a journal that skinlab wrote (its tables)")
            meta = _meta(db, skipped)
            schema = meta.pop("schema", SCHEMA)
            if schema != SCHEMA:
                raise InputError(f"{path}: schema {schema!r}; expected {SCHEMA!r}")
            records = _records(db, size_bytes, skipped)
            skipped += _damage(db) if not skipped or file != path else []
    except InputError:
        raise
    except sqlite3.OperationalError as error:
        if "no such" in str(error):  # table or column
            raise InputError(f"{path}: not a journal that skinlab wrote ({error})") from None
        raise InputError(f"{path}: cannot be read ({error})") from None
    except (sqlite3.Error, ValueError, TypeError, OverflowError) as error:
        raise InputError(f"{path}: not a journal that skinlab wrote ({error})") from None
    return Read(with_opening_facts(meta, records), records, skipped)


def with_opening_facts(meta: dict[str, Any], records: Sequence[Record]) -> dict[str, Any]:
    """Return the facts with those that are damaged from the entry that opened the session."""
    first = next((r for r in records if r.kind is Kind.AUDIT), None)
    if first is None:
        return meta
    (opened,) = audit.entries([first])
    return opened.detail | meta if opened.what == "session opened" else meta


def _why_empty(path: Path, behind: Path, *, alone: bool) -> str:
    if alone and path.stat().st_size:
        return (
            f"what was recorded is in {behind.name}; expected it beside this file, unless the "
            "measurement was killed before anything was recorded"
        )
    return "the measurement was killed before anything was recorded"


def _meta(db: sqlite3.Connection, skipped: list[str]) -> dict[str, Any]:
    meta = {}
    query = f"SELECT rowid, {_unless_huge('key')}, {_unless_huge('value')} FROM meta WHERE rowid"
    rows, failed = _rows(db, query, 1, _MOST_FACTS)
    for number, key, value in rows:
        try:
            meta[_text(key)] = read_json(_text(value))
        except (ValueError, TypeError) as error:
            which = repr(key) if isinstance(key, bytes) else number
            skipped.append(f"fact {which} cannot be read ({error})")
    skipped += [f"fact {number} cannot be read ({why})" for number, _, why in failed]
    return meta


def _unless_huge(column: str) -> str:
    """Return the SQL for what is of a possible size, else minus its size: no memory is taken."""
    size = f"length({column})"
    return f"CASE WHEN {size} > {MOST_RECORD_BYTES} THEN -{size} ELSE {column} END"


def _text(value: object) -> str:
    if not isinstance(value, bytes):
        raise TypeError(in_place(value))
    return value.decode()


def _records(db: sqlite3.Connection, size_bytes: int, skipped: list[str]) -> list[Record]:
    most = size_bytes // _LEAST_RECORD_BYTES
    try:
        last = db.execute("SELECT max(number) FROM record").fetchone()[0] or 0
    except sqlite3.DatabaseError:
        last = most
    if not 0 < last <= most:  # of a page of which only a part is there
        last = most
    columns = ", ".join(map(_unless_huge, ("number", "kind", "host_time_s", "utc_s", "data")))
    query = f"SELECT {columns} FROM record WHERE number"
    rows, failed = _rows(db, query, 1, last)
    records: list[Record] = []
    for number, *row in rows:
        record, why = checked_record(row, records[-1] if records else None)
        if why:
            skipped.append(f"record {number}: {why}")
        if record is not None:
            records.append(record)
    for first, end, why in failed:
        which = f"record {first}" if first == end else f"records {first} to {end}"
        if end == most:  # nobody knows how many there were
            which = f"record {first} and what came behind it"
        skipped.append(f"{which} cannot be read ({why}): left out")
    return records


def _damage(db: sqlite3.Connection) -> list[str]:
    """Return what is wrong with a file of which all that was found could be read."""
    try:
        (said,) = db.execute("PRAGMA quick_check(1)").fetchone()
    except sqlite3.DatabaseError as error:
        said = str(error).encode()
    if said == b"ok":
        return []
    first = said.decode("utf-8", "replace").strip().splitlines()[-1]
    return [f"the file is damaged ({first}): records at its end may be missing"]


Row = tuple[Any, ...]
Hole = tuple[int, int, str]


def _rows(
    db: sqlite3.Connection, query: str, first: int, last: int
) -> tuple[list[Row], list[Hole]]:
    """Return the rows numbered first to last, and (first, last, why) where pages are damaged.

    A range that fails is halved until the rows that are to blame are alone.
    """
    rows: list[Row] = []
    holes: list[Hole] = []
    ranges = [(first, last)]
    while ranges:
        begin, end = ranges.pop()
        if begin > end:
            continue
        found: list[Row] = []
        try:
            for row in db.execute(f"{query} BETWEEN ? AND ?", (begin, end)):
                found.append(row)
        except (sqlite3.DatabaseError, OverflowError, MemoryError) as error:
            if begin == end:
                if holes and holes[-1][1] == begin - 1:
                    begin, _, _ = holes.pop()
                holes.append((begin, end, str(error)))
            else:
                middle = (begin + end) // 2
                ranges += [(middle + 1, end), (begin, middle)]
            continue
        rows += found
    return rows, holes
