"""Names for session files."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path


def new_session_path(folder: Path, now: datetime) -> Path:
    """Return a name for a session that is not there yet."""
    stem = now.strftime("session-%Y%m%d-%H%M%S")
    path = folder / f"{stem}.h5"
    number = 2
    while path.exists() or path.with_name(path.name + ".journal").exists():
        path = folder / f"{stem}-{number}.h5"
        number += 1
    return path
