"""Runs of an instrument that only streams: where they begin and end, and who watches."""

from __future__ import annotations

import copy
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.capabilities import READ_ONLY, Capabilities, Stream
from drivers.dose import DoseMeter
from drivers.errors import LocalProtocolError, RemoteProtocolError
from drivers.events import (
    PROGRAM_DONE,
    Alarm,
    Arm,
    Damaged,
    Gap,
    Hello,
    HostVented,
    Identify,
    InstrumentState,
    KeepAlive,
    Load,
    Sample,
    Segment,
    SegmentKind,
    Start,
    State,
    Vent,
    VentConfirmed,
)
from drivers.line_dialect import line_dialect
from drivers.onlooker import Onlooker
from drivers.stream import StreamConnection, follow_mark, lost_mark, stop_mark

S = InstrumentState
TEXT = r"""
[dialect]
name = "timed"
pattern = '(?P<time>\d+) (?P<pressure>\S+) (?P<deflection>\S+)'
[columns.time]
unit = "ms"
[columns.pressure]
unit = "mbar"
[columns.deflection]
unit = "mm"
"""
TIMED = line_dialect(TEXT, "timed.toml")
NUMBERED = line_dialect(
    TEXT.replace(r"\S+)'", r"\S+) (?P<sequence>\d+)'") + "[columns.sequence]\n", "numbered.toml"
)
COUNTED = line_dialect(
    r"""
[dialect]
name = "counted"
pattern = '(?P<pressure>\S+) (?P<deflection>\S+)'
[columns.pressure]
unit = "mbar"
[columns.deflection]
unit = "mm"
[stream]
rate_hz = 10
aperture_mm = 8
""",
    "counted.toml",
)
RAMP = (Segment(SegmentKind.RAMP, target_mbar=10.0, rate_mbar_per_s=10.0),)
TWO_PULSES = (*RAMP, Segment(SegmentKind.RELEASE), Segment(SegmentKind.REST, duration_s=2.0), *RAMP)


class Bench:
    """Readings every 100 ms into a connection, and what comes of them."""

    def __init__(self, follow=None, dialect=TIMED):
        self.connection = StreamConnection(dialect)
        self.time_ms = 50_000
        self.events = []
        if follow is not False:
            self.mark(follow_mark(follow))

    def mark(self, data):
        self.connection.mark(data)
        self.drain()

    def drain(self):
        while (event := self.connection.next_event()) is not None:
            self.events.append(event)

    def feed(self, data):
        self.connection.receive_data(data)
        self.drain()

    def read(self, *pressures):
        for pressure in pressures:
            self.feed(b"%d %f 0.1\n" % (self.time_ms, pressure))
            self.time_ms += 100

    @property
    def states(self):
        return [(e.state, e.reason) for e in self.events if isinstance(e, State)]

    @property
    def run(self):
        """The samples of the first run."""
        inside, found = False, []
        for event in self.events:
            if isinstance(event, State):
                inside = event.state is S.RUNNING
            elif inside and isinstance(event, Sample):
                found.append(event)
        return found


def test_a_run_goes_from_zero_to_zero_and_its_clock_begins_with_it():
    bench = Bench()
    bench.read(0.2, -0.1, 0.5, 2.0, 5.0, 50.0, 20.0, 0.3, 0.1, 0.0, 0.1, 0.0, 0.2, 0.1)
    assert [s for s, _ in bench.states] == [S.ARMED, S.RUNNING, S.IDLE]
    assert bench.states[-1] == (S.IDLE, PROGRAM_DONE)
    assert [s.pressure_mbar for s in bench.run] == [0.5, 2.0, 5.0, 50.0, 20.0, 0.3]
    assert [s.device_time_s for s in bench.run] == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]
    # All readings are there, once each, in order
    samples = [e.pressure_mbar for e in bench.events if isinstance(e, Sample)]
    assert samples == [0.2, -0.1, 0.5, 2.0, 5.0, 50.0, 20.0, 0.3, 0.1, 0.0, 0.1, 0.0, 0.2, 0.1]


