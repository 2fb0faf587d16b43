"""Every dialect in the folder, with no list of exceptions."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.connection import Connection
from drivers.dialects import dialect_names, get_dialect
from drivers.errors import LocalProtocolError, RemoteProtocolError
from drivers.events import (
    Arm,
    Damaged,
    Hello,
    Identify,
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


@pytest.fixture(params=dialect_names())
def dialect(request):
    return get_dialect(request.param)


PROGRAM = (
    Segment(SegmentKind.RAMP, target_mbar=123.456, rate_mbar_per_s=0.001),
    Segment(SegmentKind.HOLD, duration_s=1.000001),
    Segment(SegmentKind.RELEASE),
    Segment(SegmentKind.REST, duration_s=3600.0),
)
COMMANDS = [
    Identify(),
    Load(PROGRAM, 33.333, 123.456, 59.999999),
    Load((Segment(SegmentKind.RELEASE),) * 128, 1.0, 0.0, 0.0),
    Arm(),
    Start(),
    Vent(),
    KeepAlive(),
    Reset(),
]
TEXTS = ["", "plain", "a, b * c $ d % e", "µ ☹ \n\x00", " "]
EVENTS = [
    Loaded(PROGRAM, 33.333, 123.456, 59.999999),
    Pace(2.5),
    *[State(state, "why", pressure) for state in InstrumentState for pressure in (None, -0.3, 5.0)],
    *[State(InstrumentState.IDLE, text, 0.0) for text in TEXTS],
    *[InstrumentFault(text, text) for text in TEXTS],
    *[Refused(text, text) for text in TEXTS],
    Sample(0, 0.0, 0.0, 0.0, 0),
    Sample(123456, 61.000001, -0.201, -0.000001, 128),
    Sample(1, 0.05, 500.1, 3.141592, 2),
]


def hello(dialect):
    return Hello(
        dialect.name, dialect.protocol_version, "a model", "1.2,3", "№ 7", 6.0, 499.5, 60.0,
        0.5, 1000.0, False, 20.0,
    )  # fmt: skip


def single(dialect, data):
    """The one frame that `data` is."""
    buffer = bytearray(data)
    frame = dialect.take(buffer)
    assert frame == data
    assert not buffer
    return frame


def test_there_is_one():
    assert "reference" in dialect_names()


def test_it_says_who_it_is(dialect):
    assert dialect.name in dialect_names()
    assert get_dialect(dialect.name) is dialect
    assert dialect.protocol_version >= 1


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: type(c).__name__)
def test_commands_round_trip(dialect, command):
    frame = single(dialect, dialect.encode_command(command, 513))
    decoded, number = dialect.decode_command(frame)
    assert decoded == command
    assert number in {None, 513}


@pytest.mark.parametrize("event", EVENTS, ids=lambda e: type(e).__name__)
def test_events_round_trip(dialect, event):
    frame = single(dialect, dialect.encode_event(event, 513))
    decoded, number = dialect.decode_event(frame)
    assert decoded == event
    assert number in {None, 513}


def test_hello_round_trips(dialect):
    assert dialect.decode_event(dialect.encode_event(hello(dialect)))[0] == hello(dialect)


counts = st.integers(0, 10**6)


@given(
    st.builds(
        Sample,
        sequence=counts,
        device_time_s=counts.map(lambda n: n / 1_000_000),
        pressure_mbar=st.integers(-(10**6), 10**6).map(lambda n: n / 1000),
        deflection_mm=st.integers(-(10**8), 10**8).map(lambda n: n / 1_000_000),
        segment=st.integers(0, 128),
    )
)
@settings(max_examples=100)
def test_samples_are_exact(sample):
    for name in dialect_names():
        dialect = get_dialect(name)
        assert dialect.decode_event(dialect.encode_event(sample))[0] == sample


def test_encoding_is_a_fixed_point(dialect):
    """What was rounded for the wire once stays as it is: read-back can be compared exactly."""
    ramp = Segment(SegmentKind.RAMP, target_mbar=100 / 3, rate_mbar_per_s=20 / 3)
    load = Load((ramp,), 100 / 3, 100 / 3, math.pi)
    once, _ = dialect.decode_command(dialect.encode_command(load, 0))
    twice, _ = dialect.decode_command(dialect.encode_command(once, 0))
    assert once == twice
    assert once.rate_hz == pytest.approx(load.rate_hz, abs=1e-3)


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e300, -1.0])
def test_what_the_wire_cannot_carry_is_refused(dialect, bad):
    with pytest.raises(LocalProtocolError):
        dialect.encode_command(Load(PROGRAM, bad, 1.0, 1.0), 0)


def test_the_other_side_is_blamed_for_nonsense(dialect):
    for frame in (b"", b"\r\n", b"$*\r\n", bytes(range(256)), b"x" * 10_000):
        with pytest.raises(RemoteProtocolError):
            dialect.decode_event(frame)
        with pytest.raises(RemoteProtocolError):
            dialect.decode_command(frame)


@given(st.lists(st.one_of(st.binary(max_size=30), st.sampled_from(EVENTS)), max_size=15))
@settings(max_examples=60)
def test_framing_does_not_depend_on_the_pieces(parts):
    for name in dialect_names():
        dialect = get_dialect(name)
        data = b"".join(p if isinstance(p, bytes) else dialect.encode_event(p, 1) for p in parts)
        cuts = [0, *range(3, len(data), 5), len(data)]
        assert taken(dialect, [data]) == taken(dialect, [data[a:b] for a, b in pairwise(cuts)])


def taken(dialect, pieces):
    buffer = bytearray()
    out = []
    for piece in pieces:
        buffer += piece
        while (item := dialect.take(buffer)) is not None:
            out.append(item)
    whole = b"".join(i.data if isinstance(i, Damaged) else i for i in out) + buffer
    assert whole == b"".join(pieces)
    return out


def test_a_connection_speaks_it(dialect):
    connection = Connection(dialect)
    assert connection.send(Identify())
    connection.receive_data(dialect.encode_event(hello(dialect)))
    connection.receive_data(dialect.encode_event(State(InstrumentState.IDLE, "", 0.0)))
    assert connection.next_event() == hello(dialect)
    assert connection.next_event() == State(InstrumentState.IDLE, "", 0.0)
    assert connection.next_event() is None
