"""Rules of dialects."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from drivers.connection import Connection
from drivers.dialect import Dialect
from drivers.dialects import GROUP, check_dialect
from drivers.errors import LocalProtocolError, RemoteProtocolError
from drivers.events import (
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
    Refused,
    Reset,
    Sample,
    Segment,
    SegmentKind,
    Start,
    State,
    Vent,
)
from drivers.stream import StreamConnection
from skinlab.extensions.rules import Kind, expect, first_line
from skinlab.plugins import Registry, needs

_NUMBER = 513  # of a command
_LONGEST = 1 << 16  # bytes; a dialect that needs more for one frame is none

_PROGRAM = (
    Segment(SegmentKind.RAMP, target_mbar=123.456, rate_mbar_per_s=0.001),
    Segment(SegmentKind.HOLD, duration_s=1.000001),
    Segment(SegmentKind.RELEASE),
    Segment(SegmentKind.REST, duration_s=3600.0),
)
_COMMANDS: tuple[Command, ...] = (
    Identify(),
    Load(_PROGRAM, 33.333, 123.456, 59.999999),
    Load((Segment(SegmentKind.RELEASE),) * 128, 1.0, 0.0, 0.0),
    Arm(),
    Start(),
    Vent(),
    KeepAlive(),
    Reset(),
)
_TEXTS = ("", "plain", "a, b * c $ d % e", "µ ☹ \n\x00", " ")
_EVENTS: tuple[InstrumentEvent, ...] = (
    Loaded(_PROGRAM, 33.333, 123.456, 59.999999),
    Pace(2.5),
    *(State(state, "why", p) for state in InstrumentState for p in (None, -0.3, 5.0)),
    *(State(InstrumentState.IDLE, text, 0.0) for text in _TEXTS),
    *(InstrumentFault(text, text) for text in _TEXTS),
    *(Refused(text, text) for text in _TEXTS),
    Sample(0, 0.0, 0.0, 0.0, 0),
    Sample(123456, 61.000001, -0.201, -0.000001, 128),
    Sample(1, 0.05, 500.1, 3.141592, 2),
)
_NONSENSE = (b"", b"\r\n", b"$*\r\n", bytes(range(256)), b"x" * 10_000)
_NOISE = (b"\x00\xff\x80", b"\r\n\r\n", b" half a line", b"$S,1,2", b"*1234\r\n", bytes(range(256)))


def _hello(dialect: Dialect) -> Hello:
    return Hello(
        dialect.name, dialect.protocol_version, "a model", "1.2,3", "№ 7", 6.0, 499.5, 60.0,
        0.5, 1000.0, False, 20.0,
    )  # fmt: skip


def _single(dialect: Dialect, data: bytes) -> bytes:
    """Return the one frame that the data are."""
    buffer = bytearray(data)
    frame = dialect.take(buffer)
    expect(frame == data and not buffer, f"what it encodes is not one frame: {data!r}")
    return data


def _taken(dialect: Dialect, pieces: Sequence[bytes]) -> list[bytes | Damaged]:
    buffer = bytearray()
    out: list[bytes | Damaged] = []
    for piece in pieces:
        buffer += piece
        while (item := dialect.take(buffer)) is not None:
            out.append(item)
    whole = b"".join(i.data if isinstance(i, Damaged) else i for i in out) + buffer
    expect(whole == b"".join(pieces), "bytes are lost, or made, on their way through take")
    return out


def _cut(data: bytes, size: int) -> list[bytes]:
    return [data[k : k + size] for k in range(0, len(data), size)]


def _commands(dialect: Dialect) -> Sequence[Command]:
    """Return what the instrument can be told."""
    if _controls(dialect):
        return _COMMANDS
    can = dialect.capabilities
    return (*([Vent()] if can.vent else ()), *([KeepAlive()] if can.keep_alive else ()))


def nothing_begins_suction_unless_declared(dialect: Dialect) -> None:
    """An instrument that is for reading only cannot be started through a connection."""
    if _controls(dialect):
        return
    connection = StreamConnection(dialect)
    for command in (*_COMMANDS[1:5], Reset()):
        _raises(LocalProtocolError, connection.send, command)
    for command in (Vent(), KeepAlive()):
        if command not in _commands(dialect):
            _raises(LocalProtocolError, connection.send, command)


def _controls(dialect: Dialect) -> bool:
    """Whether it declares an instrument that runs programs; else it is for reading only."""
    return dialect.capabilities.controllable


def it_says_who_it_is(dialect: Dialect) -> None:
    """It has a name and a version, and the reference dialect's methods."""
    expect(dialect.name.isidentifier(), f"the name {dialect.name!r} is not a file name")
    expect(dialect.protocol_version >= 1, "protocol_version is below 1")


