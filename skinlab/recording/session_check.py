"""Whether a session says what it said when it was written, and where it does not."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from skinlab.curves.curve import Curve
from skinlab.errors import InputError
from skinlab.recording.apart import answer, ask
from skinlab.recording.audit import Chain, entries
from skinlab.recording.clocks import clock_readings
from skinlab.recording.records import Kind
from skinlab.recording.seal import Seal, read_seal
from skinlab.recording.session import (
    Session,
    Stored,
    read_stored,
    sample_rows,
    session_from_records,
)
from skinlab.versions import software


def check(path: Path) -> tuple[Session, list[str]]:
    """Return the session, and a sentence for each thing in it that does not hold.

    The audit trail is followed entry by entry; samples, curves and results are made again from the
    recorded bytes and compared.

    Raises:
        InputError: the file cannot be read as a session.
    """
    stored = read_stored(path)
    found = _trail(stored.session)
    if any(record.kind is Kind.RECEIVED for record in stored.session.records):
        try:
            found += [sentence + _other_software(stored.session) for sentence in _derived(stored)]
        except (InputError, ValueError, TypeError, KeyError) as error:
            found.append(f"the records cannot be read again ({error})")
    if not stored.unchanged:
        found.append("the content does not agree with its hash: it was changed")
    seal = read_seal(path)
    if seal is Seal.NONE:
        found.append("the file has no seal: it was changed, or not written by skinlab")
    elif seal is Seal.BROKEN:
        found.append("the bytes of the file do not agree with their hash: it was changed")
    return stored.session, found


def complaints_about_changed(path: Path) -> list[str]:
    """Return what `check` finds in a file whose seal is broken.

    In a process of its own, because HDF5's library may crash over damaged bytes.

    Raises:
        InputError: the file cannot be read as a session any more.
    """
    return ask(__name__, path)


def _other_software(session: Session) -> str:
    """Return a remark where curves may be made from the same bytes in another way today."""
    stated = session.meta.get("versions")
    if not isinstance(stated, dict) or _same(stated):
        return ""
    return f" (or was made by other software: skinlab {stated.get('skinlab')} {stated.get('code')})"


def _same(stated: dict[str, object]) -> bool:
    then = {k: v for k, v in stated.items() if k == "code" or k.startswith("plugin ")}
    return then == software()


def audit_head(session: Session) -> str | None:
    """Return the hash of the last audit entry, which binds all before it; None: no trail."""
    chain = Chain(session.records)
    return chain.head if entries(session.records) else None


def _trail(session: Session) -> list[str]:
    chain = Chain()
    found = [c for record in session.records if (c := chain.complaint(record)) is not None]
    trail = entries(session.records)
    if not trail:
        return found
    opened = trail[0].detail
    for key in sorted(set(opened) & set(session.meta)):
        if opened[key] != session.meta[key]:
            found.append(f"meta: {key} is not what audit entry 1 ({trail[0].what}) says")
    last = session.records[-1]
    if last.kind is not Kind.AUDIT:
        found.append(f"the records go on behind the last audit entry, number {len(trail)}")
    elif trail[-1].what not in _ENDS:
        found.append(
            f"the audit trail ends with entry {len(trail)} ({trail[-1].what}): what came after it "
            "was removed"
        )
    return found


_ENDS = frozenset({"session saved", "session closed", "session imported", "recovered"})


def _derived(stored: Stored) -> list[str]:
    session = stored.session
    found = []
    rows = sample_rows(session)
    for k, (name, values) in enumerate(stored.samples.items()):
        if not np.array_equal(values, np.array([row[k] for row in rows], dtype=values.dtype)):
            found.append(f"samples: {name} is not what the recorded bytes say")
    again = session_from_records(session.meta, session.records)
    if len(again.curves) != len(session.curves):
        found.append(
            f"stored curves: {len(session.curves)}; the recorded bytes make {len(again.curves)}"
        )
        return found
    for k, curve in enumerate(session.curves):
        for column in _differing(curve, again.curves[k]):
            found.append(f"{curve.name}: {column} is not what the recorded bytes say")
        if _plain(session.results[k]) != _plain(again.results[k]):
            found.append(f"{curve.name}: its result is not the recorded one")
    clocks = clock_readings(session.meta, session.records)
    for curve, clock, recorded in zip(session.curves, stored.clocks, clocks, strict=True):
        if clock is not None and not (recorded is not None and clock.agrees_with(recorded)):
            found.append(f"{curve.name}: clock is not what the recorded bytes say")
    return found


def _differing(stored: Curve, again: Curve) -> list[str]:
    found = [
        column
        for column in ("time_s", "pressure_mbar", "deflection_mm", "segment")
        if not np.array_equal(getattr(stored, column), getattr(again, column))
    ]
    return found + [
        name
        for name in ("name", "setup", "partial")
        if getattr(stored, name) != getattr(again, name)
    ]


def _plain(result: dict[str, object] | None) -> str:
    return json.dumps(result, sort_keys=True)


if __name__ == "__main__":
    answer(lambda: check(Path(sys.argv[1]))[1])
