from __future__ import annotations

from dataclasses import replace

import pytest

from drivers.events import (
    Alarm,
    Arm,
    Hello,
    HostVented,
    InstrumentFault,
    InstrumentState,
    Load,
    Loaded,
    Pace,
    Refused,
    Sample,
    Segment,
    SegmentKind,
    Start,
    State,
    VentConfirmed,
)
from drivers.limits import Limits
from drivers.watchdog import Watchdog

S = InstrumentState
K = SegmentKind
PROGRAM = (
    Segment(K.RAMP, target_mbar=100, rate_mbar_per_s=20),
    Segment(K.HOLD, duration_s=5),
    Segment(K.RAMP, target_mbar=20, rate_mbar_per_s=1000),
    Segment(K.HOLD, duration_s=5),
    Segment(K.RELEASE),
    Segment(K.REST, duration_s=5),
)


HELLO = Hello("reference", 1, "", "", "", None, 500, 60, 1, 1000, False)


@pytest.fixture
def dog():
    dog = Watchdog(Limits())
    assert dog.on_event(HELLO, 0) == []
    assert dog.on_event(Loaded(PROGRAM, 20, 100, 20), 0) == []
    for state in (S.LOADED, S.ARMED, S.RUNNING):
        assert dog.on_event(State(state, "", 0.0), 0) == []
    return dog


def sample(t, pressure, segment=0, deflection=None):
    return Sample(round(t * 20), t, pressure, t if deflection is None else deflection, segment)


def test_stale_after_300_ms(dog):
    dog.on_event(sample(1, 20), 1.0)
    assert dog.check(1.299) == []
    [vent] = dog.check(1.301)
    assert isinstance(vent, HostVented)
    assert "no sample for 300 ms" in vent.reason


def test_stale_after_three_intervals():
    dog = Watchdog(Limits())
    dog.on_event(Loaded(PROGRAM, 2, 100, 20), 0)
    dog.on_event(State(S.RUNNING, "", 0.0), 0)
    assert dog.check(1.5) == []
    assert dog.check(1.51)


def test_nothing_is_stale_at_rest():
    dog = Watchdog(Limits())
    dog.on_event(State(S.LOADED, "", 0.0), 0)
    assert dog.check(1e6) == []


@pytest.mark.parametrize(
    ("segment", "since", "t", "good", "bad"),
    [
        (0, 0, 1, 30, 30.1),  # where the ramp is, not where it goes
        (0, 0, 4.9, 108, 108.1),
        (1, 5, 6, 110, 110.1),
        (2, 10, 10.2, 110, 110.1),  # the pump may be late on its way down
        (3, 10.1, 10.3, 110, 110.1),  # the ramp down still shows
        (3, 10.1, 10.7, 40.8, 40.9),  # and fades away
        (3, 10.1, 13.1, 30, 30.1),
        (5, 15.1, 15.3, 110, 110.1),  # a vent fades too
        (5, 15.1, 16.0, 14.9, 15.0),
        (5, 15.1, 16.2, 10, 10.1),  # and has one second
    ],
)
def test_overshoot(dog, segment, since, t, good, bad):
    dog.on_event(sample(since, 0, segment), since)
    assert dog.on_event(sample(t, good, segment), t) == []
    [vent] = dog.on_event(sample(t, bad, segment), t)
    assert "overshoot" in vent.reason


def test_five_per_cent_where_that_is_more():
    assert Limits().overshoot_above(100) == 110
    assert Limits().overshoot_above(400) == 420


def test_frozen(dog):
    for k in range(10):
        assert dog.on_event(sample(k / 20, k, deflection=0.5), k / 20) == []
    [vent] = dog.on_event(sample(0.5, 10, deflection=0.5), 0.5)
    assert "frozen" in vent.reason
    assert "0 to 10 mbar" in vent.reason


def test_a_pressure_that_stands_still_on_a_ramp(dog):
    assert dog.on_event(sample(1.0, 20), 1.0) == []
    for k in range(1, 10):
        assert dog.on_event(sample(1.0 + 0.05 * k, 20), 1.0 + 0.05 * k) == []
    [vent] = dog.on_event(sample(1.5, 20), 1.5)
    assert "frozen pressure: 20 mbar" in vent.reason


