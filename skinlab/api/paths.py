"""Files as users name them."""

from __future__ import annotations

import os
from pathlib import Path

from skinlab.errors import InputError

PathLike = str | os.PathLike[str]


def as_path(path: PathLike) -> Path:
    """Return the path of a str or Path; ~ is the user's folder.

    Raises:
        InputError: it is neither.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"{path!r}: expected the path of a file, as str or Path")
    return Path(path).expanduser()
