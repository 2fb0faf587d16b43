"""A dialect of lines: STX, a JSON object with all that is said, its CRC-32, a line feed."""

from __future__ import annotations

import math
import zlib
from typing import Any

import msgspec

from drivers.capabilities import CONTROLLABLE
from drivers.errors import LocalProtocolError, RemoteProtocolError
from drivers.events import Command, Damaged, InstrumentEvent

_BEGIN, _END = b"\x02", b"\n"  # neither can be within JSON that is written on one line
_LONGEST = 32_768
_MOST = 1e9  # of any number
_CRC = 8  # hexadecimal digits

_COMMANDS = {kind.__name__: kind for kind in Command.__args__}
_EVENTS = {kind.__name__: kind for kind in InstrumentEvent.__args__}


class JsonLines:
    """Both sides of a line dialect, an example."""

    name = "json_lines"
    protocol_version = 1
    capabilities = CONTROLLABLE  # it loads, reads back, is kept alive and vents

    def take(self, buffer: bytearray) -> bytes | Damaged | None:
        """Remove one frame, or what cannot belong to one; see drivers.dialects.Dialect.

        A piece ends behind a line feed or before an STX, whichever comes first.
        """
        ends = [end for end in (buffer.find(_BEGIN, 1), buffer.find(_END) + 1) if end > 0]
        end = min([*ends, _LONGEST])
        if len(buffer) < end:
            return None
        piece = bytes(buffer[:end])
        del buffer[:end]
        if piece.startswith(_BEGIN) and piece.endswith(_END):
            return piece
        return Damaged("no line", piece)

    def encode_command(self, command: Command, number: int) -> bytes:
        """Return the line; negative, infinite or huge numbers have none."""
        for value in _numbers(msgspec.to_builtins(command)):
            if not 0 <= value <= _MOST:
                raise LocalProtocolError(f"{value} cannot be carried")
        return self._line(command, number)

    def decode_event(self, frame: bytes) -> tuple[InstrumentEvent, int | None]:
        """Return what the instrument says."""
        return self._said(frame, _EVENTS)

    def decode_command(self, frame: bytes) -> tuple[Command, int | None]:
        """Return what the host says."""
        return self._said(frame, _COMMANDS)

    def encode_event(self, event: InstrumentEvent, number: int | None = None) -> bytes:
        """Return the line."""
        if not all(math.isfinite(value) for value in _numbers(msgspec.to_builtins(event))):
            raise LocalProtocolError(f"{event} cannot be carried")
        return self._line(event, number)

    @staticmethod
    def _line(said: Any, number: int | None) -> bytes:
        text = msgspec.json.encode([type(said).__name__, number, said])
        line = _BEGIN + text + b"%08x" % zlib.crc32(text) + _END
        if len(line) > _LONGEST:
            raise LocalProtocolError(f"{len(line)} bytes are more than a line holds")
        return line

    @staticmethod
    def _said(frame: bytes, kinds: dict[str, Any]) -> tuple[Any, int | None]:
        text, crc = frame[1 : -1 - _CRC], frame[-1 - _CRC : -1]
        if frame[:1] != _BEGIN or frame[-1:] != _END or b"%08x" % zlib.crc32(text) != crc:
            raise RemoteProtocolError("no line with its checksum")
        try:
            kind, number, said = msgspec.json.decode(text, type=tuple[str, int | None, dict])
            return msgspec.convert(said, kinds[kind]), number
        except (msgspec.MsgspecError, KeyError) as error:
            raise RemoteProtocolError(f"not understood: {error}") from None


def _numbers(said: Any) -> list[float]:
    """Return all numbers in what is said."""
    if isinstance(said, dict):
        said = list(said.values())
    if isinstance(said, list | tuple):
        return [number for one in said for number in _numbers(one)]
    return [said] if isinstance(said, int | float) and not isinstance(said, bool) else []


DIALECT = JsonLines()
