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
from skinlab.stream import Identified, Message


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
        """Record a result."""
        if isinstance(message, Identified):
            self.journal.result(self._clock(), message.index, message.result.to_json())

    def finish(self) -> Path | None:
        """Turn the journal into the session; the journal goes only once the session is there.

        Returns None, and leaves no file, where no run was ever planned.

        Raises:
            InputError: it cannot be written; the journal stays and the message names it.
        """
        self.journal.close()
        if self.journal.planned:
            recover(self.journal.path, self.path)
        self.journal.remove()
        return self.path if self.journal.planned else None


def recover(journal: Path, session: Path) -> int:
    """Write the session that a journal holds; return the number of its curves.

    Raises:
        InputError: no journal, or the session cannot be written.
    """
    if session.exists():
        raise InputError(f"{session}: exists already; a session is never overwritten")
    made = session_from_records(*read_journal(journal))
    try:
        write_session(session, made)
    except InputError as error:
        raise InputError(f"{error}; everything is kept in {journal}") from None
    return len(made.curves)
