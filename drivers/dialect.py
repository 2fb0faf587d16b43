"""What a dialect is: the grammar of one instrument; see `drivers/dialects/`."""

from __future__ import annotations

from typing import Protocol

from drivers.capabilities import Capabilities
from drivers.events import Command, Damaged, InstrumentEvent


class Dialect(Protocol):
    """The grammar of one instrument. Stateless: framing works on a buffer that the caller owns."""

    @property
    def name(self) -> str:
        """How it is called: the name of its file, or of its entry point."""

    @property
    def protocol_version(self) -> int:
        """The version that is spoken; another one in Hello is refused by the connection."""

    @property
    def capabilities(self) -> Capabilities:
        """What the instrument can be asked for.

        Where it is not controllable, a `stream` (drivers.capabilities.Stream) says how its readings
        become runs; without one the usual rule holds.
        """

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
