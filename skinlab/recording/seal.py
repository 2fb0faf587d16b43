"""A hash of all bytes of a file, in front of them: damage is seen before anything reads the file.

HDF5 leaves room for it (its user block) and finds what is behind. Its library trusts what it reads,
and a single flipped bit can make it crash; so the seal is looked at first.
"""

from __future__ import annotations

import hashlib
from enum import Enum
from pathlib import Path

from drivers.reading import require_file
from skinlab.errors import InputError

SEAL_BYTES = 512  # the smallest user block
_MAGIC = b"skinlab seal/1 sha256:"


class Seal(Enum):
    """What a file's seal says."""

    HOLDS = "holds"
    BROKEN = "broken"  # the file was changed since it was sealed
    NONE = "none"


def put_seal(image: memoryview) -> None:
    """Seal a file in memory, whose first SEAL_BYTES are free for it."""
    image[:SEAL_BYTES] = _block(hashlib.sha256(image[SEAL_BYTES:]).hexdigest())


def is_sealed(path: Path) -> bool:
    """Return whether a file begins with a seal, whatever it says."""
    with path.open("rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC


def read_seal(path: Path) -> Seal:
    """Return what the seal of this file says.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        require_file(path)
        with Path(path).open("rb") as file:
            block = file.read(SEAL_BYTES)
            if not block.startswith(_MAGIC):
                return Seal.NONE  # and what is behind it may be of any size
            digest = hashlib.file_digest(file, "sha256")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    return Seal.HOLDS if block == _block(digest.hexdigest()) else Seal.BROKEN


def _block(hexdigest: str) -> bytes:
    return (_MAGIC + hexdigest.encode() + b"\n").ljust(SEAL_BYTES, b"\0")
