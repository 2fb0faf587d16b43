"""Who did what when: entries among the records, each bound to all that was recorded before it.

An entry holds the hash of the entry before it and of every byte recorded so far, so that nothing
before the last entry can be changed, left out or put in without breaking the chain. The hash of
the last entry, noted elsewhere, binds the whole.
"""

from __future__ import annotations

import getpass
import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import msgspec

from skinlab.io.documents import read_json
from skinlab.recording.records import Kind, Record

START = "0" * 64  # what the first entry follows


@dataclass(frozen=True)
class Entry:
    """One entry, in words and numbers."""

    number: int  # from 1
    utc: str  # ISO 8601
    who: str
    what: str
    detail: dict[str, Any]


class _Said(msgspec.Struct):
    utc: str
    who: str
    what: str
    detail: dict[str, Any]


def operator() -> str:
    """Return who is at the computer: the name of the account."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # an account without a name
        return f"uid {os.getuid()}" if hasattr(os, "getuid") else "unknown"


def note(host_time_s: float, utc_s: float, who: str, what: str, detail: dict[str, Any]) -> Record:
    """Return an entry that is not in a chain yet."""
    utc = datetime.fromtimestamp(utc_s, UTC).isoformat()
    said = {"utc": utc, "who": who, "what": what, "detail": detail}
    return Record(Kind.AUDIT, host_time_s, utc_s, json.dumps(said).encode())


class Chain:
    """Binds entries to what was recorded before them; sees every record once, in order."""

    def __init__(self, records: Iterable[Record] = ()) -> None:
        """Go on behind these records, whose entries are in the chain already."""
        self._previous = START
        self._entries = 0
        self._seen = hashlib.sha256()
        for record in records:
            self._pass(record)

    @property
    def head(self) -> str:
        """Hash of the last entry."""
        return self._previous

    def copy(self) -> Chain:
        """Return another one at the same place."""
        other = Chain()
        other._previous, other._entries = self._previous, self._entries
        other._seen = self._seen.copy()
        return other

    def add(self, record: Record) -> Record:
        """Return the record as it is to be stored: an entry with its place in the chain."""
        if record.kind is Kind.AUDIT:
            said = read_json(record.data) | self._place()
            record = replace(record, data=json.dumps(said).encode())
        self._pass(record)
        return record

    def _place(self) -> dict[str, Any]:
        return {
            "entry": self._entries + 1,
            "records": self._seen.hexdigest(),
            "previous": self._previous,
        }

    def _pass(self, record: Record) -> None:
        if record.kind is Kind.AUDIT:
            self._entries += 1
            self._previous = hashlib.sha256(record.data).hexdigest()
        else:
            what = (int(record.kind), record.host_time_s, record.utc_s, len(record.data))
            self._seen.update(repr(what).encode())
            self._seen.update(record.data)

    def complaint(self, record: Record) -> str | None:
        """Pass a stored record; say in one sentence where an entry does not follow what is there.

        The chain goes on behind it as if it did, so that each break is told once.
        """
        found = None
        if record.kind is Kind.AUDIT:
            place = self._place()
            try:
                said = read_json(record.data)
                name = f"audit entry {place['entry']} ({said['utc']}, {said['what']})"
                stated = {key: said[key] for key in place}
            except (ValueError, TypeError, KeyError):
                found = f"audit entry {place['entry']} cannot be read"
            else:
                if stated["previous"] != place["previous"] or stated["entry"] != place["entry"]:
                    found = (
                        f"{name} does not follow the entry before it: that one was changed, or "
                        "entries were removed or put in"
                    )
                elif stated["records"] != place["records"]:
                    found = f"{name} does not agree with what is recorded before it"
        self._pass(record)
        return found


def entries(records: Iterable[Record]) -> list[Entry]:
    """Return the entries among the records; those that cannot be read say so."""
    found: list[Entry] = []
    for record in records:
        if record.kind is not Kind.AUDIT:
            continue
        number = len(found) + 1
        try:
            said = msgspec.convert(read_json(record.data), _Said)
            entry = Entry(number, said.utc, said.who, said.what, said.detail)
        except ValueError:
            entry = Entry(number, "", "", "cannot be read", {})
        found.append(entry)
    return found
