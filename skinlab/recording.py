"""Record a run: the journal while it goes on, the session file at its end."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from skinlab import __version__
from skinlab.errors import InputError
from skinlab.identify.identifier import Identifier
from skinlab.journal import Journal, read_journal
from skinlab.session import session_from_records, write_session
from skinlab.stream import CurveStarted, Identified, Message


def identification_settings(identifier: Identifier) -> dict[str, Any]:
    """Return what a replay must know to identify in the same way."""
    options = identifier.options
    return {
        "method": identifier.method,
        "seed": identifier.seed,
        "kappa": identifier.kappa,
        "phases": list(identifier.phases),
        "samples": options.samples,
        "best": options.best,
        "tolerance_um": options.tolerance_um,
        "sampling": options.sampling,
        "slowdown": options.slowdown,
        "forgetting": options.forgetting,
        "covariance": options.covariance,
        "passes": options.passes,
        "noise_um": identifier.sensor.noise_um,
        "pressure_noise_mbar": identifier.sensor.pressure_noise_mbar,
        "database_hash": identifier.database.content_hash,
    }


class Recording:
    """The journal of a session that becomes `path`; also a listener that records results.

    Raises:
        InputError: the session exists already, or nothing can be written there. Said before any
            suction starts.
    """

    def __init__(
        self,
        path: Path,
        identifier: Identifier,
        *,
        subject: str = "",
        site: str = "",
        url: str = "",
        clock: Callable[[], float] = time.monotonic,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        if path.exists():
            raise InputError(f"{path}: exists already; a session is never overwritten")
        self.path = path
        self.ran = False
        self._clock = clock
        self.journal = Journal(
            path.with_name(path.name + ".journal"),
            {
                "created_utc": now().isoformat(),
                "created_host_time_s": clock(),
                "skinlab_version": __version__,
                "subject": subject,
                "site": site,
                "url": url,
                "identification": identification_settings(identifier),
            },
        )

    def __call__(self, message: Message) -> None:
        """Record a result; notice that there is something to keep."""
        if isinstance(message, CurveStarted):
            self.ran = True
        elif isinstance(message, Identified):
            self.journal.result(self._clock(), message.index, message.result.to_json())

    def save(self) -> None:
        """Write the session as it is by now; the journal goes on.

        Raises:
            InputError: it cannot be written; the message names the journal that keeps everything.
        """
        _write(self.journal.path, self.path)

    def finish(self) -> Path | None:
        """Turn the journal into the session; the journal goes only once the session is there.

        Returns None, and leaves no file, where no run ever began.

        Raises:
            InputError: it cannot be written; the message names the journal that keeps everything.
        """
        self.journal.close()
        if self.ran:
            self.save()
        self.journal.remove()
        return self.path if self.ran else None


def new_session_path(folder: Path, now: datetime) -> Path:
    """Return a name for a session that is not there yet."""
    stem = now.strftime("session-%Y%m%d-%H%M%S")
    path = folder / f"{stem}.h5"
    number = 2
    while path.exists() or path.with_name(path.name + ".journal").exists():
        path = folder / f"{stem}-{number}.h5"
        number += 1
    return path


def recover(journal: Path, session: Path) -> int:
    """Write the session that a journal holds; return the number of its curves.

    Raises:
        InputError: no journal, or the session cannot be written.
    """
    if session.exists():
        raise InputError(f"{session}: exists already; a session is never overwritten")
    return _write(journal, session)


def _write(journal: Path, session: Path) -> int:
    made = session_from_records(*read_journal(journal))
    try:
        write_session(session, made)
    except InputError as error:
        raise InputError(f"{error}; everything is kept in {journal}") from None
    return len(made.curves)
