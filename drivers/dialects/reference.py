"""The `reference` dialect: open, ASCII, one check-summed frame a line. Described in docs/wire.md.

Every number on the wire is a decimal integer in a small unit (µbar, nm, µs, mHz, µm), so that
firmware prints no fractions and text becomes a float in one correctly rounded division.
"""

from __future__ import annotations

import binascii
import math
import re
from collections.abc import Sequence
from typing import assert_never
from urllib.parse import unquote_to_bytes

from drivers.capabilities import CONTROLLABLE
from drivers.errors import LimitError, LocalProtocolError, RemoteProtocolError
from drivers.events import (
    Abilities,
    Arm,
    Command,
    Damaged,
    Hello,
    Identify,
    InstrumentEvent,
    InstrumentFault,
    InstrumentState,
    KeepAlive,
    Load,
    Loaded,
    Pace,
    Reading,
    Refused,
    Reset,
    Sample,
    Segment,
    SegmentKind,
    Start,
    State,
    Vent,
)

PROTOCOL_VERSION = 1
MAX_FRAME_BYTES = 4096  # `$` and line end included; only LOAD and LOADED come near it
MAX_SEGMENTS = 128
MAX_TEXT_BYTES = 240  # of one text field, escaped
MAX_NUMBER = 65_535  # of a command
MAX_PACE = 1000.0  # of a simulated instrument

_MILLI = 1_000  # mbar -> µbar, Hz -> mHz, mm -> µm
_MICRO = 1_000_000  # s -> µs, mm -> nm
_LARGEST = 999_999_999_999  # twelve digits

_FRAME = re.compile(rb"\$([ -#%-)+-~]*)\*([0-9A-F]{4})\r\n")
_INTEGER = re.compile(r"0|-?[1-9][0-9]{0,11}")
_TEXT = re.compile(r"(?:[ -#&-)+\--~]|%[0-9A-F]{2})*")
_PLAIN = frozenset(range(0x20, 0x7F)) - frozenset(b"$%*,")

_BARE: dict[str, type[Identify | Vent | KeepAlive]] = {
    "ID": Identify,
    "VENT": Vent,
    "KEEP": KeepAlive,
}
_NUMBERED: dict[str, type[Arm | Start | Reset]] = {"ARM": Arm, "START": Start, "RESET": Reset}
_WORDS = {kind: word for word, kind in (*_BARE.items(), *_NUMBERED.items())}

