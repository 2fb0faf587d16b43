"""What every database file says of itself: its schema, its kind, the hash of its content."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from skinlab.errors import InputError

SCHEMA = "skinlab.database/1"


def check_kind(path: Path, file: Any, kind: str) -> None:
    """Refuse a file that is no database of this kind.

    Raises:
        InputError: it is not.
    """
    schema = file.attrs.get("schema")
    if schema != SCHEMA or file.attrs.get("kind") != kind:
        raise InputError(f"{path}: schema {schema!r}; expected a {kind} database, {SCHEMA!r}")


def check_hash(path: Path, computed: str, stated: str) -> None:
    """Refuse a file whose content is not what it was.

    Raises:
        InputError: it is not.
    """
    if computed != stated:
        raise InputError(f"{path}: its content does not agree with its hash; it is damaged")
