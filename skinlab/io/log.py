"""Where details go that a user should not have to read."""

from __future__ import annotations

import traceback
from datetime import UTC, datetime
from pathlib import Path

from skinlab.errors import InputError
from skinlab.io.files import append_text
from skinlab.text import inert_lines


def log_exception(error: BaseException) -> Path:
    """Append the traceback to the log; return the log's path."""
    from platformdirs import user_log_path  # slow to import

    path = user_log_path("skinlab", appauthor=False) / "errors.log"
    text = f"--- {datetime.now(UTC).isoformat()}\n{''.join(traceback.format_exception(error))}"
    try:
        append_text(path, inert_lines(text))
    except InputError:
        return Path("(no log could be written)")
    return path