_HELLO_FIELDS = 11


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, nothing reflected, no final xor.

    >>> hex(crc16(b"123456789"))
    '0x29b1'
    """
    return binascii.crc_hqx(data, 0xFFFF)


class Reference:
    """Both sides of the `reference` dialect, version 1."""

    name = "reference"
    protocol_version = PROTOCOL_VERSION
    capabilities = CONTROLLABLE

    def take(self, buffer: bytearray) -> bytes | Damaged | None:
        """See `Dialect.take`: a frame runs from `$` to the line feed, and reading restarts at `$`.

        Only the first MAX_FRAME_BYTES are looked at, whatever else has come already: so the
        outcome is the same for bytes that come alone and bytes that come together.
        """
        if not buffer:
            return None
        if buffer[0] != ord("$"):
            start = buffer.find(b"$", 0, MAX_FRAME_BYTES)
            return _drop(buffer, start, "bytes outside a frame")
        end = buffer.find(b"\n", 0, MAX_FRAME_BYTES)
        restart = buffer.find(b"$", 1, end if end >= 0 else MAX_FRAME_BYTES)
        if restart >= 0:
            return _drop(buffer, restart, "frame cut short by another")
        if end >= 0:
            frame = bytes(buffer[: end + 1])
            del buffer[: end + 1]
            return frame
        return _drop(buffer, -1, f"frame longer than {MAX_FRAME_BYTES} bytes")

    def seal(self, payload: bytes) -> bytes:
        """Put a payload into a frame, with its checksum; nothing is checked."""
        return b"$%b*%04X\r\n" % (payload, crc16(payload))

    def encode_command(self, command: Command, number: int) -> bytes:
        """See `Dialect.encode_command`."""
        match command:
            case Identify() | Vent() | KeepAlive():
                return _frame(_WORDS[type(command)])
            case Arm() | Start() | Reset():
                return _frame(_WORDS[type(command)], _number(number))
            case Load():
                return _frame("LOAD", _number(number), *_program(command))
            case _:
                assert_never(command)

    def decode_command(self, frame: bytes) -> tuple[Command, int | None]:
        """See `Dialect.decode_command`."""
        word, fields = _fields(frame)
        if word in _BARE:
            _count(word, fields, 0)
            return _BARE[word](), None
        if word in _NUMBERED:
            _count(word, fields, 1)
            return _NUMBERED[word](), _unnumber(fields[0])
        if word == "LOAD":
            number, segments, rate, pressure, suction = _unprogram(word, fields)
            return Load(segments, rate, pressure, suction), number
        raise RemoteProtocolError(f"unknown command {word!r}")

    def encode_event(self, event: InstrumentEvent, number: int | None = None) -> bytes:
        """See `Dialect.encode_event`; Loaded and Refused need the number of their command."""
        match event:
            case Sample():
                return _frame(
                    "S",
                    _int(event.sequence, 1, "sequence"),
                    _int(event.device_time_s, _MICRO, "device time"),
                    _int(event.pressure_mbar, _MILLI, "pressure", signed=True),
                    _int(event.deflection_mm, _MICRO, "deflection", signed=True),
                    _int(event.segment, 1, "segment"),
                )
            case State():
                pressure = event.pressure_mbar
                return _frame(
                    "STATE",
                    event.state.value,
                    "" if pressure is None else _int(pressure, _MILLI, "pressure", signed=True),
                    _text(event.reason),
                )
            case Loaded():
                return _frame("LOADED", _number(number), *_program(event))
            case Refused():
                return _frame("REFUSED", _number(number), _text(event.command), _text(event.reason))
            case InstrumentFault():
                return _frame("FAULT", _text(event.code), _text(event.text))
            case Hello():
                if event.aperture_mm is None:
                    raise LocalProtocolError("HELLO needs an aperture")
                return _frame(
                    "HELLO",
                    _int(event.protocol_version, 1, "protocol version"),
                    _text(event.model),
                    _text(event.firmware),
                    _text(event.serial_number),
                    _int(event.aperture_mm, _MILLI, "aperture"),
                    _int(event.max_pressure_mbar, _MILLI, "maximum pressure"),
                    _int(event.max_suction_s, _MICRO, "maximum suction time"),
                    _int(event.min_rate_hz, _MILLI, "lowest rate"),
                    _int(event.max_rate_hz, _MILLI, "highest rate"),
                    _int(event.default_rate_hz, _MILLI, "usual rate"),
                    "1" if event.simulated else "0",
                )
            case Pace():
                return _frame("PACE", _int(event.speed, _MILLI, "pace"))
            case Abilities():
                return _frame("CAN", *(["until"] if event.until else []))
            case Reading():
                raise LocalProtocolError("a reading outside of a run cannot be sent")
            case _:
                assert_never(event)

    def decode_event(self, frame: bytes) -> tuple[InstrumentEvent, int | None]:
        """See `Dialect.decode_event`."""
        word, fields = _fields(frame)
        match word:
            case "S":
                _count(word, fields, 5)
                return Sample(
                    sequence=_unint(fields[0]),
                    device_time_s=_unint(fields[1]) / _MICRO,
                    pressure_mbar=_unint(fields[2], signed=True) / _MILLI,
                    deflection_mm=_unint(fields[3], signed=True) / _MICRO,
                    segment=_unint(fields[4]),
                ), None
            case "STATE":
                _count(word, fields, 3)
                try:
                    state = InstrumentState(fields[0])
                except ValueError:
                    raise RemoteProtocolError(f"unknown state {fields[0]!r}") from None
                pressure = _unint(fields[1], signed=True) / _MILLI if fields[1] else None
                return State(state, _untext(fields[2]), pressure), None
            case "LOADED":
                number, segments, rate, maximum, suction = _unprogram(word, fields)
                return Loaded(segments, rate, maximum, suction), number
            case "REFUSED":
                _count(word, fields, 3)
                return Refused(_untext(fields[1]), _untext(fields[2])), _unnumber(fields[0])
            case "FAULT":
                _count(word, fields, 2)
                return InstrumentFault(_untext(fields[0]), _untext(fields[1])), None
            case "HELLO":
                return _hello(fields), None
            case "CAN":
                return Abilities(until="until" in fields), None
            case "PACE":
                _count(word, fields, 1)
                speed = _unint(fields[0]) / _MILLI
                if not 1 <= speed <= MAX_PACE:  # a slower one would win time
                    raise RemoteProtocolError(f"a pace of {speed:g} is outside 1 to {MAX_PACE:g}")
                return Pace(speed), None
            case _:
                raise RemoteProtocolError(f"unknown frame {word!r}")


DIALECT = Reference()


# ---- frames -----------------------------------------------------------------------------------


def _drop(buffer: bytearray, end: int, reason: str) -> Damaged | None:
    """Give up the bytes before `end`; with `end` unknown, wait until a longest frame is full."""
    if end < 0:
        if len(buffer) < MAX_FRAME_BYTES:
            return None
        end = MAX_FRAME_BYTES
    data = bytes(buffer[:end])
    del buffer[:end]
    return Damaged(reason, data)


def _frame(word: str, *fields: str) -> bytes:
    frame = DIALECT.seal(",".join((word, *fields)).encode("ascii"))
    if len(frame) > MAX_FRAME_BYTES:
        raise LocalProtocolError(f"{word} frame of {len(frame)} bytes; {MAX_FRAME_BYTES} fit")
    return frame


def _fields(frame: bytes) -> tuple[str, list[str]]:
    match = _FRAME.fullmatch(frame) if len(frame) <= MAX_FRAME_BYTES else None
    if match is None:
        raise RemoteProtocolError("not of the form $...*CRC")
    payload, checksum = match.groups()
    if int(checksum, 16) != crc16(payload):
        raise RemoteProtocolError(f"checksum {checksum.decode()}, not {crc16(payload):04X}")
    word, *fields = payload.decode("ascii").split(",")
    return word, fields


def _count(word: str, fields: Sequence[str], count: int) -> None:
    if len(fields) != count:
        raise RemoteProtocolError(f"{word} has {len(fields)} fields, not {count}")


# ---- fields -----------------------------------------------------------------------------------


def _int(value: float, scale: int, what: str, *, signed: bool = False) -> str:
    if not (math.isfinite(value) and abs(value) <= _LARGEST / scale):
        raise LocalProtocolError(f"{what} {value} cannot be sent")
    count = round(value * scale)
    if count < 0 and not signed:
        raise LocalProtocolError(f"{what} {value} cannot be sent: it is negative")
    return str(count)


def _unint(field: str, *, signed: bool = False) -> int:
    if not _INTEGER.fullmatch(field) or (field[0] == "-" and not signed):
        raise RemoteProtocolError(f"{field!r} is not a valid integer here")
    return int(field)


def _number(number: int | None) -> str:
    if number is None or not 0 <= number <= MAX_NUMBER:
        raise LocalProtocolError(f"command number {number} is outside 0 to {MAX_NUMBER}")
    return str(number)


def _unnumber(field: str) -> int:
    number = _unint(field)
    if number > MAX_NUMBER:
        raise RemoteProtocolError(f"command number {number} is above {MAX_NUMBER}")
    return number


def _text(text: str) -> str:
    try:
        raw = text.encode("utf-8")
    except UnicodeEncodeError as error:
        raise LocalProtocolError(f"text cannot be sent: {error}") from None
    field = "".join(chr(byte) if byte in _PLAIN else f"%{byte:02X}" for byte in raw)
    if len(field) > MAX_TEXT_BYTES:
        raise LocalProtocolError(f"text of {len(field)} bytes; {MAX_TEXT_BYTES} fit")
    return field


def _untext(field: str) -> str:
    if len(field) > MAX_TEXT_BYTES or not _TEXT.fullmatch(field):
        raise RemoteProtocolError(f"{field[:40]!r} is not valid text")
    try:
        return unquote_to_bytes(field).decode("utf-8")
    except UnicodeDecodeError:
        raise RemoteProtocolError(f"{field[:40]!r} is not UTF-8") from None


# ---- programs and Hello ------------------------------------------------------------------------


def _program(load: Load | Loaded) -> list[str]:
    if not 1 <= len(load.segments) <= MAX_SEGMENTS:
        raise LimitError(f"a program of {len(load.segments)} segments; 1 to {MAX_SEGMENTS} fit")
    return [
        _int(load.rate_hz, _MILLI, "sample rate"),
        _int(load.max_pressure_mbar, _MILLI, "maximum pressure"),
        _int(load.max_suction_s, _MICRO, "maximum suction time"),
        str(len(load.segments)),
        *(_segment(segment) for segment in load.segments),
    ]


def _segment(segment: Segment) -> str:
    match segment.kind:
        case SegmentKind.RAMP:
            target = _int(segment.target_mbar, _MILLI, "target")
            return f"R:{target}:{_int(segment.rate_mbar_per_s, _MILLI, 'ramp rate')}"
        case SegmentKind.UNTIL:
            height = _int(segment.height_mm, _MICRO, "height")
            rate = _int(segment.rate_mbar_per_s, _MILLI, "rate")
            return f"U:{height}:{rate}:{_int(segment.target_mbar, _MILLI, 'target')}"
        case SegmentKind.HOLD:
            return f"H:{_int(segment.duration_s, _MICRO, 'hold')}"
        case SegmentKind.RELEASE:
            return "V"
        case SegmentKind.REST:
            return f"Z:{_int(segment.duration_s, _MICRO, 'rest')}"
        case _:
            assert_never(segment.kind)


def _unprogram(
    word: str, fields: Sequence[str]
) -> tuple[int, tuple[Segment, ...], float, float, float]:
    if len(fields) < 5:
        raise RemoteProtocolError(f"{word} has {len(fields)} fields, fewer than 5")
    number = _unnumber(fields[0])
    rate, pressure, suction, count = (_unint(field) for field in fields[1:5])
    if not 1 <= count <= MAX_SEGMENTS or len(fields) != 5 + count:
        raise RemoteProtocolError(f"{word} says {count} segments and has {len(fields) - 5}")
    segments = tuple(_unsegment(field) for field in fields[5:])
    return number, segments, rate / _MILLI, pressure / _MILLI, suction / _MICRO


def _unsegment(field: str) -> Segment:
    match field.split(":"):
        case ["R", target, rate]:
            return Segment(
                SegmentKind.RAMP,
                target_mbar=_unint(target) / _MILLI,
                rate_mbar_per_s=_unint(rate) / _MILLI,
            )
        case ["U", height, rate, target]:
            return Segment(
                SegmentKind.UNTIL,
                target_mbar=_unint(target) / _MILLI,
                rate_mbar_per_s=_unint(rate) / _MILLI,
                height_mm=_unint(height) / _MICRO,
            )
        case ["H", duration]:
            return Segment(SegmentKind.HOLD, duration_s=_unint(duration) / _MICRO)
        case ["V"]:
            return Segment(SegmentKind.RELEASE)
        case ["Z", duration]:
            return Segment(SegmentKind.REST, duration_s=_unint(duration) / _MICRO)
        case _:
            raise RemoteProtocolError(f"{field[:40]!r} is not a segment")


def _hello(fields: Sequence[str]) -> Hello:
    if len(fields) < _HELLO_FIELDS:
        raise RemoteProtocolError(f"HELLO has {len(fields)} fields, not {_HELLO_FIELDS}")
    version = _unint(fields[0])
    if version == PROTOCOL_VERSION:
        # Another version may have more behind these; it is read so that it can be named and refused
        _count("HELLO", fields, _HELLO_FIELDS)
    model, firmware, serial_number = (_untext(field) for field in fields[1:4])
    aperture, pressure, suction, low, high, usual = (_unint(field) for field in fields[4:10])
    if fields[10] not in {"0", "1"}:
        raise RemoteProtocolError(f"{fields[10][:40]!r} is neither 0 nor 1")
    if not (min(aperture, pressure, suction) > 0 and 0 < low <= usual <= high):
        raise RemoteProtocolError("HELLO has limits that are empty")
    return Hello(
        dialect=Reference.name,
        protocol_version=version,
        model=model,
        firmware=firmware,
        serial_number=serial_number,
        aperture_mm=aperture / _MILLI,
        max_pressure_mbar=pressure / _MILLI,
        max_suction_s=suction / _MICRO,
        min_rate_hz=low / _MILLI,
        max_rate_hz=high / _MILLI,
        simulated=fields[10] == "1",
        default_rate_hz=usual / _MILLI,
    )