def test_noise_and_drift_below_the_threshold_begin_nothing():
    bench = Bench()
    bench.read(*[0.0, 1.5, 3.9, 0.5, 2.0, 3.0] * 5)
    assert bench.connection.state is S.ARMED


def test_a_dip_does_not_end_a_run():
    bench = Bench()
    bench.read(0, 5, 50, 0.5, 0.2, 30, 60, 20, *[0] * 7)
    assert [s.pressure_mbar for s in bench.run] == [0, 5, 50, 0.5, 0.2, 30, 60, 20, 0]


def test_a_run_is_not_begun_in_its_middle():
    bench = Bench()
    bench.read(50, 60, 70, 20, 0, 5)
    assert [s.pressure_mbar for s in bench.run] == [0, 5]


def test_nothing_runs_where_nobody_waits():
    bench = Bench(follow=False)
    bench.read(0, 5, 50, 100)
    assert bench.states == []
    assert len(bench.events) == 4  # the readings are passed on: somebody looks


def test_one_follow_is_one_run():
    bench = Bench()
    bench.read(0, 50, *[0] * 8, 50, 50, *[0] * 8)
    assert [s for s, _ in bench.states].count(S.RUNNING) == 1
    bench.mark(follow_mark(None))
    bench.read(0, 50, *[0] * 8)
    assert [s for s, _ in bench.states].count(S.RUNNING) == 2


def test_the_program_ends_a_run_and_names_the_segments():
    bench = Bench(RAMP)
    bench.read(0, *[min(10.0, 1.0 * k + 0.5) for k in range(1, 20)])
    assert [s.device_time_s for s in bench.run][-1] == 1.0
    assert bench.states[-1] == (S.IDLE, PROGRAM_DONE)


def test_rests_of_the_program_do_not_end_it():
    bench = Bench(TWO_PULSES)
    pulse = [1.0 * k for k in range(2, 11)]
    bench.read(0, 0.9, *pulse, *[0] * 20, *pulse, 10, 10, 10)
    assert bench.states[-1] == (S.IDLE, PROGRAM_DONE)
    assert [s.segment for s in bench.run][-1] == 3
    assert bench.run[-1].device_time_s == pytest.approx(4.0, abs=0.11)


@pytest.mark.parametrize(
    ("pressures", "complete"), [((0, 5, 50, 100), False), ((0, 5, 50, 20, 0.2), True)]
)
def test_whoever_stops_waiting_cuts_what_is_not_back_at_zero(pressures, complete):
    bench = Bench()
    bench.read(*pressures)
    bench.mark(stop_mark("operator"))
    assert bench.states[-1] == (S.IDLE, PROGRAM_DONE if complete else "operator")
    assert len(bench.run) == len(pressures)


def test_a_clock_that_goes_back_cuts_a_run_and_is_waited_on():
    bench = Bench()
    bench.read(0, 5, 50)
    bench.time_ms = 0
    bench.read(60)
    assert bench.states[-1] == (S.IDLE, "the instrument's clock went back")
    bench.mark(follow_mark(None))
    bench.read(0, 5)
    bench.time_ms = 10
    bench.read(0)
    assert bench.connection.state is S.IDLE


def test_a_lost_link_forgets_half_a_line_and_the_clock():
    bench = Bench()
    bench.read(0, 5, 50)
    bench.feed(b"50300 6")
    bench.mark(lost_mark("unplugged"))
    assert bench.states[-1] == (S.IDLE, "unplugged")
    bench.time_ms = 100
    bench.mark(follow_mark(None))
    bench.read(0, 5)
    assert bench.connection.state is S.RUNNING


def test_without_a_clock_readings_are_counted_and_damaged_ones_leave_a_gap():
    bench = Bench(dialect=COUNTED)
    bench.feed(b"0 0.1\n5 0.1\n\n6 zero\n7 0.1\n")
    assert [s.device_time_s for s in bench.run] == [0.0, 0.1, 0.3]
    assert [e for e in bench.events if isinstance(e, Gap)] == [Gap(2, 3)]


