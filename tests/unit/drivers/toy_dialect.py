"""The toy dialect of docs/dialects.md: what its steps end with. No instrument speaks it.

The toy instrument sends `N 7 P 12.5 D 0.130` and a line feed ten times a second while it runs. It
answers `OK GO` and `OK STOP` to the commands `GO` and `STOP`, and `TOY v3` to `?`.
"""

from __future__ import annotations

import re

from drivers.capabilities import Capabilities, Stream
from drivers.errors import LocalProtocolError, RemoteProtocolError
from drivers.events import (
    Command,
    Damaged,
    Hello,
    Identify,
    InstrumentEvent,
    InstrumentState,
    Sample,
    Start,
    State,
    Vent,
)

_LONGEST = 64
_SAMPLE = re.compile(rb"N ([0-9]{1,9}) P (-?[0-9]{1,4}\.[0-9]) D (-?[0-9]\.[0-9]{3})\n")
_COMMANDS: dict[type[Command], bytes] = {Identify: b"?\n", Start: b"GO\n", Vent: b"STOP\n"}
_HELLO = Hello("toy", 3, "toy", "3", "", 6.0, 300.0, 30.0, 10.0, 10.0, False, 10.0)


class Toy:
    """Both sides of the toy dialect."""

    name = "toy"
    protocol_version = 3
    capabilities = Capabilities(vent=True)  # it takes no program: it is read only
    stream = Stream(model="toy", aperture_mm=6.0)

    def take(self, buffer: bytearray) -> bytes | Damaged | None:
        """Frames end with a line feed; what is longer than any frame is damaged."""
        end = buffer.find(b"\n", 0, _LONGEST)
        if end < 0 and len(buffer) < _LONGEST:
            return None
        size = end + 1 if end >= 0 else _LONGEST
        data = bytes(buffer[:size])
        del buffer[:size]
        return data if end >= 0 else Damaged(f"no line feed in {_LONGEST} bytes", data)

    def decode_event(self, frame: bytes) -> tuple[InstrumentEvent, int | None]:
        """See `Dialect.decode_event`."""
        match = _SAMPLE.fullmatch(frame)
        if match:
            count = int(match[1])
            return Sample(count, count / 10, float(match[2]), float(match[3]), 0), None
        if frame == b"TOY v3\n":
            return _HELLO, None
        if frame == b"OK GO\n":
            return State(InstrumentState.RUNNING, "GO"), None
        if frame == b"OK STOP\n":
            return State(InstrumentState.VENTING, "STOP"), None
        raise _not_ours(frame)

    def decode_command(self, frame: bytes) -> tuple[Command, int | None]:
        """See `Dialect.decode_command`."""
        for kind, data in _COMMANDS.items():
            if frame == data:
                return kind(), None
        raise _not_ours(frame)

    def encode_command(self, command: Command, number: int) -> bytes:
        """See `Dialect.encode_command`."""
        if type(command) not in _COMMANDS:
            raise LocalProtocolError(f"the toy has no {type(command).__name__}")
        return _COMMANDS[type(command)]

    def encode_event(self, event: InstrumentEvent, number: int | None = None) -> bytes:
        """See `Dialect.encode_event`."""
        match event:
            case Sample():
                text = (
                    f"N {event.sequence} P {event.pressure_mbar:.1f} D {event.deflection_mm:.3f}\n"
                )
                return text.encode()
            case Hello():
                return b"TOY v3\n"
            case State(InstrumentState.RUNNING):
                return b"OK GO\n"
            case State(InstrumentState.VENTING):
                return b"OK STOP\n"
            case _:
                raise LocalProtocolError(f"the toy never says {event}")


def _not_ours(frame: bytes) -> RemoteProtocolError:
    return RemoteProtocolError(f"{frame[:40]!r} is no frame of the toy")


DIALECT = Toy()