def commands_round_trip(dialect: Dialect) -> None:
    """Every command that it declares is one frame, and comes back from it."""
    for command in _commands(dialect):
        frame = dialect.encode_command(command, _NUMBER)
        if _controls(dialect):
            _single(dialect, frame)
        decoded, number = dialect.decode_command(frame)
        expect(decoded == command, f"{command} comes back as {decoded}")
        expect(number in (None, _NUMBER), f"the number {_NUMBER} comes back as {number}")


def events_round_trip(dialect: Dialect) -> None:
    """Every event is one frame, and comes back from it."""
    if not _controls(dialect):
        return
    for event in (*_EVENTS, _hello(dialect)):
        frame = _single(dialect, dialect.encode_event(event, _NUMBER))
        decoded, number = dialect.decode_event(frame)
        expect(decoded == event, f"{event} comes back as {decoded}")
        expect(number in (None, _NUMBER), f"the number {_NUMBER} comes back as {number}")


def samples_are_exact(dialect: Dialect) -> None:
    """Samples come back to the last digit: time to a µs, pressure to a µbar, deflection to a nm."""
    if not _controls(dialect):
        return
    rng = np.random.default_rng(0)
    for count, time, pressure, deflection, segment in rng.integers(
        (0, 0, -(10**6), -(10**8), 0), (10**6, 10**6, 10**6, 10**8, 128), (300, 5)
    ).tolist():
        sample = Sample(count, time / 1e6, pressure / 1000, deflection / 1_000_000, segment)
        decoded = dialect.decode_event(dialect.encode_event(sample))[0]
        expect(decoded == sample, f"{sample} comes back as {decoded}")


def rounding_is_once(dialect: Dialect) -> None:
    """What was rounded for the wire once stays as it is, so that a read-back can be compared."""
    if not _controls(dialect):
        return
    ramp = Segment(SegmentKind.RAMP, target_mbar=100 / 3, rate_mbar_per_s=20 / 3)
    once, _ = dialect.decode_command(
        dialect.encode_command(Load((ramp,), 100 / 3, 100 / 3, math.pi), 0)
    )
    twice, _ = dialect.decode_command(dialect.encode_command(once, 0))
    expect(once == twice, f"{once} is rounded again, to {twice}")
    near = isinstance(once, Load) and abs(once.rate_hz - 100 / 3) < 2e-3
    expect(near, f"a rate of {100 / 3} Hz comes back in {once}")


def what_cannot_be_carried_is_refused(dialect: Dialect) -> None:
    """What the wire cannot carry raises LocalProtocolError."""
    if not _controls(dialect):
        return
    for bad in (math.nan, math.inf, 1e300, -1.0):
        load = Load(_PROGRAM, bad, 1.0, 1.0)
        _raises(LocalProtocolError, dialect.encode_command, load, 0)


def the_other_side_is_blamed_for_nonsense(dialect: Dialect) -> None:
    """A frame that is not valid raises RemoteProtocolError, and nothing else."""
    rng = np.random.default_rng(1)
    spoilt = []
    for event in _EVENTS if _controls(dialect) else ():
        frame = bytearray(dialect.encode_event(event, _NUMBER))
        frame[int(rng.integers(len(frame)))] ^= 1 << int(rng.integers(8))
        spoilt.append(bytes(frame))
    for nonsense in _NONSENSE:
        _raises(RemoteProtocolError, dialect.decode_event, nonsense)
        _raises(RemoteProtocolError, dialect.decode_command, nonsense)
    for damaged in spoilt:
        for decode in (dialect.decode_event, dialect.decode_command):
            with contextlib.suppress(RemoteProtocolError):
                decode(damaged)


