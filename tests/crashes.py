"""What a crash leaves."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from skinlab.recording.journal import Journal
from skinlab.recording.records import Kind
from skinlab.recording.session import read_session


def journal_of_example(path: Path) -> Journal:
    """Write what was measured in the example session into a journal, which is still open."""
    example = read_session(Path(str(files("skinlab") / "data" / "example.h5")))
    journal = Journal(path, example.meta)
    for record in example.records:
        if record.kind is not Kind.AUDIT:
            journal.put(record.kind, record.host_time_s, record.data, record.utc_s)
    journal.flush()
    return journal
