"""Outcomes kept by the content of what they were computed from: a second run is instant."""

from __future__ import annotations

import contextlib
import hashlib
import pickle
from collections.abc import Iterable
from pathlib import Path

import platformdirs

from skinlab.discrepancy.outcome import Outcome
from skinlab.errors import InputError
from skinlab.io.files import write_file

_DIGEST = hashlib.sha256().digest_size
VERSION = "2"  # raise it whenever the workflow may answer differently


def key(parts: Iterable[str]) -> str:
    """Return the name under which an outcome is kept, from all that it depends on."""
    return hashlib.sha256("\n".join([VERSION, *parts]).encode()).hexdigest()


def load(name: str, folder: Path | None = None) -> Outcome | None:
    """Return the outcome of this name, None where there is none that can be read.

    A pickle is a program: one that was changed since it was kept is never run.
    """
    try:
        raw = (_folder(folder) / name).read_bytes()
        digest, kept = raw[:_DIGEST], raw[_DIGEST:]
        if hashlib.sha256(kept).digest() != digest:
            return None
        found = pickle.loads(kept)
    except Exception:  # noqa: BLE001 -- whatever is wrong with a cache: compute again
        return None
    return found if isinstance(found, Outcome) else None


def save(name: str, outcome: Outcome, folder: Path | None = None) -> None:
    """Keep the outcome; where that fails, nothing is lost but time."""
    with contextlib.suppress(OSError, InputError, pickle.PicklingError):
        to = _folder(folder)
        to.mkdir(mode=0o700, parents=True, exist_ok=True)
        kept = pickle.dumps(outcome)
        write_file(to / name, hashlib.sha256(kept).digest() + kept, replace=True)


def _folder(folder: Path | None) -> Path:
    return (
        Path(platformdirs.user_cache_dir("skinlab")) / "discrepancy" if folder is None else folder
    )