def test_a_count_of_its_own_shows_what_was_lost():
    bench = Bench(dialect=NUMBERED)
    bench.feed(b"0 0 0.1 7\n20 5 0.1 8\n60 9 0.1 10\n")
    assert [e for e in bench.events if isinstance(e, Gap)] == [Gap(2, 3)]
    assert [s.sequence for s in bench.run] == [0, 1, 3]


def test_it_says_who_it_is_once_it_is_asked_and_nothing_goes_out():
    connection = StreamConnection(COUNTED)
    assert connection.next_event() is None
    assert connection.send(Identify()) == b""
    hello, state = connection.next_event(), connection.next_event()
    assert isinstance(hello, Hello)
    assert (hello.read_only, hello.aperture_mm, hello.model) == (True, 8.0, "counted")
    assert state == State(S.IDLE, "connected")


@pytest.mark.parametrize(
    "command", [Load(RAMP, 20.0, 10.0, 1.0), Arm(), Start(), Vent(), KeepAlive()]
)
def test_nothing_can_be_sent(command):
    with pytest.raises(LocalProtocolError, match=READ_ONLY):
        StreamConnection(TIMED).send(command)


def test_a_mark_that_is_damaged_is_no_crash():
    for data in (b"", b"nonsense", b"follow", b"follow x", b"\xff\x00"):
        with pytest.raises(RemoteProtocolError):
            StreamConnection(TIMED).mark(data)


@given(
    st.lists(st.floats(-5, 120, allow_nan=False), max_size=60),
    st.integers(1, 40),
    st.sampled_from([None, RAMP, TWO_PULSES]),
)
def test_the_same_record_gives_the_same_runs_however_it_came(pressures, size, program):
    data = b"".join(b"%d %f 0.1\n" % (100 * k, p) for k, p in enumerate(pressures))
    whole, pieces = Bench(program), Bench(program)
    whole.feed(data)
    for k in range(0, len(data), size):
        pieces.feed(data[k : k + size])
    for bench in (whole, pieces):
        bench.mark(stop_mark("the end"))
    assert whole.events == pieces.events
    samples = [e.pressure_mbar for e in whole.events if isinstance(e, Sample)]
    assert samples == pytest.approx(pressures, abs=1e-6)  # none lost, none doubled, in order
    times = [s.device_time_s for s in whole.run]
    assert times == sorted(set(times))


@pytest.mark.parametrize(
    "wrong", [{"zero_mbar": 5.0}, {"begin_mbar": 0.0}, {"rate_hz": float("nan")}]
)
def test_a_rule_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        Stream(**wrong)


def test_all_four_are_needed_to_start_suction():
    assert Capabilities(True, True, True, True).controllable
    for missing in range(4):
        assert not Capabilities(*(k != missing for k in range(4))).controllable


@pytest.mark.parametrize("follow", [None, TWO_PULSES])
def test_readings_that_are_held_back_tell_when_they_came(follow):
    """With the time at which they were let go a pause was half of suction."""
    bench = Bench(follow)
    pressures = [0, 0.5, 2, 10, 100, 0, *[0] * 19, 0.5, 2, 10, 100, *[0] * 60]
    for k, pressure in enumerate(pressures):
        bench.connection.receive_data(b"%d %f 0.1\n" % (50_000 + 100 * k, pressure), 7.0 + 0.2 * k)
        bench.connection.receive_data(b"", 1e9)
        bench.drain()
    samples = [event for event in bench.events if isinstance(event, Sample)]
    assert [s.host_time_s for s in samples] == [7.0 + 0.2 * k for k in range(len(samples))]
    dose, onlooker = DoseMeter(), Onlooker()
    for sample in samples:
        dose.add(sample)
        onlooker.on_event(sample, 1e9)
    assert dose.total.suction_mbar_s == pytest.approx(2 * 0.2 * (6 + 55 + 50))
    assert onlooker.dose == dose.total


# ---- the onlooker ---------------------------------------------------------------------------