def test_a_pressure_may_stand_still_in_a_hold_and_before_the_skin_seals(dog):
    for k in range(12):
        assert dog.on_event(sample(0.05 * k, 3), 0.05 * k) == []
    for k in range(40):
        assert dog.on_event(sample(5 + 0.05 * k, 100, 1), 5 + 0.05 * k) == []


def test_not_frozen_while_the_pressure_stands_still(dog):
    for k in range(100, 200):
        pressure = 100 + 0.5 * (-1) ** k
        assert dog.on_event(sample(k / 20, pressure, 1, deflection=0.5), k / 20) == []


def test_a_vent_is_confirmed_only_by_an_instrument_that_no_longer_pulls(dog):
    dog.vent_ordered(1.0)
    assert dog.on_event(sample(1, 3), 1.01) == []  # was on its way already
    assert dog.on_event(State(S.VENTING, "host", 40.0), 1.02) == []
    assert dog.on_event(sample(1.1, 5.0, 6), 1.1) == []
    assert dog.on_event(sample(1.2, 4.9, 6), 1.2) == [VentConfirmed(4.9)]
    assert not dog.venting
    assert dog.check(100) == []


def test_saying_again_and_again_that_it_has_vented_wins_no_time(dog):
    """Each word of it was a confirmed vent, and each sample behind it a new order: no alarm."""
    now, alarms = 0.0, []
    while not alarms:
        assert now <= 1.1
        assert any(isinstance(e, HostVented) for e in dog.on_event(sample(now, 110), now))
        dog.vent_ordered(now)
        alarms = dog.check(now)
        [confirmed] = dog.on_event(State(S.LOADED, "host", 0.0), now + 0.01)
        assert isinstance(confirmed, VentConfirmed)
        now += 0.05
    assert 0.4 < now <= 0.5
    assert "does not fall after a vent: still 110 mbar" in dog.alarm


def test_a_vent_that_does_nothing_is_an_alarm_before_its_second_is_over(dog):
    dog.on_event(sample(0.0, 80), 0.0)
    dog.vent_ordered(0.0)
    for k in range(1, 8):
        assert dog.on_event(sample(k / 20, 80), k / 20) == []
        assert dog.check(k / 20) == []  # the valve may be late, and the link
    dog.on_event(sample(0.45, 80), 0.45)
    [alarm] = dog.check(0.45)
    assert "does not fall after a vent: still 80 mbar: lift the probe" in alarm.text


def test_a_vent_that_is_slow_has_its_second(dog):
    dog.on_event(sample(0.0, 80), 0.0)
    dog.vent_ordered(0.0)
    for k in range(1, 21):
        assert dog.on_event(sample(k / 20, 80 - 3.8 * k), k / 20) == []
        assert dog.check(k / 20) == []
    assert dog.on_event(State(S.LOADED, "vented", 4.0), 1.0) == [VentConfirmed(4.0)]


def test_an_instrument_that_refuses_to_vent_is_an_alarm_at_once(dog):
    assert dog.on_event(Refused("VENT", "no"), 0.0) == []  # nobody asked for it
    dog.vent_ordered(1.0)
    assert dog.on_event(Refused("Arm", "vented"), 1.01) == []
    [alarm] = dog.on_event(Refused("VENT", "no"), 1.02)
    assert "refuses to vent (no): lift the probe" in alarm.text


def test_a_second_vent_behind_a_real_one_has_its_own_second(dog):
    """Who presses the key twice must not read *lift the probe* for a slow second answer."""
    dog.vent_ordered(0.0)
    dog.on_event(sample(0.0, 80), 0.0)
    dog.on_event(State(S.LOADED, "host", 0.0), 0.8)
    dog.vent_ordered(0.9)
    assert dog.check(1.5) == []
    assert dog.on_event(State(S.LOADED, "host", 0.0), 1.6) == [VentConfirmed(0.0)]
    dog.vent_ordered(1.7)
    assert dog.check(2.6) == []
    assert dog.check(2.8)


