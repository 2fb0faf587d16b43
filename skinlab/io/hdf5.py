"""HDF5 files: opened with a sentence for what is wrong, written whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from drivers.reading import require_file
from skinlab.errors import InputError
from skinlab.io.files import named_in_errors, whole_file

# What a file may claim to hold: compressed numbers are seldom a tenth of their size.
_MOST_PER_BYTE = 50
_ALWAYS_BYTES = 64_000_000

# What h5py raises of a damaged file; OSError comes of data whose checksum does not hold, too.
DAMAGE = (
    ArithmeticError,
    AttributeError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    SystemError,
    TypeError,
    ValueError,
)


@contextmanager
def open_hdf5(path: Path, *, damaged: bool = False) -> Iterator[Any]:
    """Open an HDF5 file for reading; what is in it was looked at before memory is taken for it.

    In one that is known to be damaged, what cannot be looked at is passed over: it fails when read.

    Raises:
        InputError: no such file, no HDF5, cut off, larger inside than such a file can be, with
            links to elsewhere; or, while it is open, a field is missing or not of its type.
    """
    import h5py

    path = Path(path)
    with named_in_errors(path):
        require_file(path)
    try:
        with h5py.File(path, "r") as file:
            _check_content(path, file, damaged=damaged)
            yield file
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(f"{path}:") else f"{path}: {text}") from None
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except PermissionError:
        raise InputError(f"{path}: no permission to read it") from None
    except OSError as error:
        what = "truncated, and not readable" if "truncated" in str(error) else "not readable"
        raise InputError(f"{path}: {what} as HDF5; expected a file that skinlab wrote") from None
    except DAMAGE as error:
        raise InputError(f"{path}: a field is missing or damaged ({error})") from None


def _check_content(path: Path, file: Any, *, damaged: bool) -> None:
    import h5py

    room = max(_ALWAYS_BYTES, _MOST_PER_BYTE * path.stat().st_size)
    claimed = 0

    # An error may not pass through HDF5's library: it is returned, which ends the visit.
    def look(name: str, link: Any) -> str | None:
        nonlocal claimed
        if not isinstance(link, h5py.HardLink):
            return f"{name} is a link to elsewhere; expected the data itself"
        entry = file[name]
        if not isinstance(entry, h5py.Dataset):
            return None
        if entry.is_virtual or entry.external:
            return f"{name} is kept in another file; expected the data itself"
        claimed += int(entry.size or 0) * entry.dtype.itemsize
        if claimed > room:
            return (
                f"{name} has {entry.size} elements, more than a file of "
                f"{path.stat().st_size} bytes holds; it is damaged"
            )
        return None

    if damaged:
        wrong = next((w for name, link in _reached(file) if (w := look(name, link))), None)
    else:
        wrong = file.visititems_links(look)
    if wrong is not None:
        raise InputError(wrong)


def _reached(group: Any, above: str = "", depth: int = 3) -> Iterator[tuple[str, Any]]:
    """Yield name and link of what can be opened, as deep as our files go."""
    import h5py

    with suppress(*DAMAGE):
        for name in group:
            with suppress(*DAMAGE):
                link = group.get(name, getlink=True)
                entry = group[name] if isinstance(link, h5py.HardLink) else None
                yield f"{above}{name}", link
                if depth > 1 and isinstance(entry, h5py.Group):
                    yield from _reached(entry, f"{above}{name}/", depth - 1)


def read_array(group: Any, name: str, kind: DTypeLike) -> NDArray[Any]:
    """Return a data set (n,), which must be of this type and have one dimension.

    Raises:
        InputError: it is not.
        KeyError: there is none of this name.
    """
    entry = group[name]
    expected = np.dtype(kind)
    found = getattr(entry, "dtype", None)
    least = min(4, expected.itemsize)  # int32 in the place of int64 is right, int8 is damage
    if found is None or found.kind != expected.kind or found.itemsize < least:
        raise InputError(f"{name} is of type {found}; expected {expected}")
    if entry.ndim != 1:
        raise InputError(f"{name} has {entry.ndim} dimensions; expected 1")
    array: NDArray[Any] = entry[()]
    return array


@contextmanager
def written_whole(path: Path) -> Iterator[Any]:
    """Open a new HDF5 file for writing; it takes its name, also of another, once it is whole.

    Raises:
        InputError: it cannot be written.
    """
    import h5py

    with (
        whole_file(path, replace=True) as partial,
        h5py.File(partial, "w", track_order=True) as file,
    ):
        yield file