def watch(pressures, *, step_s=0.1, onlooker=None):
    onlooker = Onlooker() if onlooker is None else onlooker
    found = []
    for k, pressure in enumerate(pressures):
        now = k * step_s
        found += onlooker.on_event(Sample(k, now, pressure, 0.1, 0), now)
        found += onlooker.check(now)
    return onlooker, found


@pytest.mark.parametrize(
    ("pressures", "step_s", "words"),
    [
        ([0, 300, 530, 540], 0.1, "530 mbar: more than the 500 mbar"),
        ([0] + [100] * 130, 0.5, "suction for more than 60 s without a pause"),
        ([0] + [499] * 200 + [0, 499] * 100, 1.0, "suction for more than 60 s"),
        ([0, 499, 499, 499, 0.0] * 60, 15.0, "a dose of"),
    ],
)
def test_limits_that_are_passed_raise_an_alarm_in_words(pressures, step_s, words):
    onlooker, found = watch(pressures, step_s=step_s, onlooker=Onlooker(silent_s=100.0))
    alarm = found[0]
    assert isinstance(alarm, Alarm)
    assert words in alarm.text
    assert alarm.text.endswith("it cannot be vented from here: lift the probe")
    assert not [event for event in found if isinstance(event, HostVented)]
    assert onlooker.alarm == alarm.text


@pytest.mark.parametrize("pace", [0.1, 10.0])
def test_the_dose_is_by_the_clock_that_says_more(pace):
    """An instrument that counts its readings at a tenth of their rate had a tenth of the dose."""
    onlooker, found = Onlooker(silent_s=100.0), []
    for k in range(200):
        now = 5.0 * k
        sample = Sample(k, now * pace, 0.0 if k % 5 == 4 else 400.0, 0.1, 0)
        found += onlooker.on_event(sample, now)
    assert any(isinstance(event, Alarm) and "a dose of" in event.text for event in found)


def test_an_alarm_comes_back_while_its_cause_lasts():
    onlooker, found = watch([0, 540, 540, 540])
    assert len(found) == 1
    onlooker.acknowledge()
    assert onlooker.alarm is None
    assert len(onlooker.on_event(Sample(9, 0.9, 540.0, 0.1, 0), 0.9)) == 1


def test_silence_under_suction_is_an_alarm_and_at_rest_it_is_none():
    onlooker, found = watch([0, 50, 100])
    assert not found
    (alarm,) = onlooker.check(1.5)
    assert "nobody can see the pressure" in alarm.text
    resting, _ = watch([0, 50, 0.0])
    assert resting.check(100.0) == []


def test_a_link_lost_under_suction_is_an_alarm_until_the_pressure_is_seen_gone():
    onlooker, _ = watch([0, 50, 100])
    (alarm,) = onlooker.link_lost()
    assert "the link is lost under suction" in alarm.text
    onlooker.reconnected(2.0)
    seen = onlooker.on_event(Sample(0, 0.0, 0.4, 0.0, 0), 2.1)
    assert seen == [VentConfirmed(0.4)]
    assert watch([0, 50, 0])[0].link_lost() == []


def test_where_there_is_a_vent_it_is_sent_and_not_relied_on():
    onlooker, found = watch([0, 540], onlooker=Onlooker(can_vent=True))
    vented, alarm = found
    assert isinstance(vented, HostVented)
    assert "may not work: lift the probe" in alarm.text
    onlooker.vent_ordered(0.2)
    assert onlooker.ordered
    assert onlooker.on_event(Sample(3, 0.3, 1.0, 0.0, 0), 0.3) == [VentConfirmed(1.0)]
    assert not onlooker.ordered


def test_a_reading_of_which_nothing_tells_the_time_is_none():
    """With 1 Hz in its place 2 s under suction were a minute and more."""
    stream = replace(COUNTED.stream, rate_hz=None)
    untimed = copy.copy(COUNTED)
    untimed.stream = stream
    bench = Bench(dialect=untimed)
    for pressure in (0.0, 5.0, 50.0):
        bench.feed(b"%f 0.1\n" % pressure)
    assert not bench.run
    reasons = {e.reason for e in bench.events if isinstance(e, Damaged)}
    assert reasons == {"neither a time nor stream.rate_hz tells when"}
