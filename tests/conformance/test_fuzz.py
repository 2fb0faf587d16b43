"""Whatever bytes come: events or the one protocol error, in every dialect of the folder.

`make soak` does a million inputs and saves what it counted; here is a slice of them.
"""

from __future__ import annotations

import json
import random
import sys
import time
from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.connection import Connection
from drivers.dialects import dialect_names, get_dialect
from drivers.errors import RemoteProtocolError
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
    Refused,
    Reset,
    Sample,
    Segment,
    SegmentKind,
    Start,
    State,
    Vent,
)
from drivers.incoming import MAX_BACKLOG_BYTES

RESULTS = Path(__file__).parents[2] / "benchmarks" / "results" / "fuzz.json"
SLICE = 50_000
MILLION = 1_000_000
LONGEST_FRAME = 1 << 16  # a dialect that needs more than this for one frame is none

PROGRAM = (
    Segment(SegmentKind.RAMP, target_mbar=100, rate_mbar_per_s=20),
    Segment(SegmentKind.HOLD, duration_s=1),
    Segment(SegmentKind.RELEASE),
    Segment(SegmentKind.REST, duration_s=2),
)
COMMANDS = [
    Identify(), Load(PROGRAM, 20, 100, 30), Arm(), Start(), Vent(), KeepAlive(), Reset(),
]  # fmt: skip


def hello(dialect):
    return Hello(
        dialect.name, dialect.protocol_version, "a model", "1.2", "7", 6.0, 500.0, 60.0,
        1.0, 1000.0, True, 20.0,
    )  # fmt: skip


