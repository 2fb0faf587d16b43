"""Record a run: the journal while it goes on, the session file at its end."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.dialect import Dialect
from drivers.dialects import DEFAULT, get_dialect
from drivers.dose import Dose, DoseMeter
from drivers.events import Alarm, Event, HostVented, InstrumentFault, LinkLost
from skinlab.errors import InputError
from skinlab.recording.audit import Chain, note, operator
from skinlab.recording.dose import dose_before
from skinlab.recording.journal import Journal, journal_of, read_journal
from skinlab.recording.pseudonym import check_site, check_subject
from skinlab.recording.recorded_items import dialect_facts
from skinlab.recording.records import Kind, Record
from skinlab.recording.session import Session, read_session, session_from_records, write_session
from skinlab.recording.session_names import check_session_name
from skinlab.recording.stream import (
    CurveCompleted,
    CurveStarted,
    Happened,
    Identified,
    Message,
    Sampled,
    setup_to_json,
)
from skinlab.versions import __version__, versions

if TYPE_CHECKING:
    from skinlab.inference.identify import Identifier


def identification_settings(identifier: Identifier) -> dict[str, Any]:
    """Return what a replay must know to identify in the same way."""
    from skinlab.inference.methods import get_method
    from skinlab.inference.population import PopulationIdentifier
    from skinlab.mechanics.model_file import BASE

    options, path = identifier.options, identifier.database.path
    probe = identifier.sensor.probe
    prior = identifier.population if isinstance(identifier, PopulationIdentifier) else None
    return {
        "method": identifier.method,
        "seed": identifier.seed,
        "kappa": identifier.kappa,
        "phases": list(identifier.phases),
        "samples": options.samples,
        "best": options.best,
        "tolerance_um": options.tolerance_um,
        "options": get_method(identifier.method).own(options),
        "model": None if identifier.model is BASE else identifier.model.to_toml(),
        "noise_um": identifier.sensor.noise_um,
        "pressure_noise_mbar": identifier.sensor.pressure_noise_mbar,
        "database_hash": identifier.database.content_hash,
        "database_path": None if path is None else str(path),
        **({} if prior is None else {"prior": prior.to_json()}),
        **({} if probe is None else {"probe": probe.text}),
    }


class Recording:
    """The journal of a session that becomes `path`; also a listener that records what happens.

    `clock` is the host's monotonic time, `now` Unix time, both in s; `who` is in the audit trail.
    dialect: what the instrument speaks; None: `reference`.

    Raises:
        InputError: the session exists already, nothing can be written there, the subject is no
            pseudonym, the site names a person, or the file is not called as sessions are. Said
            before any suction starts.
    """

    def __init__(
        self,
        path: Path,
        identifier: Identifier,
        *,
        subject: str = "",
        site: str = "",
        url: str = "",
        dialect: Dialect | None = None,
        clock: Callable[[], float] = time.monotonic,
        now: Callable[[], float] = time.time,
        who: str | None = None,
    ) -> None:
        check_subject(subject)
        check_site(site)
        check_session_name(path)
        if os.path.exists(path):
            raise InputError(f"{path}: exists already; a session is never overwritten")
        self.path = path
        self.ran = False
        self._subject, self._site = subject, site
        self._dose = DoseMeter()
        self._saved = False
        self._now = now
        self._clock = clock
        self._who = operator() if who is None else who
        meta = {
            "created_utc": datetime.fromtimestamp(now(), UTC).isoformat(),
            "created_host_time_s": clock(),
            "skinlab_version": __version__,
            "versions": versions(),
            "subject": subject,
            "site": site,
            "url": url,
            **dialect_facts(get_dialect(DEFAULT) if dialect is None else dialect),
            "identification": identification_settings(identifier),
        }
        self.journal = Journal(journal_of(path), meta, now)
        self.audit("session opened", **meta)

    def __call__(self, message: Message) -> None:
        """Record a result, and what the trail should tell; notice that there is something to keep.

        Where the journal cannot be written, the probe has been vented for it, and `finish` says so:
        the curve is still identified and shown.
        """
        if isinstance(message, Sampled):
            self._dose.add(message.sample)
            return  # by far the most, and in the bytes already
        self.ran = self.ran or isinstance(message, CurveStarted)
        with contextlib.suppress(InputError):
            self._record(message)

    def _record(self, message: Message) -> None:
        match message:
            case CurveStarted(index, curve):
                self.audit("run started", curve=index, setup=setup_to_json(curve.setup))
            case CurveCompleted(index, curve, cut, lost):
                self.audit("run ended", curve=index, samples=len(curve), cut=cut, lost=lost)
            case Identified(index, _, result):
                self.journal.result(self._clock(), index, result.to_json())
                self.audit("identified", curve=index, error=result.error)
            case Happened(event) if (deed := _deed(event)) is not None:
                self.audit(deed[0], **deed[1])
            case _:
                pass

    def audit(self, what: str, **detail: Any) -> None:
        """Record in the audit trail that the operator, or the program for him, did this.

        Raises:
            InputError: the journal cannot be written.
        """
        self.journal.audit(self._clock(), self._who, what, **detail)

    def acknowledged(self, alarm: str) -> None:
        """Record that an alarm was acknowledged by having started what goes on by itself."""
        with contextlib.suppress(InputError):  # the probe has been vented for it
            self.audit("alarm acknowledged", text=alarm, by="the start of the measurement")

    @property
    def dose(self) -> Dose:
        """What the site has had so far, vents included."""
        return self._dose.total

    def carry_dose(self, *, simulated: bool) -> Dose:
        """Return what the site had in this visit before, by the sessions beside this one."""
        before, names = dose_before(
            self.path.parent, self._subject, self._site, self._now(), simulated=simulated
        )
        if names:
            detail = {"before_mbar_s": round(before.suction_mbar_s, 1), "sessions": names}
            self.audit("dose carried over", **detail)
        return before

    def _dose_detail(self) -> dict[str, float]:
        dose = self.dose
        return {"dose_mbar_s": round(dose.suction_mbar_s, 1), "suction_s": round(dose.time_s, 2)}

    def save(self) -> None:
        """Write the session as it is by now; the journal goes on.

        Raises:
            InputError: it cannot be written; the message names the journal that keeps everything.
        """
        self.journal.try_again()
        self.audit("session saved", **self._dose_detail())
        self.journal.flush()
        self._save()

    def _save(self) -> None:
        read = read_journal(self.journal.path)
        made = session_from_records(read.meta, read.records)
        _write(self.journal.path, self.path, made, replace=self._saved)
        self._saved = True

    def finish(self) -> Path | None:
        """Turn the journal into the session; the journal goes only once the session is there.

        Returns None, and leaves no file, where no run ever began.

        Raises:
            InputError: it cannot be written; the message names the journal that keeps everything.
        """
        with contextlib.suppress(InputError):  # what close() says is more
            self.audit("session closed", **self._dose_detail())
        self.journal.close()
        if self.ran:
            self._save()
        self.journal.remove()
        return self.path if self.ran else None


def _deed(event: Event) -> tuple[str, dict[str, Any]] | None:
    match event:
        case HostVented(reason):
            return "vent ordered", {"reason": reason}
        case InstrumentFault(code, text):
            return "instrument fault", {"code": code, "text": text}
        case LinkLost(reason):
            return "link lost", {"reason": reason}
        case Alarm(text):
            return "alarm", {"text": text}
        case _:
            return None


def new_session_path(folder: Path, now: datetime) -> Path:
    """Return a name for a session that is not there yet."""
    stem = now.strftime("session-%Y%m%d-%H%M%S")
    path = folder / f"{stem}.h5"
    number = 2
    while path.exists() or journal_of(path).exists():
        path = folder / f"{stem}-{number}.h5"
        number += 1
    return path


_MOST_SENTENCES = 100  # in the audit trail


def recover(
    journal: Path,
    session: Path,
    *,
    clock: Callable[[], float] = time.monotonic,
    now: Callable[[], float] = time.time,
    who: str | None = None,
) -> tuple[Session, list[str]]:
    """Write the session that a journal holds; return it, and what could not be read of it.

    The journal stays. What could not be read is in the audit trail as well, a sentence each.

    A session that was saved before the crash is completed: nothing in it is lost.

    Raises:
        InputError: no journal, the session cannot be written, or another one is there.
    """
    read = read_journal(journal, left=True)
    meta, records, skipped = read.meta, read.records, read.skipped
    before = None
    if session.exists():
        before = read_session(session)
        if not _same(before.records, records):
            raise InputError(
                f"{session}: exists already and is not an earlier state of {journal}; a session is "
                "never overwritten"
            )
        if len(before.records) >= len(records):
            return before, skipped
    session_from_records(meta, records, skipped.append)
    records.append(recovery(records, skipped, clock(), now(), who))
    made = session_from_records(meta, records)
    _write(journal, session, made, replace=before is not None)
    return made, skipped


def recovery(
    records: Sequence[Record],
    lost: Sequence[str],
    host_time_s: float,
    utc_s: float,
    who: str | None,
    **of: str,
) -> Record:
    """Return the entry behind these records that says who recovered them, of what, and the loss."""
    detail = {**of, "skipped": list(lost[:_MOST_SENTENCES])} if lost else {**of}
    deed = note(host_time_s, utc_s, operator() if who is None else who, "recovered", detail)
    return Chain(records).add(deed)


def _same(saved: tuple[Record, ...], records: list[Record]) -> bool:
    """Return whether a saved session is an earlier state of these records, or a recovered one."""
    if saved and saved[-1].kind is Kind.AUDIT and len(saved) == len(records) + 1:
        saved = saved[:-1]
    return list(saved) == records[: len(saved)]


def _write(journal: Path, session: Path, made: Session, *, replace: bool) -> None:
    try:
        write_session(session, made, replace=replace)
    except InputError as error:
        raise InputError(
            f"{error}; everything is kept in {journal}: `skinlab recover {journal}`"
        ) from None