def test_another_vent_of_another_run_has_its_own_second(dog):
    dog.vent_ordered(0.0)
    dog.on_event(State(S.LOADED, "host", 0.0), 0.5)
    dog.on_event(State(S.RUNNING, "", 0.0), 0.6)
    dog.vent_ordered(0.7)
    assert dog.check(1.5) == []
    assert dog.check(1.8)


def test_the_instruments_own_vent_is_watched_too(dog):
    dog.on_event(State(S.VENTING, "program end", 6.0), 0.1)
    assert feed(dog, [(k / 20, sample(k / 20, 6)) for k in range(3, 23)]) == []
    vent, alarm = dog.check(1.11)
    assert isinstance(vent, HostVented)
    assert isinstance(alarm, Alarm)
    assert "lift the probe" in alarm.text
    assert dog.alarm == alarm.text
    dog.vent_ordered(1.11)
    assert dog.check(2) == []  # latched, said once
    dog.acknowledge()
    [again] = dog.check(2)  # and again if it is acknowledged too early
    assert again == alarm
    assert dog.on_event(State(S.LOADED, "vented", 1.0), 3) == [VentConfirmed(1.0)]
    assert dog.alarm == alarm.text  # only a human unlatches it


@pytest.mark.parametrize(
    "word", [InstrumentFault("x", ""), State(S.VENTING, ""), State(S.RUNNING, "")]
)
def test_no_word_wins_time_behind_a_vent_in_words_only(word):
    """One low reading a second, then a fault, a vent or a run by itself: the suction goes on."""
    dog = told(Arm(), Start())
    dog.on_event(State(S.RUNNING, "", 0.0), 0)
    dog.vent_ordered(0.0)
    dog.on_event(State(S.VENTING, "host", 0.0), 0.01)
    orders = 0
    for k in range(1, 60):
        now = k / 20
        dog.on_event(State(S.LOADED, "vented", 2.0 if k % 19 == 0 else 60.0), now)
        orders += any(isinstance(e, HostVented) for e in dog.on_event(word, now + 0.01))
        dog.vent_ordered(now + 0.01)
        dog.on_event(sample(now, 60), now + 0.02)
        dog.check(now + 0.03)
        if dog.alarm:
            break
    assert dog.alarm is not None
    assert now < 1.3


def ended(state):
    """A program of 1 s that has come to its end, with a low reading; then it says `state`."""
    dog = Watchdog(Limits())
    up = Segment(K.RAMP, target_mbar=60, rate_mbar_per_s=1e5)
    dog.on_event(Loaded((up, Segment(K.HOLD, duration_s=1)), 20, 60, 2), 0)
    dog.on_event(State(S.RUNNING, "", 0.0), 0)
    dog.on_event(sample(0.95, 60, 1), 0.95)
    assert dog.on_event(State(S.VENTING, "program end", 2.0), 1.0) == [VentConfirmed(2.0)]
    dog.on_event(State(state, "done", 2.0), 1.0)
    return dog


@pytest.mark.parametrize("state", [S.VENTING, S.FAULT, S.LOADED, S.IDLE])
def test_suction_behind_a_vent_that_was_confirmed(state):
    dog = ended(state)
    said = feed(dog, [(1 + k / 20, sample(1 + k / 20, 60, 2)) for k in range(1, 10)])
    words = "overshoot: 60 mbar" if state is S.VENTING else f"suction of 60 mbar while {state}"
    assert words in said[0].reason


@pytest.mark.parametrize("low", [8.0, 4.0])
@pytest.mark.parametrize("state", [S.VENTING, S.LOADED])
def test_little_suction_at_rest_for_a_second(state, low):
    """Steady, or swinging around what confirms a vent."""
    dog = ended(state)
    swing = [(1.1 + k / 20, sample(1.1 + k / 20, (8.0, low)[k % 2], 2)) for k in range(23)]
    assert feed(dog, swing[:21]) == []
    [vent] = feed(dog, swing[21:])[:1]
    assert f"5 mbar or more for 1 s while {state}" in vent.reason


