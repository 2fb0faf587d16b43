"""Imported curves as a session: as any other, without bytes of an instrument."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from skinlab import __version__
from skinlab.errors import InputError
from skinlab.identify.identifier import Identifier
from skinlab.identify.result import Identification
from skinlab.importing.reader import Imported
from skinlab.recording import identification_settings
from skinlab.session import Session, write_session


def imported_session(
    imported: Sequence[Imported],
    results: Sequence[Identification | None],
    identifier: Identifier | None,
    *,
    now: datetime,
    host_time_s: float,
) -> Session:
    """Return the session of these curves and of what was identified from them.

    `now` and `host_time_s` (the monotonic clock) say when it was made; without an identifier
    nothing was identified.
    """
    meta: dict[str, Any] = {
        "created_utc": now.isoformat(),
        "created_host_time_s": host_time_s,
        "skinlab_version": __version__,
        "subject": "",
        "site": "",
        "url": "",
        "imported": [
            {"file": one.file, "sha256": one.sha256, "understood": list(one.understood)}
            for one in imported
        ],
    }
    if identifier is not None:
        meta["identification"] = identification_settings(identifier)
    return Session(
        meta,
        (),
        tuple(one.curve for one in imported),
        tuple(None if result is None else result.to_json() for result in results),
    )


def check_new(path: Path) -> None:
    """Make sure that a session can be written there.

    Raises:
        InputError: there is a file already, or no folder that can be written.
    """
    if path.exists():
        raise InputError(f"{path}: exists already; a session is never overwritten")
    write_session(path, Session({}, (), (), ()))
    path.unlink()


__all__ = ["check_new", "imported_session", "write_session"]
