"""The visits in a folder of sessions, kept in an index so that opening the list is quick.

The index is a cache: it may be deleted at any time, and is made again from the sessions.
"""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from skinlab.errors import SkinlabError
from skinlab.io.sqlite import check_only_tables
from skinlab.recording.session import earlier, measured_utc, read_session
from skinlab.recording.session_names import sessions_in

NAME = ".visits.sqlite"  # in the folder of the sessions
_SCHEMA = 2
_COLUMNS = (
    "file", "mtime_ns", "size", "measured_utc", "created_utc", "subject", "site", "simulated",
    "curves", "alike", "parameters", "problem",
)  # fmt: skip
# What an index that is only a cache may raise where somebody or something changed it
_DAMAGED = (sqlite3.Error, ValueError, TypeError, OverflowError, RecursionError)


@dataclass(frozen=True)
class VisitRow:
    """One session: whose, when, and what its whole first loadings gave (median of the curves)."""

    file: str
    measured_utc: str  # "": it was imported, and nobody said
    created_utc: str
    subject: str
    site: str
    simulated: bool
    curves: int
    alike: tuple[str, ...]  # openings and programs, so that only the same is compared
    parameters: dict[str, tuple[float, float, float]]  # value, low, high
    problem: str = ""  # why it cannot be read


def visits(
    folder: Path, tell: Callable[[int, int], None] = lambda done, of: None, *, keep: bool = True
) -> list[VisitRow]:
    """Return the visits of a folder, the latest first; `tell` hears how far new files are read.

    Only files that are new or changed are opened. Without a place to write, or where it is not to
    be kept and is not there yet, no index is made.
    """
    paths = sessions_in(folder)
    # An index that is damaged, or of another kind, is made anew: it is only a cache
    ways = (_open, _anew) if keep or (folder / NAME).exists() else ()
    for opened in ways:
        with suppress(*_DAMAGED), closing(opened(folder / NAME)) as database:
            return _listed(database, paths, tell)
    with closing(_prepared(sqlite3.connect(":memory:"))) as database:
        return _listed(database, paths, tell)


def _listed(
    database: sqlite3.Connection, paths: list[Path], tell: Callable[[int, int], None]
) -> list[VisitRow]:
    known = {
        str(row[0]): row for row in database.execute(f"SELECT {', '.join(_COLUMNS)} FROM visits")
    }
    stats = dict[Path, os.stat_result]()
    for path in paths:
        with suppress(OSError):  # gone meanwhile, or a link to nowhere
            stats[path] = path.stat()
    gone = set(known) - {path.name for path in stats}
    database.executemany("DELETE FROM visits WHERE file = ?", [(name,) for name in gone])
    found = []
    for number, (path, stat) in enumerate(stats.items()):
        row = known.get(path.name)
        if row is None or (row[1], row[2]) != (stat.st_mtime_ns, stat.st_size):
            tell(number, len(stats))
            row = (path.name, stat.st_mtime_ns, stat.st_size, *_read(path))
            marks = ", ".join("?" * len(_COLUMNS))
            database.execute(f"REPLACE INTO visits VALUES ({marks})", row)
        found.append(_row(row))
    database.commit()
    return sorted(found, key=lambda v: (v.measured_utc, v.file), reverse=True)


def visit_before(
    folder: Path,
    whose: tuple[str, str] | None,
    session: Path | None,
    *,
    simulated: bool,
    keep: bool = True,
) -> Path | None:
    """Return the last other session of this subject and site; None: there is none.

    `session` is the present one, which may be in the folder already. What nobody says the day of
    is before nothing, and nothing is before it.
    """
    if whose is None or not whose[0]:
        return None  # nobody knows whose it is
    present = None if session is None else session.name
    rows = visits(folder, keep=keep)
    now = next((row.measured_utc for row in rows if row.file == present), None)
    same = (
        row
        for row in rows
        if (row.subject, row.site) == whose
        and row.simulated == simulated
        and row.file != present
        and row.parameters
        and row.measured_utc
        and (now is None or earlier(row.measured_utc, now))
    )
    found = next(same, None)
    return None if found is None else folder / found.file


def _anew(path: Path) -> sqlite3.Connection:
    """Open an empty index in the place of one that is damaged or of another kind."""
    with suppress(OSError):
        path.unlink()
    return _open(path)


def _open(path: Path) -> sqlite3.Connection:
    with suppress(OSError):  # for its owner only, as the sessions are
        os.close(os.open(path, os.O_CREAT | os.O_RDWR, 0o600))
    connection = sqlite3.connect(path)
    try:
        return _prepared(connection)
    except sqlite3.Error:
        connection.close()
        raise


def _prepared(connection: sqlite3.Connection) -> sqlite3.Connection:
    check_only_tables(connection)
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if version != _SCHEMA:
        connection.execute("DROP TABLE IF EXISTS visits")
        connection.execute(f"PRAGMA user_version = {_SCHEMA}")
    columns = ", ".join(("file PRIMARY KEY", *_COLUMNS[1:]))
    connection.execute(f"CREATE TABLE IF NOT EXISTS visits ({columns})")
    connection.execute("SELECT file FROM visits LIMIT 1").fetchall()
    return connection


def _read(path: Path) -> tuple[Any, ...]:
    try:
        session = read_session(path)
    except SkinlabError as error:
        return ("", "", "", "", 0, 0, "[]", "{}", str(error))
    meta = session.meta
    instrument = meta.get("instrument")
    simulated = isinstance(instrument, dict) and bool(instrument.get("simulated"))
    kept = [
        (curve, result["parameters"])
        for curve, result in zip(session.curves, session.results, strict=True)
        if result and result.get("parameters") and not curve.partial and curve.setup.cycle == 1
    ]
    alike = sorted({f"{c.setup.aperture_mm:g} mm {c.setup.program or ''}".strip() for c, _ in kept})
    names = [n for n in (kept[0][1] if kept else {}) if all(n in values for _, values in kept)]
    parameters = {}
    for name in names:
        ends = [
            [values[name].get(which) for _, values in kept] for which in ("value", "low", "high")
        ]
        if all(isinstance(x, int | float) for of in ends for x in of):
            parameters[name] = [float(np.median(of)) for of in ends]
    return (
        measured_utc(meta),
        str(meta.get("created_utc") or ""),
        str(meta.get("subject") or ""),
        str(meta.get("site") or ""),
        int(simulated),
        len(session.curves),
        json.dumps(alike),
        json.dumps(parameters),
        "",
    )


def _row(row: tuple[Any, ...]) -> VisitRow:
    file, _, _, measured, created, *whose, simulated, curves, alike, parameters, problem = row
    values = msgspec.json.decode(parameters, type=dict[str, tuple[float, float, float]])
    subject, site = map(str, whose)
    same = msgspec.json.decode(alike, type=tuple[str, ...])
    return VisitRow(
        str(file), str(measured), str(created), subject, site, bool(simulated), int(curves),
        same, values, str(problem),
    )  # fmt: skip