def test_a_pressure_with_the_wrong_sign(dog):
    assert dog.on_event(sample(1, -20), 1) == []
    [vent] = dog.on_event(sample(1.05, -21), 1.05)
    assert "impossible pressure: -21 mbar" in vent.reason
    dog.vent_ordered(1.05)
    assert dog.on_event(State(S.LOADED, "host", -21.0), 1.1) == []  # nothing is confirmed by it


def test_the_final_vent_is_seen_or_ordered(dog):
    """An instrument that says that its program is over has to show that the pressure falls."""
    dog.on_event(sample(5.0, 100), 5.0)
    assert dog.on_event(State(S.VENTING, "program end", 100.0), 5.0) == []
    assert dog.check(5.29) == []
    [vent] = dog.check(5.31)
    assert "stale" in vent.reason


def test_a_final_vent_that_does_not_end(dog):
    """Who waits for its end would wait for ever."""
    dog.on_event(sample(0, 0), 0)
    dog.on_event(State(S.VENTING, "program end", 2.0), 20.1)
    assert dog.check(24) == []
    [vent] = dog.check(27)
    assert "after the end of the program" in vent.reason
    dog.vent_ordered(27)
    dog.on_event(State(S.VENTING, "host", 2.0), 27)
    assert dog.check(28) == []  # said once


def test_a_fault_that_calls_itself_the_end(dog):
    [vent] = dog.on_event(State(S.FAULT, "program end", 60.0), 1)
    assert "reports a fault" in vent.reason


def test_a_state_with_more_than_was_ever_commanded(dog):
    assert dog.on_event(State(S.RUNNING, "", 110.0), 1) == []
    [vent] = dog.on_event(State(S.RUNNING, "", 110.1), 1)
    assert "at most 100 mbar" in vent.reason


def test_hello_in_the_middle_of_a_run(dog):
    [vent] = dog.on_event(HELLO, 1)
    assert "hello in the middle of a run" in vent.reason


def test_an_instrument_that_becomes_another():
    dog = told()
    assert dog.on_event(HELLO, 1) == []
    assert dog.on_event(HELLO, 1) == []
    [vent] = dog.on_event(replace(HELLO, aperture_mm=2.0), 1)
    assert "another one than before" in vent.reason


def test_one_order_is_enough(dog):
    dog.vent_ordered(1.0)
    assert dog.on_event(sample(1, 300), 1.01) == []
    assert dog.check(1.9) == []


def test_a_fault_of_the_instrument(dog):
    [vent] = dog.on_event(InstrumentFault("pressure", "too high"), 1)
    assert "too high" in vent.reason


def test_suction_while_idle():
    dog = Watchdog(Limits())
    assert dog.on_event(State(S.IDLE, "", 9.0), 0) == []
    [vent] = dog.on_event(State(S.IDLE, "", 12.0), 0)
    assert "while idle" in vent.reason


