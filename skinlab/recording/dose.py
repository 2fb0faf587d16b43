"""What sessions say of the suction that their site had."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from drivers.dose import Dose, DoseMeter
from drivers.events import Sample
from skinlab.errors import InputError
from skinlab.io.documents import read_json_object
from skinlab.io.hdf5 import open_hdf5
from skinlab.recording.audit import entries
from skinlab.recording.clocks import clock_readings
from skinlab.recording.journal import all_left_behind, read_journal
from skinlab.recording.seal import Seal, read_seal
from skinlab.recording.session import Session, read_session, session_from_records
from skinlab.recording.session_names import is_session_name, sessions_in

VISIT_S = 12 * 3600.0  # what was measured earlier belongs to another visit
_SAYS_WHO = 1000  # records of a journal by which the instrument has said who it is
_UNREADABLE = (InputError, OSError, KeyError, TypeError, ValueError)


def dose_of(session: Session) -> Dose:
    """Return the dose of a whole session, as its audit trail has it.

    Where the trail ends before the last run did (a crash, a file of an older version), it is that
    of the curves: the vents after them are missing in it. Of an instrument that nobody controls by
    the host's clock, as when live.
    """
    noted: Dose | None = None
    for entry in entries(session.records):
        if entry.what == "run started":
            noted = None
        elif "dose_mbar_s" in entry.detail:
            noted = Dose(float(entry.detail["dose_mbar_s"]), float(entry.detail["suction_s"]))
    if noted is not None:
        return noted
    meter = DoseMeter()
    for curve, rate in zip(session.curves, _rates(session), strict=True):
        for time_s, mbar in zip(curve.time_s, curve.pressure_mbar, strict=True):
            meter.add(Sample(0, float(time_s) / rate, float(mbar), 0.0, 0))
    return meter.total


def _rates(session: Session) -> list[float]:
    """Return by curve how fast the instrument's clock went, where nobody held it to the host's."""
    rates = [1.0] * len(session.curves)
    if "control" in session.meta:  # it is said of what is read only
        for k, clock in enumerate(clock_readings(session.meta, session.records)[: len(rates)]):
            rates[k] = 1.0 if clock is None else clock.rate
    return rates


def dose_before(
    folder: Path, subject: str, site: str, now_utc_s: float, *, simulated: bool
) -> tuple[Dose, list[str]]:
    """Return what a site had in this visit already, and the names of the sessions that say so.

    Looked at are the sessions of a folder that were begun in the last 12 h (`VISIT_S`), with the
    same subject and the same site, of simulated instruments or of real ones alike; and the journals
    that crashes left there. One that is there twice (a copy, or what was saved before the crash)
    counts once, as the one that says more. Without subject or site nobody can know. What cannot be
    read counts as none.
    """
    found = dict[object, tuple[Dose, str]]()
    if not subject or not site:
        return Dose(), []
    for path in _recent(folder, now_utc_s):
        with suppress(*_UNREADABLE):
            session = _read(path)
            if _belongs(session.meta, (subject, site), now_utc_s, simulated=simulated):
                begun, dose = _begun(session.meta), dose_of(session)
                if begun not in found or dose.suction_mbar_s > found[begun][0].suction_mbar_s:
                    found[begun] = dose, path.name
    return sum((dose for dose, _ in found.values()), Dose()), [name for _, name in found.values()]


def loaded_before(
    folder: Path, subject: str, site: str, now_utc_s: float, *, simulated: bool
) -> list[str]:
    """Return what `dose_before` would count the dose of, by name; of two of one visit the first.

    Only the facts are read: quick enough for a key.
    """
    names = dict[object, str]()
    if not subject or not site:
        return []
    for path in _recent(folder, now_utc_s):
        with suppress(*_UNREADABLE):
            meta = _facts(path)
            if _belongs(meta, (subject, site), now_utc_s, simulated=simulated):
                names.setdefault(_begun(meta), path.name)
    return list(names.values())


def _recent(folder: Path, now_utc_s: float) -> Iterator[Path]:
    for path in (*sessions_in(folder), *all_left_behind(folder)):
        with suppress(OSError):
            if now_utc_s - path.stat().st_mtime <= VISIT_S:  # it was begun before it was written
                yield path


def _read(path: Path) -> Session:
    if is_session_name(path):
        return read_session(path)
    left = read_journal(path, left=True)
    return session_from_records(left.meta, left.records)


def _facts(path: Path) -> Mapping[str, Any]:
    if not is_session_name(path):
        left = read_journal(path)
        return session_from_records(left.meta, left.records[:_SAYS_WHO]).meta
    if read_seal(path) is Seal.BROKEN:
        raise InputError(f"{path}: was changed since it was written")  # and HDF5 may crash over it
    with open_hdf5(path) as file:
        return read_json_object(file.attrs["meta"])


def _begun(meta: Mapping[str, Any]) -> object:
    """Return what no two visits have alike."""
    return meta["created_utc"], meta.get("created_host_time_s")


def _belongs(
    meta: Mapping[str, Any], whose: tuple[str, str], now_utc_s: float, *, simulated: bool
) -> bool:
    begun = datetime.fromisoformat(str(meta["created_utc"]))
    age_s = now_utc_s - begun.replace(tzinfo=begun.tzinfo or UTC).timestamp()
    of = (meta.get("subject"), meta.get("site"))
    kind = bool(meta["instrument"]["simulated"])
    # A clock that was set back in between makes it begin later than now
    return of == whose and kind == simulated and abs(age_s) <= VISIT_S
