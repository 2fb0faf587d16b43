"""A session whose bytes were damaged: what can still be read of it becomes another session.

The recorded bytes come first. Where all of them are there, and the audit trail agrees, curves and
results are made from them again, whatever happened to the rest of the file. Else the curves are
those that stand in the file beside the bytes; only the hash of the content tells whether one of
their numbers was changed.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from skinlab.curves.curve import Curve
from skinlab.errors import InputError
from skinlab.io.documents import read_json_object
from skinlab.io.files import cannot_read
from skinlab.io.hdf5 import DAMAGE, open_hdf5
from skinlab.recording.apart import answer, ask
from skinlab.recording.audit import Chain
from skinlab.recording.journal import with_opening_facts
from skinlab.recording.recorder import recovery
from skinlab.recording.records import Kind, Record, checked_record
from skinlab.recording.seal import Seal, is_sealed, read_seal
from skinlab.recording.session import (
    SCHEMA,
    Result,
    Session,
    content_hash,
    read_curve,
    read_result,
    read_session,
    read_stored,
    session_from_records,
    write_session,
)

_UNBOUND = "its curves are those that stand in the file: nothing tells whether a number was changed"
_NO_BYTES = b"", np.zeros(0, dtype=bool)
_RAW = ("kind", "host_time_s", "utc_s", "end")


def is_session(path: Path) -> bool:
    """Return whether a file is, or was, a session, and no journal.

    Raises:
        InputError: it cannot be read.
    """
    import h5py

    with cannot_read(path):
        return path.is_file() and (is_sealed(path) or bool(h5py.is_hdf5(path)))


def salvage(
    damaged: Path,
    session: Path,
    *,
    clock: Callable[[], float] = time.monotonic,
    now: Callable[[], float] = time.time,
    who: str | None = None,
) -> tuple[Session, list[str]]:
    """Write what a damaged session still holds to another; return it, and what is lost.

    The damaged file stays. What is lost is in the audit trail as well, a sentence each.

    Raises:
        InputError: it is whole, nothing in it can be read, or the other session exists already.
    """
    if session.exists():
        raise InputError(f"{session}: exists already; a session is never overwritten")
    with TemporaryDirectory() as folder:
        found = Path(folder) / "found.h5"
        lost = ask(__name__, damaged, str(found))
        read = read_session(found)
    deed = recovery(read.records, lost, clock(), now(), who, damaged=damaged.name)
    made = replace(read, records=(*read.records, deed))
    write_session(session, made)
    return made, lost


def _salvage(path: Path, out: Path) -> list[str]:
    seal = read_seal(path)
    if seal is Seal.HOLDS and read_stored(path).unchanged:
        raise InputError(f"{path}: is whole; there is nothing to recover")
    lost: list[str] = []
    with open_hdf5(path, damaged=True) as file:
        # What is sealed is a session, whatever became of this text
        if seal is Seal.NONE and file.attrs.get("schema", SCHEMA) != SCHEMA:
            raise InputError(f"schema {file.attrs['schema']!r}; expected a session, {SCHEMA!r}")
        write_session(out, _found(file, lost))
    return lost


def _found(file: Any, lost: list[str]) -> Session:
    broken: list[str] = []
    records = _records(file, broken)
    chain = Chain()
    complaints = [said for record in records if (said := chain.complaint(record)) is not None]
    broken += complaints[:1]  # those behind it say the same
    meta = _try("the facts", lost, lambda: read_json_object(file.attrs["meta"]), None)
    lost += broken
    facts = with_opening_facts({}, records) if meta is None else meta
    made = session_from_records(facts, records, lost.append)
    # An entry binds what is before it, and an imported session has no bytes that it was made from.
    bound = not broken and bool(records) and records[-1].kind is Kind.AUDIT
    if bound and any(record.kind is Kind.RECEIVED for record in records):
        return made
    curves = _curves(file, lost)
    if not records and not curves:
        raise InputError("neither its records nor its curves can be read")
    made = replace(made, curves=tuple(c for c, _ in curves), results=tuple(r for _, r in curves))
    stated = _try("the hash of its content", lost, lambda: file.attrs["content_hash"], None)
    if content_hash(made) != stated:
        lost.append(_UNBOUND)
    return made


def _try(what: str, lost: list[str], read: Callable[[], Any], otherwise: Any) -> Any:
    try:
        return read()
    except DAMAGE as error:
        lost.append(f"{what} cannot be read ({error})")
        return otherwise


# ---- records ------------------------------------------------------------------------------------


def _records(file: Any, lost: list[str]) -> list[Record]:
    columns = [_column(file, name, lost) for name in _RAW]
    blob, there = _try("raw/data", lost, lambda: _blob(file["raw"]["data"]), _NO_BYTES)
    records: list[Record] = []
    left_out: list[int] = []
    begin = 0
    *rows, ends = columns
    for number, (row, stated, following) in enumerate(
        zip(zip(*rows, strict=False), ends, [*ends[1:], len(blob)], strict=False), start=1
    ):
        damaged = not begin <= stated <= following
        end = begin if damaged else stated
        if damaged:
            lost.append(f"record {number}: its end is damaged; its bytes count to the next")
        if there[begin:end].all():
            before = records[-1] if records else None
            record, why = checked_record([*row, blob[begin:end]], before)
            lost += [f"record {number}: {why}"] if why else []
            records += [] if record is None else [record]
        else:
            left_out.append(number)
        begin = end
    lost += [f"{which} cannot be read: left out" for which in _ranges(left_out)]
    return records


def _column(file: Any, name: str, lost: list[str]) -> list[Any]:
    return list(_try(f"raw/{name}", lost, lambda: list(file["raw"][name][:].tolist()), []))


def _blob(data: Any) -> tuple[bytes, np.ndarray[Any, np.dtype[np.bool_]]]:
    """Return the bytes, 0 where they cannot be read, and which of them are there."""
    blob, there = np.zeros(len(data), dtype=np.uint8), np.zeros(len(data), dtype=bool)
    step = data.chunks[0] if data.chunks else max(len(data), 1)
    for begin in range(0, len(data), step):
        part = slice(begin, begin + step)
        try:
            blob[part] = data[part]
        except OSError:  # its checksum does not hold
            continue
        there[part] = True
    return blob.tobytes(), there


def _ranges(numbers: Iterable[int]) -> list[str]:
    """Return "record 3" and "records 5 to 7" for 3, 5, 6, 7."""
    found: list[tuple[int, int]] = []
    for number in numbers:
        if found and found[-1][1] == number - 1:
            found[-1] = (found[-1][0], number)
        else:
            found.append((number, number))
    return [f"record {a}" if a == b else f"records {a} to {b}" for a, b in found]


# ---- curves -------------------------------------------------------------------------------------


def _curves(file: Any, lost: list[str]) -> list[tuple[Curve, Result]]:
    """Return the curves that stand in the file beside the records, each with its result."""
    found: list[tuple[Curve, Result]] = []
    for number, name in enumerate(_try("curves", lost, lambda: list(file["curves"]), []), start=1):
        curve = _try(f"curves/{name}", lost, partial(_read_curve, file, name), None)
        if curve is None:
            continue
        what = f"the result of curves/{name}"
        found.append((curve, _try(what, lost, partial(_read_result, file, name, number), None)))
    return found


def _read_curve(file: Any, name: str) -> Curve:
    return read_curve(file["curves"][name])


def _read_result(file: Any, name: str, number: int) -> Result:
    return read_result(number, file["curves"][name])


if __name__ == "__main__":
    answer(lambda: _salvage(Path(sys.argv[1]), Path(sys.argv[2])))