def test_suction_without_an_end():
    dog = Watchdog(Limits())
    program = (Segment(K.RAMP, 100, 100), Segment(K.HOLD, duration_s=70))
    dog.on_event(Loaded(program, 20, 100, 90), 0)
    dog.on_event(State(S.RUNNING, "", 0.0), 0)
    assert (
        feed(
            dog,
            [(k / 20, sample(k / 20, min(99, 5 * k), min(1, k // 20), k)) for k in range(20 * 62)],
        )
        == []
    )
    [vent] = feed(dog, [(k / 20, sample(k / 20, 99, 1, k)) for k in range(20 * 62, 20 * 63)])[:1]
    assert "more than 61 s without a pause" in vent.reason


def test_a_pause_between_two_samples_counts():
    dog = Watchdog(Limits())
    up = Segment(K.RAMP, target_mbar=100, rate_mbar_per_s=2.5)
    program = (up, Segment(K.RELEASE), up)
    dog.on_event(Loaded(program, 20, 500, 60), 0)
    dog.on_event(State(S.RUNNING, "", 0.0), 0)
    for k in range(20 * 80):
        pressure = 2.5 * (k % 800) / 20
        assert dog.on_event(sample(k / 20, pressure, 0 if k < 800 else 2), k / 20) == []
        assert dog.check(k / 20) == []


def test_a_pause_whose_samples_are_lost_is_not_believed():
    """A liar could lose them in every pause, and never come to its end."""
    dog = Watchdog(Limits())
    up, hold = Segment(K.RAMP, 60, 1000), Segment(K.HOLD, duration_s=4)
    program = (up, hold, Segment(K.RELEASE)) * 5
    dog.on_event(Loaded(program, 20, 60, 5), 0)
    dog.on_event(State(S.RUNNING, "", 0.0), 0)
    said = []
    for k in range(20 * 20):
        begin, part = divmod(k, 84)
        if part > 80:
            continue  # the release, of 0.2 s, which never was
        segment = 3 * begin + min(1, int(part > 1))
        said = feed(dog, [(k / 20, sample(k / 20, 0 if k == 0 else 60, segment, k / 100))])
        if said:
            break
    assert "without a pause" in said[0].reason
    assert k / 20 < 6.7


def test_link_lost(dog):
    assert any(isinstance(event, Alarm) for event in dog.link_lost())
    calm = Watchdog(Limits())
    calm.on_event(State(S.LOADED, "", 0.0), 0)
    assert calm.link_lost() == []
    calm.commanded(Arm(), 0)
    calm.on_event(State(S.ARMED, "", 0.0), 0)
    assert calm.link_lost() == []
    calm.commanded(Start(), 0)  # and nobody knows whether it runs
    assert any(isinstance(event, Alarm) for event in calm.link_lost())


# ---- data that is old, or cannot be -------------------------------------------------------------


def feed(dog, samples):
    """Give (host time, sample) in order, with a check after each; what is said."""
    said = []
    for now, each in samples:
        said += dog.on_event(each, now)
        said += dog.check(now)
    return said


def test_samples_that_are_old_by_the_instruments_clock(dog):
    fresh = [(k / 20, sample(k / 20, 20 * k / 20)) for k in range(20)]
    assert feed(dog, fresh) == []
    # they keep coming, ever later, and never 300 ms apart
    late = [(1 + k * 0.1, sample(1 + k / 20, 20 + k)) for k in range(8)]
    [vent] = feed(dog, late)[:1]
    assert "stale data" in vent.reason


def test_a_burst_after_a_pause_of_the_host_is_not_old(dog):
    assert feed(dog, [(k / 20, sample(k / 20, k)) for k in range(20)]) == []
    for k in range(20, 36):  # all at once, 0.8 s later
        assert dog.on_event(sample(k / 20, k), 1.75) == []
    assert dog.check(1.76) == []


@pytest.mark.parametrize("pace", [0.985, 1.0, 1.015])
def test_a_clock_that_is_a_little_slow_or_fast_is_not_wrong(dog, pace):
    for k in range(20 * 10):
        now = k / 20 / pace
        assert dog.on_event(sample(k / 20, min(k, 100), k // 100, deflection=k), now) == []
        assert dog.check(now) == []


def test_a_new_run_has_a_new_clock(dog):
    assert feed(dog, [(k / 20, sample(k / 20, 20 * k / 20)) for k in range(20)]) == []
    dog.on_event(State(S.VENTING, "program end", 3.0), 1)
    dog.on_event(State(S.LOADED, "done", 1.0), 1.1)
    dog.on_event(State(S.ARMED, "", 0.0), 90)
    dog.on_event(State(S.RUNNING, "", 0.0), 90)
    assert feed(dog, [(90 + k / 20, sample(k / 20, 20 * k / 20)) for k in range(20)]) == []


@pytest.mark.parametrize(
    ("segment", "begin", "pressure", "shown"),
    [(1, 5.0, 49.0, "49 mbar where 100 mbar"), (0, 3.0, 10.0, "10 mbar where"), (1, 5.0, 51, "")],
)
def test_suction_that_does_not_follow(dog, segment, begin, pressure, shown):
    if segment == 0:  # the ramp is seen from its beginning
        dog.on_event(sample(0, 0), 0.0)
    said = []
    for k in range(41):
        t = begin + k / 20
        read = pressure - 0.001 * (k % 2)  # to the last digit no leak reads the same
        said += dog.on_event(sample(t, read, segment, deflection=k + 1), t)
    assert bool(said) == bool(shown)
    assert not said or (shown in said[0].reason and "leak" in said[0].reason)


def test_a_short_shortfall_is_the_pumps_own(dog):
    for k in range(20):
        assert dog.on_event(sample(5 + k / 20, 5 * k, 1, deflection=k), 5 + k / 20) == []
    for k in range(20):  # a ramp down asks for nothing
        assert (
            dog.on_event(sample(10 + k / 20, 5, min(3, 2 + k // 3), deflection=k), 10 + k / 20)
            == []
        )


@pytest.mark.parametrize(("deflection", "fine"), [(-0.5, 1), (-0.51, 0), (6.0, 1), (6.01, 0)])
def test_a_deflection_that_cannot_be(deflection, fine):
    dog = told(Arm(), Start())
    dog.on_event(replace(HELLO, aperture_mm=6.0), 0)
    dog.on_event(State(S.RUNNING, "", 0.0), 0)
    assert (dog.on_event(sample(1, 20, deflection=deflection), 1) == []) == bool(fine)


# ---- vents that nobody asked for -----------------------------------------------------------------


@pytest.mark.parametrize("state", [S.VENTING, S.IDLE, S.LOADED])
def test_a_vent_of_the_instrument_that_nobody_asked_for(dog, state):
    [vent] = dog.on_event(State(state, "keep-alive lost", 60.0), 1)
    assert vent == HostVented("the instrument vented by itself (keep-alive lost)")


@pytest.mark.parametrize(
    ("state", "reason"), [(S.VENTING, "program end"), (S.LOADED, "done"), (S.IDLE, "done")]
)
def test_the_end_of_a_program_is_asked_for(dog, state, reason):
    """Also where the frame that said VENTING was lost."""
    assert dog.on_event(State(state, reason), 1) == []
    assert dog.venting
    assert dog.on_event(State(S.LOADED, "done", 1.0), 1.1) == [VentConfirmed(1.0)]


def test_a_vent_that_was_ordered_is_not_the_instruments_own(dog):
    dog.vent_ordered(1.0)
    assert dog.on_event(State(S.VENTING, "host", 60.0), 1.01) == []


# ---- a link that comes back ----------------------------------------------------------------------


def test_a_vent_that_nobody_saw_is_confirmed_after_the_outage(dog):
    [_, alarm] = dog.link_lost()
    dog.reconnected(10.0)
    assert dog.alarm == alarm.text
    assert dog.on_event(State(S.IDLE, "identify", 0.3), 10.1) == [VentConfirmed(0.3)]
    assert dog.alarm == alarm.text  # only a human unlatches it
    assert dog.check(20) == []


def test_a_vacuum_that_is_still_there_after_the_outage(dog):
    dog.link_lost()
    dog.acknowledge()
    dog.reconnected(10.0)
    [vent] = dog.on_event(State(S.FAULT, "identify", 50.0), 10.1)
    assert "suction of 50 mbar while fault" in vent.reason
    assert dog.check(10.9) == []
    assert any(isinstance(event, Alarm) for event in dog.check(11.1))


def test_an_outage_at_rest_needs_no_vent(dog):
    dog.on_event(State(S.VENTING, "program end", 3.0), 1)
    dog.on_event(State(S.LOADED, "done", 1.0), 1.1)
    assert dog.link_lost() == []
    dog.reconnected(10.0)
    assert dog.on_event(State(S.IDLE, "identify", 0.0), 10.1) == []
    assert dog.check(20) == []


# ---- what nobody asked for, and a pace of its own ------------------------------------------------


def told(*commands):
    dog = Watchdog(Limits())
    dog.commanded(Load(PROGRAM, 20, 100, 20), 0)
    dog.on_event(State(S.LOADED, "", 0.0), 0)
    for command in commands:
        dog.commanded(command, 0)
    return dog


@pytest.mark.parametrize("state", [S.ARMED, S.RUNNING])
def test_started_and_nobody_asked(state):
    [vent] = told().on_event(State(state, "", 0.0), 0)
    assert f"the instrument is {state} and nobody asked for it" in vent.reason
    assert told(Arm(), Start()).on_event(State(state, "", 0.0), 0) == []


def test_asked_once_is_done_once():
    dog = told(Arm())
    assert dog.on_event(State(S.ARMED, "", 0.0), 0) == []
    dog.on_event(State(S.LOADED, "", 0.0), 0)
    assert dog.on_event(State(S.ARMED, "", 0.0), 0)


def test_a_vent_takes_back_what_was_asked():
    dog = told(Arm(), Start())
    dog.vent_ordered(0)
    assert dog.on_event(State(S.VENTING, "host", 0.0), 0) == [VentConfirmed(0.0)]
    dog.on_event(State(S.LOADED, "vented", 0.0), 0)
    assert dog.on_event(State(S.ARMED, "", 0.0), 0)


def test_what_was_sent_counts_and_not_what_is_read_back():
    dog = told(Arm(), Start())
    dog.on_event(Loaded((Segment(K.RAMP, 500, 1e5),), 20, 500, 60), 0)
    dog.on_event(State(S.RUNNING, "", 0.0), 0)
    assert dog.on_event(sample(0.5, 60), 0.5)


@pytest.mark.parametrize("simulated", [True, False])
def test_only_a_simulated_instrument_has_a_pace(simulated):
    dog = told(Arm(), Start())
    dog.on_event(Hello("reference", 1, "", "", "", 6.0, 500, 60, 1, 1000, simulated), 0)
    dog.on_event(Pace(10), 0)
    dog.on_event(State(S.RUNNING, "", 0.0), 0)
    said = feed(
        dog, [(k / 200, sample(k / 20, min(k, 100), int(k > 100), k / 100)) for k in range(150)]
    )
    assert bool(said) != simulated
    if not simulated:
        assert "ahead of the host's" in said[0].reason


def test_samples_that_come_a_little_late_at_another_pace_are_no_longer_suction():
    dog = Watchdog(Limits())
    dog.commanded(Load((Segment(K.RAMP, 100, 1e5), Segment(K.HOLD, duration_s=3)), 20, 100, 3.1), 0)
    dog.commanded(Arm(), 0)
    dog.commanded(Start(), 0)
    dog.on_event(Hello("reference", 1, "", "", "", 6.0, 500, 60, 1, 1000, True), 0)
    dog.on_event(Pace(20), 0)
    dog.on_event(State(S.RUNNING, "", 0.0), 0)
    # 3 s of the instrument are 0.15 s here, and the last samples come 0.1 s late
    late = [
        (k / 400 + 0.1 * (k > 40), sample(k / 20, 90 * (k > 0), int(k > 0), k / 400))
        for k in range(60)
    ]
    assert feed(dog, late) == []
    on = ((0.25 + k / 400, sample(2.95 + 1e-4 * k, 90, 1, 0.2 + k / 1e4)) for k in range(200))
    assert feed(dog, list(on))


def test_a_pace_that_changes_in_a_run_is_not_believed():
    dog = told(Arm(), Start())
    dog.on_event(Hello("reference", 1, "", "", "", 6.0, 500, 60, 1, 1000, True), 0)
    dog.on_event(State(S.RUNNING, "", 0.0), 0)
    dog.on_event(Pace(10), 0)
    assert feed(
        dog, [(k / 200, sample(k / 20, min(k, 100), int(k > 100), k / 100)) for k in range(150)]
    )


def test_no_sample_after_the_end():
    """A rate of 1 Hz: by the host's clock alone."""
    dog = Watchdog(Limits())
    program = (Segment(K.RAMP, 100, 1e5), Segment(K.HOLD, duration_s=3))
    dog.commanded(Load(program, 0.2, 100, 3.001), 0)
    dog.on_event(State(S.RUNNING, "", 0.0), 0)
    dog.on_event(sample(0, 0), 0)
    assert dog.check(3.0) == []
    [vent] = dog.check(6.0)
    assert "after the end of the program" in vent.reason
