"""What a session says of the suction that its site had."""

from __future__ import annotations

from drivers.dose import Dose, DoseMeter
from drivers.events import Sample
from skinlab.recording.audit import entries
from skinlab.recording.session import Session


def dose_of(session: Session) -> Dose:
    """Return the dose of a whole session, as its audit trail has it.

    Where the trail ends before the last run did (a crash, a file of an older version), it is that
    of the curves: the vents after them are missing in it.
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
    for curve in session.curves:
        for time_s, mbar in zip(curve.time_s, curve.pressure_mbar, strict=True):
            meter.add(Sample(0, float(time_s), float(mbar), 0.0, 0))
    return meter.total