def run(dialect, samples=20):
    """One run as an instrument tells it."""
    S = InstrumentState
    return [
        hello(dialect),
        State(S.IDLE, "identify", 0.0),
        Loaded(PROGRAM, 20, 100, 30),
        State(S.LOADED, "loaded", 0.0),
        State(S.ARMED, "armed", 0.0),
        State(S.RUNNING, "started", 0.0),
        *[Sample(k, k / 20, 2.0 * k, 0.01 * k, k // 10) for k in range(samples)],
        InstrumentFault("pressure", "123 mbar"),
        State(S.FAULT, "pressure", 120.0),
        State(S.FAULT, "vented", 1.5),
        State(S.IDLE, "reset", 0.0),
    ]


def frames(dialect):
    everything = [*run(dialect), Refused("Load", "rate 5000 Hz")]
    return [dialect.encode_event(event, 0) for event in everything]


def heard(connection, pieces):
    """All events; a protocol error counts as one."""
    out = []
    for piece in pieces:
        try:
            connection.receive_data(piece)
        except RemoteProtocolError as error:
            out.append(error)
        while True:
            try:
                event = connection.next_event()
            except RemoteProtocolError as error:
                out.append(error)
                continue
            if event is None:
                break
            out.append(event)
    return out


@pytest.fixture(params=dialect_names())
def dialect(request):
    return get_dialect(request.param)


# ---- the same events, however they come ----------------------------------------------------------

NOISE = [b"\x00\xff\x80", b"\r\n\r\n", b" half a line", b"$S,1,2", b"*1234\r\n", bytes(range(256))]


def test_whole_byte_by_byte_and_in_pieces(dialect):
    data = b"".join(dialect.encode_event(event, 0) for event in run(dialect))
    cuts = [0, *range(7, len(data), 13), len(data)]
    for pieces in (
        [data],
        [bytes([byte]) for byte in data],
        [data[a:b] for a, b in pairwise(cuts)],
        [data[:100], data[100:]],
    ):
        assert heard(Connection(dialect), pieces) == run(dialect)


@pytest.mark.parametrize("noise", NOISE)
def test_noise_around_it_changes_no_event(dialect, noise):
    """Noise costs no frame that is whole; where it comes between two, both are heard."""
    pieces = [noise]
    for event in run(dialect):
        pieces += [dialect.encode_event(event, 0), noise]
    good = [e for e in heard(Connection(dialect), pieces) if not isinstance(e, Damaged)]
    assert good == run(dialect)
    together = heard(Connection(dialect), [b"".join(pieces)])
    assert [e for e in together if not isinstance(e, Damaged)] == run(dialect)


# ---- any bytes at all ----------------------------------------------------------------------------


def payload_of(dialect, frame):
    """What of a frame its checksum is over; the dialect's `seal` puts it back into one."""
    return next(
        frame[a:b]
        for a in range(len(frame))
        for b in range(len(frame), a, -1)
        if dialect.seal(frame[a:b]) == frame
    )


def sealed(dialect, rng, payloads):
    """Mutate within a frame and make its checksum right again, where the dialect says how."""
    return dialect.seal(mutated(dialect, rng, payloads))


def ways(dialect, valid):
    """Ways to spoil these frames."""
    found = [(mutated, valid)]
    if hasattr(dialect, "seal"):
        found.append((sealed, [payload_of(dialect, frame) for frame in valid]))
    return found


def mutated(dialect, rng, valid):
    """One input: bytes that were valid once, or never were."""
    kind = rng.random()
    if kind < 0.15:
        return rng.randbytes(rng.randrange(60))
    data = bytearray(rng.choice(valid))
    if kind < 0.25:
        data += rng.choice(valid)  # two at once, both good
        return bytes(data)
    for _ in range(rng.choice((1, 1, 1, 2, 5))):
        at = rng.randrange(len(data)) if data else 0
        what = rng.randrange(7)
        if what == 0:
            data[at : at + 1] = bytes([rng.randrange(256)])
        elif what == 1:
            del data[at : at + rng.choice((1, 1, 3, 20))]
        elif what == 2:
            data[at:at] = data[at : at + rng.choice((1, 3, 20))]
        elif what == 3:
            data[at:at] = rng.randbytes(rng.choice((1, 2, 8)))
        elif what == 4 and data:
            data[at] ^= 1 << rng.randrange(8)
        elif what == 5:
            data[at:at] = rng.choice((b"-", b",", b"9" * 30, b"%ZZ", b"$", b"*", b"\n", b"\x00"))
        else:
            del data[at:]
    return bytes(data)


def fuzz(dialect, seed, inputs):
    """Feed so many inputs to both sides of a dialect; count what came out. Raises what is wrong."""
    rng = random.Random(seed)
    from_instrument = ways(dialect, frames(dialect))
    from_host = ways(dialect, [dialect.encode_command(command, 3) for command in COMMANDS])
    connection = Connection(dialect)
    device_buffer = bytearray()
    counts = Counter()
    for number in range(inputs):
        if number % 1000 == 0:
            connection = Connection(dialect)  # a new conversation now and then
        to_device = number % 4 == 3
        spoil, valid = rng.choice(from_host if to_device else from_instrument)
        data = spoil(dialect, rng, valid)
        counts["bytes"] += len(data)
        if to_device:
            device_buffer += data
            while (taken := dialect.take(device_buffer)) is not None:
                try:
                    said = dialect.decode_command(taken)[0] if isinstance(taken, bytes) else taken
                except RemoteProtocolError as error:
                    said = error
                counts[f"host: {type(said).__name__}"] += 1
            assert len(device_buffer) < LONGEST_FRAME
        else:
            for event in heard(connection, [data]):
                counts[f"instrument: {type(event).__name__}"] += 1
            assert connection.backlog_bytes < LONGEST_FRAME
            assert connection.next_event() is None
    return dict(sorted(counts.items()))


def test_a_slice_of_the_million(dialect):
    counts = fuzz(dialect, 1, SLICE)
    assert counts["instrument: Sample"] > SLICE // 100  # the good ones among them are heard
    assert counts["instrument: Damaged"] > SLICE // 10
    assert counts["instrument: RemoteProtocolError"] > SLICE // 1000
    assert {f"host: {type(command).__name__}" for command in COMMANDS} <= set(counts)


@pytest.mark.soak
def test_the_million():
    result = {"command": "make soak", "inputs": MILLION, "python": sys.version.split()[0]}
    for name in dialect_names():
        begin = time.monotonic()
        counts = fuzz(get_dialect(name), 2, MILLION)
        result[name] = {"counts": counts, "seconds": round(time.monotonic() - begin, 1)}
    RESULTS.write_text(json.dumps(result, indent=1) + "\n")


anything = st.lists(
    st.one_of(
        st.binary(max_size=80),
        st.integers(0, 10**6),  # the seed of a spoilt frame
    ),
    max_size=12,
)


@given(parts=anything, seed=st.integers(0, 10**6))
@settings(max_examples=150, deadline=None)
def test_any_bytes_in_any_pieces_give_the_same(parts, seed):
    for name in dialect_names():
        dialect = get_dialect(name)
        spoilers = ways(dialect, frames(dialect))
        data = b""
        for part in parts:
            if isinstance(part, bytes):
                data += part
            else:
                spoil, valid = spoilers[part % len(spoilers)]
                data += spoil(dialect, random.Random(part), valid)
        rng = random.Random(seed)
        cuts = sorted(rng.randrange(len(data) + 1) for _ in range(rng.randrange(10)))
        pieces = [data[a:b] for a, b in pairwise([0, *cuts, len(data)])]
        whole = heard(Connection(dialect), [data])
        assert [repr(e) for e in heard(Connection(dialect), pieces)] == [repr(e) for e in whole]


def test_the_backlog_is_bounded(dialect):
    connection = Connection(dialect)
    frame = dialect.encode_event(Sample(0, 0.0, 0.0, 0.0, 0))
    connection.receive_data(frame * (MAX_BACKLOG_BYTES // len(frame)))
    with pytest.raises(RemoteProtocolError, match="at once"):
        connection.receive_data(frame * 2)
    assert connection.next_event() is None
    connection.receive_data(frame)
    assert connection.next_event() == Sample(0, 0.0, 0.0, 0.0, 0)


@pytest.mark.parametrize("byte", [b"\x00", b"$", b"\xff", b"A", b"\n"])
def test_a_stream_without_an_end_does_not_grow(dialect, byte):
    connection = Connection(dialect)
    for _ in range(60):
        out = heard(connection, [byte * 1000])
        assert all(isinstance(event, Damaged | RemoteProtocolError) for event in out)
        assert connection.backlog_bytes < LONGEST_FRAME
