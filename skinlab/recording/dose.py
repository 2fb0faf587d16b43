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
from skinlab.recording.session import Session, read_session

VISIT_S = 12 * 3600.0  # what was measured earlier belongs to another visit
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
    same subject and the same site, of simulated instruments or of real ones alike. Without subject
    or site nobody can know. A session that cannot be read counts as none.
    """
    total, names = Dose(), list[str]()
    if not subject or not site or not folder.is_dir():
        return total, names
    for path in _recent(folder, now_utc_s):
        with suppress(*_UNREADABLE):
            session = read_session(path)
            if _belongs(session.meta, (subject, site), now_utc_s, simulated=simulated):
                total += dose_of(session)
                names.append(path.name)
    return total, names


def loaded_before(
    folder: Path, subject: str, site: str, now_utc_s: float, *, simulated: bool
) -> list[str]:
    """Return the names of the sessions of which `dose_before` would count the dose.

    Only their facts are read, and no seal is checked: quick enough for a key.
    """
    names = list[str]()
    if not subject or not site or not folder.is_dir():
        return names
    for path in _recent(folder, now_utc_s):
        with suppress(*_UNREADABLE), open_hdf5(path) as file:
            meta = read_json_object(file.attrs["meta"])
            if _belongs(meta, (subject, site), now_utc_s, simulated=simulated):
                names.append(path.name)
    return names


def _recent(folder: Path, now_utc_s: float) -> Iterator[Path]:
    for path in sorted(folder.glob("*.h5")):
        with suppress(OSError):
            if now_utc_s - path.stat().st_mtime <= VISIT_S:  # it was begun before it was written
                yield path


def _belongs(
    meta: Mapping[str, Any], whose: tuple[str, str], now_utc_s: float, *, simulated: bool
) -> bool:
    begun = datetime.fromisoformat(str(meta["created_utc"]))
    age_s = now_utc_s - begun.replace(tzinfo=begun.tzinfo or UTC).timestamp()
    of = (meta.get("subject"), meta.get("site"))
    kind = bool(meta["instrument"]["simulated"])
    return of == whose and kind == simulated and 0 <= age_s <= VISIT_S
