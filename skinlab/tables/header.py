"""What every database file says of itself: its schema, its kind, the hash of its content."""

from __future__ import annotations

from pathlib import Path

from skinlab.errors import InputError

SCHEMA = "skinlab.database/1"


class AlteredError(InputError):
    """A database whose content is not what its hash says."""


def check_hash(path: Path, computed: str, stated: str) -> None:
    """Refuse a file whose content is not what it was.

    Raises:
        AlteredError: it is not.
    """
    if computed != stated:
        raise AlteredError(f"{path}: its content does not agree with its hash; it is damaged")
