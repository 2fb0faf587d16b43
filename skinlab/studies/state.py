"""What a study has computed so far: an SQLite file that a killed process leaves whole.

`study.sqlite` in the study's folder: `source`, one row a file with a hash of all that its rows
depend on; `curve`, one row a curve; `person`, what is known of the people. A file whose hash is as
it was is not computed again.
"""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import msgspec

from drivers.reading import require_file
from skinlab.errors import InputError
from skinlab.io.documents import read_json
from skinlab.io.files import cannot_write, make_folder
from skinlab.io.sqlite import check_only_tables
from skinlab.studies.compute import Computed, Task
from skinlab.studies.facts import LABELS, pseudonym
from skinlab.studies.sources import STATE
from skinlab.text import inert

Kind = TypeVar("Kind")

SCHEMA = "skinlab.study.state/1"

_TABLES = """
CREATE TABLE IF NOT EXISTS meta (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS source (
  number INTEGER PRIMARY KEY, name TEXT UNIQUE NOT NULL, path TEXT NOT NULL, facts TEXT NOT NULL,
  scan INTEGER NOT NULL, wanted TEXT NOT NULL, done TEXT NOT NULL DEFAULT '',
  sha256 TEXT NOT NULL DEFAULT '', error TEXT);
CREATE INDEX IF NOT EXISTS source_done ON source (done);
CREATE TABLE IF NOT EXISTS curve (
  source INTEGER NOT NULL, number INTEGER NOT NULL, text TEXT NOT NULL, draws BLOB NOT NULL,
  PRIMARY KEY (source, number)) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS campaign (
  name TEXT PRIMARY KEY, wanted TEXT NOT NULL, text TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS person (subject TEXT PRIMARY KEY, facts TEXT NOT NULL);
"""


class _Said(msgspec.Struct):
    """What is kept of a curve, as JSON; looked at before it is used."""

    curve: str
    partial: bool
    setup: dict[str, Any]
    known: dict[str, Any]
    result: dict[str, Any]
    step: dict[str, float]
    readings: str = ""  # a hash of them; older studies have none


class _Made(msgspec.Struct):
    """What is kept of the study's own files."""

    key: str
    hashes: dict[str, str]
    document: dict[str, Any]
    lines: list[str]
    notices: list[str]


@dataclass(frozen=True)
class Stored:
    """One curve as it is stored, with its file."""

    source: str  # the file's name in the study
    sha256: str
    facts: dict[str, Any]
    number: int  # of the curve in its file, from 1
    said: dict[str, Any]
    draws: bytes


@dataclass(frozen=True)
class Readable:
    """A file that could be read, with what is known of whose curves it holds."""

    name: str
    path: Path
    sha256: str
    facts: dict[str, Any]
    labels: dict[str, str]


