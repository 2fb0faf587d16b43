"""How the files of sessions are called."""

from __future__ import annotations

from pathlib import Path, PurePath

from skinlab.errors import InputError

SESSIONS = frozenset({".h5", ".hdf5"})  # endings of their names


def is_session_name(path: PurePath) -> bool:
    """Return whether commands take a file of this name for a session."""
    return path.suffix.lower() in SESSIONS


def sessions_in(folder: Path) -> list[Path]:
    """Return what is called as sessions are in a folder, by name; nothing where it is none."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.glob("*.*") if is_session_name(path))


def check_session_name(path: Path) -> None:
    """Make sure that commands would take a file of this name for a session.

    Raises:
        InputError: its name does not end as sessions' do.
    """
    if not is_session_name(path):
        raise InputError(f"{path}: expected a name that ends with .h5, as sessions have")
