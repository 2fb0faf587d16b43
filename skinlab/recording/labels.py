"""Whose curves a session holds, in the words of the tables that list curves."""

from __future__ import annotations

from skinlab.recording.audit import entries
from skinlab.recording.session import Session, measured_utc

LABELS = ("subject", "visit", "site", "operator", "probe")


def labels_of(session: Session) -> dict[str, str]:
    """Return what a session says of whose curves it holds."""
    meta = session.meta
    instrument = meta.get("instrument")
    who = next((entry.who for entry in entries(session.records)), "")
    known = {
        "subject": meta.get("subject"),
        "site": meta.get("site"),
        "visit": measured_utc(meta)[:10],  # the day
        "operator": who,
        "probe": instrument.get("serial_number") if isinstance(instrument, dict) else None,
    }
    return {name: str(value) for name, value in known.items() if value}
