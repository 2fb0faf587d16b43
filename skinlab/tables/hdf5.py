"""HDF5 files: opened with a sentence for what is wrong, written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from skinlab.errors import InputError

SCHEMA = "skinlab.database/1"


@contextmanager
def open_hdf5(path: Path) -> Iterator[Any]:
    """Open an HDF5 file for reading.

    Raises:
        InputError: no such file, no HDF5, cut off, or a field is missing.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            yield file
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except PermissionError:
        raise InputError(f"{path}: no permission to read it") from None
    except OSError as error:
        what = "truncated" if "truncated" in str(error) else "not readable"
        raise InputError(f"{path}: {what} as HDF5; expected a file that skinlab wrote") from None
    except (KeyError, RuntimeError) as error:
        raise InputError(f"{path}: a field is missing or damaged ({error})") from None


@contextmanager
def written_whole(path: Path) -> Iterator[Any]:
    """Open a new HDF5 file for writing; it takes its name once it is whole.

    Raises:
        InputError: it cannot be written.
    """
    import h5py

    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    try:
        with h5py.File(partial, "w", track_order=True) as file:
            yield file
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None


def check_hash(path: Path, computed: str, stated: str) -> None:
    """Refuse a file whose content is not what it was.

    Raises:
        InputError: it is not.
    """
    if computed != stated:
        raise InputError(f"{path}: its content does not agree with its hash; it is damaged")
