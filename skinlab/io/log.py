"""Where details go that a user should not have to read."""

from __future__ import annotations

import traceback
from datetime import UTC, datetime
from pathlib import Path

from platformdirs import user_log_path


def log_exception(error: BaseException) -> Path:
    """Append the traceback to the log; return the log's path."""
    path = user_log_path("skinlab", appauthor=False) / "errors.log"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8") as file:
            file.write(f"--- {datetime.now(UTC).isoformat()}\n")
            file.writelines(traceback.format_exception(error))
    except OSError:
        return Path("(no log could be written)")
    return path
