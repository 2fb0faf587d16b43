"""Outcomes kept by the content of what they were computed from: a second run is instant."""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
from collections.abc import Iterable
from pathlib import Path

import platformdirs

from skinlab.discrepancy.outcome import Outcome

VERSION = "2"  # raise it whenever the workflow may answer differently


def key(parts: Iterable[str]) -> str:
    """Return the name under which an outcome is kept, from all that it depends on."""
    return hashlib.sha256("\n".join([VERSION, *parts]).encode()).hexdigest()


def load(name: str, folder: Path | None = None) -> Outcome | None:
    """Return the outcome of this name, None where there is none that can be read."""
    try:
        found = pickle.loads((_folder(folder) / name).read_bytes())
    except Exception:  # noqa: BLE001 -- whatever is wrong with a cache: compute again
        return None
    return found if isinstance(found, Outcome) else None


def save(name: str, outcome: Outcome, folder: Path | None = None) -> None:
    """Keep the outcome; where that fails, nothing is lost but time."""
    with contextlib.suppress(OSError, pickle.PicklingError):
        to = _folder(folder)
        to.mkdir(mode=0o700, parents=True, exist_ok=True)
        part = to / f"{name}.{os.getpid()}"
        part.write_bytes(pickle.dumps(outcome))
        part.replace(to / name)


def _folder(folder: Path | None) -> Path:
    return (
        Path(platformdirs.user_cache_dir("skinlab")) / "discrepancy" if folder is None else folder
    )