class State:
    """The file; a context manager. One study at a time writes to it.

    Raises:
        InputError: the folder holds something else, cannot be written, or another process has it.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / STATE
        with cannot_write(folder):
            foreign = folder.is_dir() and not self.path.exists() and any(folder.iterdir())
            another = folder.exists() and not folder.is_dir()
        if another:
            raise InputError(f"{folder}: expected a folder for the study")
        if foreign:
            raise InputError(f"{folder}: not empty, and no study; expected a new folder")
        with ExitStack() as undo:
            try:
                make_folder(folder)
                require_file(self.path)
                # About people: for its owner only, as SQLite makes its side files too.
                os.close(os.open(self.path, os.O_CREAT | os.O_RDWR, 0o600))
                self._db = sqlite3.connect(self.path, timeout=0.2, isolation_level=None)
                undo.callback(self._db.close)
                self._db.execute("PRAGMA locking_mode=EXCLUSIVE")
                self._db.execute("PRAGMA journal_mode=WAL")
                self._db.execute("PRAGMA synchronous=NORMAL")
                check_only_tables(self._db)
                self._db.executescript(_TABLES)
            except sqlite3.OperationalError as error:
                if "locked" in str(error):
                    raise InputError(
                        f"{folder}: another process has its study.sqlite open; one at a time"
                    ) from None
                raise InputError(f"{self.path}: cannot be written ({error})") from None
            except sqlite3.DatabaseError as error:
                raise self._damaged(error) from None
            except OSError as error:
                raise InputError(
                    f"{folder}: cannot be written ({error.strerror or error})"
                ) from None
            try:
                schema = self._meta("schema")
                if schema not in (None, SCHEMA):
                    raise InputError(f"{self.path}: {schema}; expected {SCHEMA}")
                self._set("schema", SCHEMA)
            except sqlite3.DatabaseError as error:
                raise self._damaged(error) from None
            undo.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._db.close()
        if isinstance(error, sqlite3.DatabaseError):  # pages that nobody had to look at before
            raise self._damaged(error) from None

    def _damaged(self, why: object) -> InputError:
        if getattr(why, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL:
            return InputError(f"{self.path}: cannot be written ({why}); make room, run it again")
        return InputError(f"{self.path}: damaged ({why}); remove it to begin anew")

    def _as(self, kind: type[Kind], said: Any) -> Kind:
        """Return what the file says, which must be of this kind; a row comes as a list."""
        try:
            return msgspec.convert(said, kind)
        except msgspec.ValidationError as error:
            raise self._damaged(error) from None

    def _object(self, text: Any) -> dict[str, Any]:
        try:
            return self._as(dict[str, Any], read_json(self._as(str, text)))
        except ValueError as error:  # InputError is one
            raise error if isinstance(error, InputError) else self._damaged(error) from None

    @property
    def settings(self) -> str | None:
        """How the curves were identified, as JSON; None for a new study."""
        return self._meta("settings")

    @property
    def made(self) -> dict[str, Any] | None:
        """What the study's files were made from, their hashes, what they say; None without any."""
        text = self._meta("made")
        return None if text is None else msgspec.to_builtins(self._as(_Made, self._object(text)))

    @made.setter
    def made(self, said: dict[str, Any]) -> None:
        self._set("made", json.dumps(said))

    def begin(self, settings: str) -> int:
        """Begin a look at the folders; return its number."""
        before = self._meta("scan") or "0"
        scan = (
            int(before) if before.isascii() and before.isdigit() and len(before) < 16 else 0
        ) + 1
        self._db.execute("BEGIN")
        self._set("scan", str(scan))
        self._set("settings", settings)
        self._db.execute("DELETE FROM person")
        return scan

    def found(
        self,
        scan: int,
        name: str,
        path: Path,
        facts: dict[str, Any],
        wanted: str,
        error: str | None,
    ) -> None:
        """Note that a file is there, and the hash of all that its rows depend on."""
        self._db.execute(
            "INSERT INTO source (name, path, facts, scan, wanted, error) VALUES (?, ?, ?, ?, ?, ?) "
            "ON CONFLICT (name) DO UPDATE SET path = excluded.path, facts = excluded.facts, "
            "scan = excluded.scan, wanted = excluded.wanted, "
            "error = CASE WHEN excluded.error IS NULL AND excluded.wanted = done THEN error "
            "ELSE excluded.error END",
            (inert(name), _kept(path), json.dumps(facts), scan, wanted, error and inert(error)),
        )

    def person(self, subject: str, facts: dict[str, Any]) -> None:
        """Note what is known of one of the people."""
        before = self._db.execute("SELECT facts FROM person WHERE subject = ?", (subject,))
        row = before.fetchone()
        merged = {**(self._object(row[0]) if row else {}), **facts}
        self._db.execute(
            "INSERT OR REPLACE INTO person (subject, facts) VALUES (?, ?)",
            (subject, json.dumps(merged)),
        )

    def end(self, scan: int) -> None:
        """End the look: what is no longer there is dropped, what only moved keeps its rows."""
        self._db.execute(
            "CREATE TEMP TABLE moved AS SELECT n.number AS new, MIN(o.number) AS old, "
            "o.sha256, o.error FROM source n JOIN source o ON o.done = n.wanted "
            "WHERE n.scan = ? AND n.done != n.wanted AND n.wanted != '' AND o.number != n.number "
            "AND o.error IS NULL "
            "GROUP BY n.number",
            (scan,),
        )
        self._db.execute("DELETE FROM curve WHERE source IN (SELECT new FROM moved)")
        self._db.execute(
            "INSERT INTO curve SELECT moved.new, curve.number, text, draws FROM moved "
            "JOIN curve ON curve.source = moved.old"
        )
        self._db.execute(
            "UPDATE source SET done = wanted, (sha256, error) = "
            "(SELECT sha256, error FROM moved WHERE new = source.number) "
            "WHERE number IN (SELECT new FROM moved)"
        )
        self._db.execute("DROP TABLE moved")
        self._db.execute(
            "DELETE FROM curve WHERE source IN (SELECT number FROM source WHERE scan != ?)", (scan,)
        )
        self._db.execute("DELETE FROM source WHERE scan != ?", (scan,))
        self._db.execute("COMMIT")

    def counts(self) -> tuple[int, int]:
        """Return how many files can be computed, and how many of them are."""
        row = self._db.execute(
            "SELECT COUNT(*), COALESCE(SUM(done = wanted), 0) FROM source WHERE wanted != ''"
        ).fetchone()
        return int(row[0]), int(row[1])

    def pending(self, size: int) -> Iterator[list[Task]]:
        """Yield batches of files to compute, in the order of their names."""
        last = ""
        while True:
            rows = self._db.execute(
                "SELECT number, path, facts, name FROM source "
                "WHERE wanted != '' AND done != wanted AND name > ? ORDER BY name LIMIT ?",
                (last, size),
            ).fetchall()
            if not rows:
                return
            last = rows[-1][3]
            yield [Task(r[0], self._path(r[1]), self._object(r[2])) for r in rows]

    def add(self, computed: Sequence[Computed], wanted: dict[int, str]) -> None:
        """Keep what was computed, all of it or nothing; `wanted` by file says of which state."""
        self._db.execute("BEGIN")
        for one in computed:
            self._db.execute("DELETE FROM curve WHERE source = ?", (one.number,))
            self._db.executemany(
                "INSERT INTO curve VALUES (?, ?, ?, ?)",
                [(one.number, k, row.text, row.draws) for k, row in enumerate(one.rows, start=1)],
            )
            self._db.execute(
                "UPDATE source SET done = ?, sha256 = ?, error = ? WHERE number = ?",
                (
                    "" if one.again else wanted[one.number],
                    one.sha256,
                    one.error and inert(one.error),
                    one.number,
                ),
            )
        self._db.execute("COMMIT")

    def wanted(self, numbers: Iterable[int]) -> dict[int, str]:
        """Return the hash that each of these files should have."""
        return {
            n: str(
                self._db.execute("SELECT wanted FROM source WHERE number = ?", (n,)).fetchone()[0]
            )
            for n in numbers
        }

    def people(self) -> dict[str, dict[str, Any]]:
        """Return what is known of the people, by subject."""
        rows = self._db.execute("SELECT subject, facts FROM person")
        return {self._as(str, subject): self._object(facts) for subject, facts in rows}

    def failures(self) -> Iterator[tuple[str, str]]:
        """Yield the files that could not be read, each with its reason.

        Reasons call a file as the study does: where its folder lies on this machine is nobody's
        business who reads them.
        """
        for row in self._db.execute(
            "SELECT name, path, error FROM source WHERE error IS NOT NULL ORDER BY name"
        ):
            name, path, error = self._as(tuple[str, str, str], row)
            yield name, error.replace(path, name)

    def curves(self) -> Iterator[Stored]:
        """Yield every curve, in the order of the files' names."""
        rows = self._db.execute(
            "SELECT s.name, s.sha256, s.facts, c.number, c.text, c.draws FROM source s "
            "JOIN curve c ON c.source = s.number WHERE s.error IS NULL AND s.done = s.wanted "
            "ORDER BY s.name, c.number"
        )
        for row in rows:
            name, sha, facts, number, text, draws = self._as(
                tuple[str, str, str, int, str, bytes], row
            )
            said = self._as(_Said, self._object(text))
            if len(draws) % (4 * max(1, len(said.result.get("order") or ()))):
                raise self._damaged("draws that are no whole rows")
            yield Stored(name, sha, self._object(facts), number, msgspec.to_builtins(said), draws)

    def readable(self) -> Iterator[Readable]:
        """Yield the files that could be read, in the order of their names."""
        rows = self._db.execute(
            "SELECT s.name, s.path, s.sha256, s.facts, c.text FROM source s JOIN curve c "
            "ON c.source = s.number AND c.number = 1 WHERE s.error IS NULL AND s.done = s.wanted "
            "ORDER BY s.name"
        )
        for name, path, sha, text, curve in rows:
            facts = self._object(text)
            known = {**self._as(_Said, self._object(curve)).known, **facts}
            labels = {n: str(known[n]) for n in LABELS if known.get(n)}
            if "subject" in labels:
                labels["subject"] = pseudonym(labels["subject"])
            yield Readable(name, self._path(path), sha, facts, labels)

    def explained(self) -> dict[str, tuple[str, str]]:
        """Return what is said of campaigns: by name the hash it depends on, and the text."""
        rows = self._db.execute("SELECT name, wanted, text FROM campaign")
        return {
            name: (wanted, text)
            for name, wanted, text in (self._as(tuple[str, str, str], r) for r in rows)
        }

    def add_explained(self, name: str, wanted: str, text: str) -> None:
        """Keep what is said of a campaign."""
        self._db.execute("INSERT OR REPLACE INTO campaign VALUES (?, ?, ?)", (name, wanted, text))

    def _meta(self, name: str) -> str | None:
        row = self._db.execute("SELECT value FROM meta WHERE name = ?", (name,)).fetchone()
        return None if row is None else str(row[0])

    def _path(self, kept: Any) -> Path:
        return Path(os.fsdecode(self._as(str, kept) if not isinstance(kept, bytes) else kept))

    def _set(self, name: str, value: str) -> None:
        self._db.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (name, value))


def _kept(path: Path) -> str | bytes:
    """Return a path as SQLite takes it: its text, which has to be UTF-8, or else its bytes."""
    text = str(path)
    return text if text == text.encode(errors="replace").decode() else os.fsencode(path)
