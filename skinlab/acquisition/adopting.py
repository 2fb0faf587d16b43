"""Writes the model with the effect that was missing."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from skinlab.io.files import file_hash, write_file
from skinlab.mechanics.model_file import Model

if TYPE_CHECKING:
    from skinlab.discrepancy.outcome import Outcome
    from skinlab.tables.base import Database


def write_adopted(
    outcome: Outcome,
    base: Model,
    folder: Path,
    session: Path | None,
    database: Database,
    now: datetime,
) -> tuple[Path, Model]:
    """Return the path of a new MODEL.toml in `folder`, and the model; it tells the session's hash.

    Raises:
        InputError: the verdict names no effect, or the file cannot be written.
    """
    from skinlab.discrepancy.adopt import adopted  # slow to import

    data = {}
    if session is not None and session.is_file():
        data[session.name] = file_hash(session)
    model = adopted(base, outcome, data=data, database_hash=database.content_hash, now=now)
    names = "-".join(e for e in outcome.best.effects if e not in outcome.found.base.effects)
    stem = "model" if session is None else session.stem
    return _write_new(folder, f"{stem}-{names}", model.to_toml()), model


def _write_new(folder: Path, stem: str, text: str) -> Path:
    """Write a file whose name is free; nothing is overwritten."""
    for path in _names(folder, stem):
        if not path.exists():
            write_file(path, text)
            return path
    raise AssertionError  # names do not end


def _names(folder: Path, stem: str) -> Iterator[Path]:
    yield folder / f"{stem}.toml"
    for number in count(2):
        yield folder / f"{stem}-{number}.toml"
