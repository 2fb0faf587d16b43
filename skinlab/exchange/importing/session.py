"""Imported curves as a session: as any other, without bytes of an instrument."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from skinlab.errors import InputError
from skinlab.exchange.importing.reader import Imported
from skinlab.inference.identify import Identifier
from skinlab.inference.result import Identification
from skinlab.recording.audit import Chain, note, operator
from skinlab.recording.pseudonym import check_site, check_subject
from skinlab.recording.recorder import identification_settings
from skinlab.recording.session import Session, write_session
from skinlab.recording.session_names import check_session_name
from skinlab.versions import __version__, versions


@dataclass(frozen=True)
class Who:
    """Whose curves they are, who imports them, and the two clocks: monotonic and Unix time, in s.

    Raises:
        InputError: the subject is no pseudonym, or the site names a person.
    """

    subject: str = ""
    site: str = ""
    operator: str = field(default_factory=operator)
    clock: Callable[[], float] = time.monotonic
    now: Callable[[], float] = time.time

    def __post_init__(self) -> None:
        """Refuse what looks like a name."""
        check_subject(self.subject)
        check_site(self.site)


def imported_session(
    imported: Sequence[Imported],
    results: Sequence[Identification | None],
    identifier: Identifier | None,
    who: Who,
    measured: str = "",
) -> Session:
    """Return the session of these curves and of what was identified from them.

    Without an identifier nothing was identified. `measured` is when they were measured, as
    `stated_time` returns it; "": nobody said. The audit trail is one entry: who imported what.
    """
    utc_s, host_time_s = who.now(), who.clock()
    meta: dict[str, Any] = {
        "created_utc": datetime.fromtimestamp(utc_s, UTC).isoformat(),
        **({"measured_utc": measured} if measured else {}),
        "created_host_time_s": host_time_s,
        "skinlab_version": __version__,
        "versions": versions(),
        "subject": who.subject,
        "site": who.site,
        "url": "",
        "imported": [
            {"file": one.file, "sha256": one.sha256, "understood": list(one.understood)}
            for one in imported
        ],
    }
    if identifier is not None:
        meta["identification"] = identification_settings(identifier)
    entry = Chain().add(note(host_time_s, utc_s, who.operator, "session imported", meta))
    return Session(
        meta,
        (entry,),
        tuple(one.curve for one in imported),
        tuple(None if result is None else result.to_json() for result in results),
    )


def check_new(path: Path) -> None:
    """Make sure that a session can be written there.

    Raises:
        InputError: there is a file already, no folder that can be written, or a name that no
            command would take for a session.
    """
    if path.exists():
        raise InputError(f"{path}: exists already; a session is never overwritten")
    check_session_name(path)
    write_session(path, Session({}, (), (), ()))
    path.unlink()


__all__ = ["check_new", "imported_session", "write_session"]
