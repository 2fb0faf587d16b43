from __future__ import annotations

import random
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.connection import STATES, Connection
from drivers.dialects.reference import DIALECT, MAX_FRAME_BYTES
from drivers.errors import LocalProtocolError, RemoteProtocolError
from drivers.events import (
    Arm,
    Damaged,
    Gap,
    Hello,
    Identify,
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

S = InstrumentState
HELLO = Hello("reference", 1, "m", "f", "s", 6.0, 500.0, 60.0, 1.0, 1000.0, True)
RAMP = (Segment(SegmentKind.RAMP, target_mbar=100, rate_mbar_per_s=20),)
LOAD = Load(RAMP, 20, 100, 5)
COMMANDS = {
    Identify: Identify(),
    Load: LOAD,
    Arm: Arm(),
    Start: Start(),
    Vent: Vent(),
    KeepAlive: KeepAlive(),
    Reset: Reset(),
}


def encode(*events):
    return b"".join(DIALECT.encode_event(event, 0) for event in events)


def sample(sequence):
    return Sample(sequence, sequence / 20, sequence * 1.0, sequence * 0.01, 0)


CONVERSATION = (
    HELLO,
    State(S.IDLE, "identify", 0.0),
    Loaded(RAMP, 20, 100, 5),
    State(S.LOADED, "loaded", 0.1),
    State(S.ARMED, "armed", 0.1),
    State(S.RUNNING, "started", 0.1),
    *[sample(k) for k in range(20)],
    State(S.VENTING, "program end", 100.0),
    State(S.LOADED, "done", 1.0),
    Refused("Arm", "no"),
)


def drain(connection):
    events = []
    while True:
        try:
            event = connection.next_event()
        except RemoteProtocolError as error:
            events.append(str(error))
            continue
        if event is None:
            return events
        events.append(event)


def events_of(*pieces):
    connection = Connection(DIALECT)
    events = []
    for piece in pieces:
        connection.receive_data(piece)
        events += drain(connection)
    return events


def at(state):
    connection = Connection(DIALECT)
    if state is not None:
        connection.receive_data(encode(HELLO, State(state, "test", 0.0)))
        drain(connection)
    return connection


def test_a_run_whose_begin_was_lost_begins_with_its_first_sample():
    """Its samples were of no run: the curve began with the answer to a second START, or never."""
    lost = State(S.RUNNING, "started", 0.1)
    assert lost in CONVERSATION
    found = events_of(encode(*[event for event in CONVERSATION if event != lost]))
    told = State(S.RUNNING, "not said: samples came")
    assert found == [told if event == lost else event for event in CONVERSATION]
    # An answer that comes later changes nothing
    late = encode(*[e for e in CONVERSATION[:15] if e != lost], lost, *CONVERSATION[15:])
    assert [event for event in events_of(late) if event != lost] == found


def test_whole_and_byte_by_byte_and_in_any_pieces():
    data = encode(*CONVERSATION)
    assert events_of(data) == list(CONVERSATION)
    assert events_of(*[data[i : i + 1] for i in range(len(data))]) == list(CONVERSATION)
    rng = random.Random(0)
    for _ in range(20):
        cuts = [0, *sorted(rng.sample(range(len(data)), 30)), len(data)]
        assert events_of(*[data[a:b] for a, b in pairwise(cuts)]) == list(CONVERSATION)


@pytest.mark.parametrize(
    "noise",
    [b"\x00\xff", b"\r\n", b"$", b"$S,1", b"$S,1*0000\r\n", b"x" * 9999, b"$" + b"y" * 5000],
)
def test_noise_between_frames_is_reported_and_skipped(noise):
    frames = [encode(event) for event in CONVERSATION]
    data = noise + noise.join(frames)
    whole = events_of(data)
    assert [event for event in whole if not isinstance(event, Damaged)] == list(CONVERSATION)
    damaged = b"".join(event.data for event in whole if isinstance(event, Damaged))
    assert damaged == noise * len(frames)
    assert max(len(event.data) for event in whole if isinstance(event, Damaged)) <= MAX_FRAME_BYTES
    assert events_of(*[data[i : i + 7] for i in range(0, len(data), 7)]) == whole
    assert events_of(*[data[i : i + 1] for i in range(len(data))]) == whole


def test_every_flipped_bit_is_found():
    frame = encode(sample(3))
    for position in range(len(frame)):
        for bit in range(8):
            flipped = bytearray(frame)
            flipped[position] ^= 1 << bit
            events = events_of(bytes(flipped) + b"$")
            assert events
            assert all(isinstance(event, Damaged) for event in events)
            assert b"".join(event.data for event in events) == flipped


def test_a_jump_is_a_gap_and_a_repeat_is_dropped():
    connection = at(S.ARMED)
    connection.receive_data(encode(State(S.RUNNING, "", 0.0), *map(sample, (0, 1, 4, 4, 3, 5))))
    kinds = [type(event) for event in drain(connection)]
    assert kinds == [State, Sample, Sample, Gap, Sample, Damaged, Damaged, Sample]


def test_the_first_sample_that_is_missing_is_a_gap():
    connection = at(S.ARMED)
    connection.receive_data(encode(State(S.RUNNING, "", 0.0), sample(2)))
    assert Gap(0, 2) in drain(connection)


def test_joining_a_run_is_no_gap():
    connection = Connection(DIALECT)
    connection.receive_data(encode(sample(40), HELLO, State(S.RUNNING, "", 0.0), sample(41)))
    assert not any(isinstance(event, Gap) for event in drain(connection))


@pytest.mark.parametrize("state", [None, *S])
@pytest.mark.parametrize("kind", COMMANDS)
def test_commands_by_state(state, kind):
    connection = at(state)
    if kind in STATES[state].commands:
        assert connection.send(COMMANDS[kind])
    else:
        with pytest.raises(LocalProtocolError, match=kind.__name__):
            connection.send(COMMANDS[kind])


@pytest.mark.parametrize("before", S)
@pytest.mark.parametrize("after", S)
def test_state_changes(before, after):
    connection = at(before)
    connection.receive_data(encode(State(after, "test", 0.0)))
    if after is before or after in STATES[before].followers:
        assert connection.next_event() == State(after, "test", 0.0)
    else:
        with pytest.raises(RemoteProtocolError, match=f"{before} to {after}"):
            connection.next_event()
        assert connection.next_event() == State(after, "test", 0.0)
    assert connection.state is after
    assert connection.next_event() is None


def test_vent_is_legal_in_every_state():
    assert all(Vent in row.commands for row in STATES.values())
    assert set(STATES) == {None, *S}
    reachable = {follower for row in STATES.values() for follower in row.followers}
    assert reachable == set(S)
    assert all(S.VENTING in STATES[s].followers for s in S if s not in {S.VENTING, S.FAULT})


def test_limits_of_the_instrument_count_and_a_refused_load_takes_no_number():
    connection = at(S.IDLE)
    with pytest.raises(LocalProtocolError, match="501 mbar"):
        connection.send(Load(RAMP, 20, 501, 5))
    assert connection.send(LOAD).startswith(b"$LOAD,0,")
    assert connection.send(Reset()).startswith(b"$RESET,1*")
    assert connection.send(Vent()) == DIALECT.encode_command(Vent(), 0)


def test_read_back_of_an_older_program():
    connection = at(S.IDLE)
    connection.send(LOAD)
    connection.send(LOAD)
    connection.receive_data(DIALECT.encode_event(Loaded(RAMP, 20, 100, 5), 0))
    connection.receive_data(DIALECT.encode_event(Loaded(RAMP, 20, 100, 5), 1))
    assert [type(event) for event in drain(connection)] == [Damaged, Loaded]


def test_a_program_that_changes_in_a_run():
    connection = at(S.RUNNING)
    connection.receive_data(encode(Loaded(RAMP, 20, 100, 5)))
    with pytest.raises(RemoteProtocolError, match="changed its program"):
        connection.next_event()


def test_another_version_is_named():
    connection = Connection(DIALECT)
    newer = Hello("reference", 2, "m", "f", "s", 6.0, 500.0, 60.0, 1.0, 1000.0, True)
    connection.receive_data(encode(newer))
    with pytest.raises(RemoteProtocolError, match="version 2"):
        connection.next_event()
    assert connection.next_event() == newer
    assert connection.hello is None


def test_the_backlog_is_bounded():
    connection = Connection(DIALECT)
    with pytest.raises(RemoteProtocolError):
        connection.receive_data(b"x" * (MAX_BACKLOG_BYTES + 1))
    connection.receive_data(encode(HELLO))
    assert drain(connection) == [HELLO]


FRAMES = [encode(event) for event in CONVERSATION]


@given(st.lists(st.one_of(st.binary(max_size=40), st.sampled_from(FRAMES)), max_size=20))
@settings(max_examples=150)
def test_any_bytes_give_events_or_blame_the_instrument(pieces):
    events_of(*pieces)


@pytest.mark.long
def test_twenty_thousand_broken_conversations():
    rng = random.Random(20_000)
    alphabet = b"$*,:%-0123456789ABCDEFHRSTVZ\r\n"
    connection = Connection(DIALECT)
    for turn in range(20_000):
        data = bytearray(FRAMES[rng.randrange(len(FRAMES))])
        for _ in range(rng.randrange(4)):
            match rng.randrange(4):
                case 0 if data:
                    data[rng.randrange(len(data))] = rng.randrange(256)
                case 1:
                    data.insert(
                        rng.randrange(len(data) + 1), alphabet[rng.randrange(len(alphabet))]
                    )
                case 2 if data:
                    del data[rng.randrange(len(data))]
                case _:
                    data = bytearray(rng.choices(alphabet, k=rng.randrange(60)))
        if turn % 50 == 0:
            connection = Connection(DIALECT)
        connection.receive_data(bytes(data))
        drain(connection)
        # Past the checksum too: a frame that is whole and means nothing
        fields = rng.choices(["S", "STATE", "HELLO", "-0", "9" * 13, "", "idle", "R:1", "%ZZ"], k=6)
        payload = ",".join(fields).encode()
        connection.receive_data(frame(payload))
        drain(connection)


def frame(payload):
    from drivers.dialects.reference import crc16

    return b"$%b*%04X\r\n" % (payload, crc16(payload))


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"NOSUCH,1",
        b"S,1,2,3,4",
        b"S,1,2,3,4,5,6",
        b"S,01,2,3,4,5",
        b"S,-1,2,3,4,5",
        b"S,1,2,-0,4,5",
        b"S,1,2,3.5,4,5",
        b"S,1,2,nan,4,5",
        b"S,1,2,1e3,4,5",
        b"S,1,2,+3,4,5",
        b"S,1,2, 3,4,5",
        b"S,1,2,1_0,4,5",
        b"S,1,2,9999999999999,4,5",
        b"STATE,asleep,0,x",
        b"STATE,idle,0,%zz",
        b"STATE,idle,0,%FF",
        b"STATE,idle,0," + b"x" * 241,
        b"REFUSED,65536,Arm,no",
        b"LOADED,0,20000,100000,5000000,2,V",
        b"LOADED,0,20000,100000,5000000,0",
        b"LOADED,0,20000,100000,5000000,1,R:1",
        b"LOADED,0,20000,100000,5000000,1,V:1",
        b"HELLO,1,m,f,s,6000,500000,60000000,1000,1000000,20000,2",
        b"HELLO,1,m,f,s,6000,500000,60000000,1000,1000000,20000,1,more",
        b"HELLO,1,m,f,s,6000,0,60000000,1000,1000000,20000,1",
    ],
)
def test_a_whole_frame_that_means_nothing_is_damaged(payload):
    [event] = events_of(frame(payload))
    assert event == Damaged(event.reason, frame(payload))
    assert event.reason
