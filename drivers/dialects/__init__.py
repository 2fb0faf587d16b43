"""Dialects: one file each is the grammar of one instrument, found by looking in this folder.

A dialect's module has a `DIALECT` that meets `Dialect`. It holds both sides of the conversation,
so that the simulated probe and the host share one grammar and every frame can be tested round trip.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import Protocol

from drivers.events import Command, Damaged, InstrumentEvent


class Dialect(Protocol):
    """The grammar of one instrument. Stateless: framing works on a buffer that the caller owns."""

    @property
    def name(self) -> str:
        """The file's name."""

    @property
    def protocol_version(self) -> int:
        """The version that is spoken; another one in Hello is refused by the connection."""

    def take(self, buffer: bytearray) -> bytes | Damaged | None:
        """Remove one frame from the front of `buffer`, or bytes that cannot belong to one.

        None: more bytes are needed; `buffer` then holds less than one longest frame. What comes
        out does not depend on how the bytes were cut into pieces on their way.
        """

    def encode_command(self, command: Command, number: int) -> bytes:
        """Bytes of one command; `number` lets an answer name it and a repeat be told apart.

        Raises LocalProtocolError for a value that the wire cannot carry.
        """

    def decode_event(self, frame: bytes) -> tuple[InstrumentEvent, int | None]:
        """One frame of the instrument, and the number of the command that it answers, if any.

        Raises RemoteProtocolError, and nothing else, for every frame that is not valid.
        """

    def decode_command(self, frame: bytes) -> tuple[Command, int | None]:
        """Be the instrument's side of `encode_command`. Raises RemoteProtocolError."""

    def encode_event(self, event: InstrumentEvent, number: int | None = None) -> bytes:
        """Be the instrument's side of `decode_event`. Raises LocalProtocolError."""


def dialect_names() -> tuple[str, ...]:
    """Names of all dialects in this folder, sorted."""
    return tuple(
        sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_"))
    )


def get_dialect(name: str) -> Dialect:
    """Get the dialect called `name`; an error while importing it comes through.

    Raises ValueError if there is none.
    """
    if name not in dialect_names():
        raise ValueError(f"no dialect {name!r}; known: {', '.join(dialect_names())}")
    dialect: Dialect = importlib.import_module(f"{__name__}.{name}").DIALECT
    return dialect