def _raises(error: type[Exception], call: Callable[..., Any], *arguments: Any) -> None:
    try:
        call(*arguments)
    except error:
        return
    expect(False, f"{repr(arguments[0])[:60]} does not raise {error.__name__}")


def pieces_do_not_matter(dialect: Dialect) -> None:
    """Frames do not depend on how the bytes were cut on their way."""
    rng = np.random.default_rng(2)
    for _ in range(30):
        parts = [
            rng.bytes(int(rng.integers(30)))
            if rng.random() < 0.4 or not _controls(dialect)
            else dialect.encode_event(_EVENTS[int(rng.integers(len(_EVENTS)))], 1)
            for _ in range(int(rng.integers(15)))
        ]
        data = b"".join(parts)
        whole = _taken(dialect, [data])
        for size in (1, 5):
            expect(_taken(dialect, _cut(data, size)) == whole, "pieces give other frames")


def noise_costs_no_frame(dialect: Dialect) -> None:
    """Noise between frames costs no frame that is whole."""
    if not _controls(dialect):
        return
    for noise in _NOISE:
        data = noise + b"".join(dialect.encode_event(e, 0) + noise for e in _EVENTS)
        frames = [f for f in _taken(dialect, [data]) if isinstance(f, bytes)]
        heard = []
        for frame in frames:
            with contextlib.suppress(RemoteProtocolError):
                heard.append(dialect.decode_event(frame)[0])
        expect(heard == list(_EVENTS), f"with {noise[:20]!r} between them, frames are lost")


def a_stream_without_an_end_does_not_grow(dialect: Dialect) -> None:
    """A stream without an end does not fill the memory."""
    for byte in (b"\x00", b"$", b"\xff", b"A", b"\n", b"\x02", b"{"):
        buffer = bytearray()
        for _ in range(100):
            buffer += byte * 1000
            while dialect.take(buffer) is not None:
                pass
            expect(len(buffer) <= _LONGEST, f"{byte!r} again and again is kept without an end")


def a_connection_speaks_it(dialect: Dialect) -> None:
    """A connection speaks it."""
    if not _controls(dialect):
        _a_stream_is_read(dialect)
        return
    connection = Connection(dialect)
    expect(connection.send(Identify()), "Identify is not bytes")
    idle = State(InstrumentState.IDLE, "", 0.0)
    for event in (_hello(dialect), idle):
        connection.receive_data(dialect.encode_event(event))
    heard = [connection.next_event() for _ in range(3)]
    expect(heard == [_hello(dialect), idle, None], f"it hears {heard}")


def _a_stream_is_read(dialect: Dialect) -> None:
    connection = StreamConnection(dialect)
    expect(connection.send(Identify()) == b"", "an instrument that only streams is asked nothing")
    heard = [connection.next_event() for _ in range(3)]
    expect(
        isinstance(heard[0], Hello) and isinstance(heard[1], State) and heard[2] is None,
        f"it begins with {heard}",
    )


def _check(one: object) -> None:
    needs(one, "protocol_version", "capabilities")
    check_dialect(one)


def _row(dialect: Dialect) -> tuple[str, ...]:
    can = "runs programs" if _controls(dialect) else "is read only"
    return f"`{dialect.name}`", str(dialect.protocol_version), can, first_line(dialect)


KIND: Kind[Dialect] = Kind(
    Registry("dialect", "drivers.dialects", "DIALECT", GROUP, _check),
    (
        it_says_who_it_is,
        nothing_begins_suction_unless_declared,
        commands_round_trip,
        events_round_trip,
        samples_are_exact,
        rounding_is_once,
        what_cannot_be_carried_is_refused,
        the_other_side_is_blamed_for_nonsense,
        pieces_do_not_matter,
        noise_costs_no_frame,
        a_stream_without_an_end_does_not_grow,
        a_connection_speaks_it,
    ),
    ("name", "version", "its instrument", "what it is"),
    _row,
)
