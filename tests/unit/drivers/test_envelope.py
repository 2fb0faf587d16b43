"""What a program allows when: the envelope itself, honest instruments, and any that lie."""

from __future__ import annotations

import pytest
from honest import Honest, command_mbar, ready
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.envelope import Envelope, targets
from drivers.errors import LocalProtocolError
from drivers.events import HostVented, InstrumentState, Sample, Segment, SegmentKind, State
from drivers.limits import Limits, program_bounds
from drivers.watchdog import Watchdog

LIMITS = Limits()


def ramp(target, rate):
    return Segment(SegmentKind.RAMP, target_mbar=target, rate_mbar_per_s=rate)


def hold(seconds):
    return Segment(SegmentKind.HOLD, duration_s=seconds)


def rest(seconds):
    return Segment(SegmentKind.REST, duration_s=seconds)


def until(height, rate, most):
    return Segment(SegmentKind.UNTIL, target_mbar=most, rate_mbar_per_s=rate, height_mm=height)


RELEASE = Segment(SegmentKind.RELEASE)
PULSES = (ramp(60, 1e5), hold(2), RELEASE, ramp(80, 1e5), hold(2), RELEASE)


# ---- the envelope -------------------------------------------------------------------------------


def test_where_a_ramp_is():
    envelope = Envelope((ramp(100, 20), hold(5), ramp(0, 20)), LIMITS)
    assert envelope.see(0, 0.0) is None
    assert [envelope.highest_mbar(t) for t in (0.0, 1.0, 5.0)] == [0, 20, 100]
    assert envelope.see(0, 5.0) is None
    assert envelope.see(1, 5.05) is None
    assert envelope.highest_mbar(9.0) == 100
    assert envelope.see(1, 10.0) is None
    assert envelope.see(2, 10.05) is None
    # The ramp down, 0.3 s late
    assert envelope.highest_mbar(12.35) == pytest.approx(60, abs=1)
    assert envelope.end_s == pytest.approx(15 + LIMITS.release_s + LIMITS.program_slack_s)


def test_a_command_that_went_down_fades():
    envelope = Envelope((ramp(100, 1e5), hold(1), ramp(20, 1e5), hold(1)), LIMITS)
    for segment, time_s in ((0, 0.0), (1, 0.05), (1, 1.0), (3, 1.05)):
        assert envelope.see(segment, time_s) is None
    late = LIMITS.pump_lag_s
    assert envelope.highest_mbar(1.05 + 0.99 * late) == 100
    # then as one that is slow from the beginning
    assert envelope.highest_mbar(1.05 + 1.5 * late) == pytest.approx(
        20 + 80 / 2.71828**1.5, abs=0.1
    )
    assert envelope.highest_mbar(1.05 + 20 * late) == 20


def test_nothing_is_left_of_a_vent_after_its_time():
    envelope = Envelope((ramp(500, 1e5), hold(1)), LIMITS)
    for segment, time_s in ((0, 0.0), (1, 0.05), (2, 1.05)):
        assert envelope.see(segment, time_s) is None
    assert envelope.highest_mbar(1.05 + 0.99) > 15
    assert envelope.highest_mbar(1.05 + 1.01) == 0


@pytest.mark.parametrize(
    ("seen", "segment", "time_s", "said"),
    [
        ([], 3, 0.0, "past the end: the program has 2"),
        ([], 1, 4.84, "ahead of the program: segment 1 (hold)"),
        ([], 1, 4.86, None),
        ([(0, 0.0)], 0, 5.14, None),
        ([(0, 0.0)], 0, 5.16, "behind the program: still segment 0 (ramp)"),
        ([(1, 5.0)], 0, 5.05, "back in segment 0"),
        ([(1, 5.0)], 1, 10.16, "still segment 1 (hold) at 10.16 s; it ends by 10.00 s"),
        ([(1, 5.0)], 2, 9.0, "ahead of the program: the final vent"),
        ([(1, 5.0), (2, 10.0)], 2, 12.1, None),
        ([(1, 5.0), (2, 10.0)], 2, 12.2, "still the final vent"),
        ([(1, 5.0), (2, 10.0)], 3, 10.1, "past the end"),
    ],
)
def test_segments(seen, segment, time_s, said):
    envelope = Envelope((ramp(100, 20), hold(5)), LIMITS)
    for each in seen:
        assert envelope.see(*each) is None
    problem = envelope.see(segment, time_s)
    assert problem == said if said is None else said in problem


def test_what_follows_a_release_is_counted_from_its_end():
    envelope = Envelope(PULSES, LIMITS)
    for each in ((0, 0.0), (1, 0.05), (1, 2.0), (2, 2.05), (2, 3.0), (4, 3.05), (4, 5.1)):
        assert envelope.see(*each) is None
    assert "behind the program: still segment 4 (hold)" in envelope.see(4, 5.25)
    # It cannot have begun before the last sample of the release
    early = Envelope(PULSES, LIMITS)
    for each in ((1, 0.05), (2, 2.05), (2, 3.0), (4, 3.05)):
        assert early.see(*each) is None
    assert "ahead of the program" in early.see(5, 4.8)
    assert early.see(5, 4.9) is None


def test_a_release_that_does_not_end():
    envelope = Envelope(PULSES, LIMITS)
    for each in ((1, 0.05), (2, 2.05), (2, 4.1)):
        assert envelope.see(*each) is None
    assert "behind the program: still segment 2 (release)" in envelope.see(2, 4.2)


def test_small_leads_do_not_add_up():
    steps = tuple(s for k in range(20) for s in (ramp(10 + k, 1e5), hold(1)))
    envelope = Envelope(steps, LIMITS)
    said = [envelope.see(2 * k + 1, k * 0.9) for k in range(5)]
    assert said[0] is None
    assert any("ahead" in (each or "") for each in said)


def test_what_follows_a_height_begins_where_it_was_reached():
    envelope = Envelope((until(0.4, 20, 100), hold(2), ramp(0, 20)), LIMITS)
    assert envelope.see(0, 0.0) is None
    assert envelope.highest_mbar(2.0) == 40
    assert envelope.see(0, 2.0) is None
    assert envelope.see(1, 2.05) is None  # reached between the two samples
    assert envelope.highest_mbar(3.0) == pytest.approx(41)
    assert 35 < envelope.least_mbar(1) <= 40
    assert envelope.see(1, 4.05) is None
    assert "behind the program" in envelope.see(1, 4.3)
    assert envelope.see(2, 4.1) is None
    assert envelope.see(2, 6.0) is None
    assert "behind the program" in envelope.see(2, 6.5)  # down from 41 mbar it takes 2.05 s


def test_a_height_that_is_never_reached_ends_at_the_most():
    envelope = Envelope((until(0.4, 20, 100), hold(2)), LIMITS)
    for time_s in (0.0, 2.5, 5.1):
        assert envelope.see(0, time_s) is None
    assert envelope.highest_mbar(5.1) == 100
    assert "behind the program" in envelope.see(0, 5.2)


# ---- honest instruments -------------------------------------------------------------------------

rates = st.sampled_from([5.0, 20.0, 60.0, 300.0, 1e5])
pieces = st.one_of(
    # To more than any ramp goes to, since it may not be below what comes before it
    st.builds(until, st.floats(0.01, 1.0), rates, st.floats(150, 200)),
    st.builds(ramp, st.floats(0, 150), rates),
    st.builds(hold, st.floats(0, 2)),
    st.builds(rest, st.floats(0, 2)),
    st.just(RELEASE),
)


def short_enough(program):
    try:
        bounds = program_bounds(program)
    except LocalProtocolError:  # an until below the one before it
        return False
    lasts = 0.0
    before = 0.0
    for segment, target in zip(program, targets(program), strict=True):
        if segment.kind in {SegmentKind.RAMP, SegmentKind.UNTIL}:
            lasts += abs(target - before) / segment.rate_mbar_per_s
        lasts += segment.duration_s
        before = target
    return bounds.max_pressure_mbar > 0 and lasts < 25


programs = st.lists(pieces, min_size=1, max_size=8).map(tuple).filter(short_enough)
# Pump and valve are late by a delay or by a time constant, and 5 mbar are left 1 s after a vent
pumps = st.one_of(
    st.tuples(st.floats(0, 0.3), st.just(0.02), st.just(0.05)),
    st.tuples(st.just(0.0), st.floats(0.02, 0.3), st.floats(0.02, 0.25)),
)
honest_ones = st.builds(
    lambda pump, clock, start_s, noise, rate_hz, stalls, seed: Honest(
        *pump, clock, start_s, noise, rate_hz, tuple(sorted(stalls)), seed
    ),
    pumps,
    st.floats(0.981, 1.019),
    st.floats(0, 0.1),
    st.floats(0, 3),
    st.sampled_from([20.0, 50.0, 100.0]),
    st.lists(st.tuples(st.floats(0, 20), st.floats(0, 0.2)), max_size=4),
    st.integers(0, 99),
)


def judge(dog, arrivals):
    """Give events at their times, with the driver's check every 10 ms and after each piece."""
    said = []
    times = sorted(
        {*(t for t, _ in arrivals), *(k / 100 for k in range(int(100 * arrivals[-1][0])))}
    )
    queue = list(arrivals)
    for now in times:
        while queue and queue[0][0] <= now:
            said += [(now, e) for e in dog.on_event(queue.pop(0)[1], now)]
        said += [(now, event) for event in dog.check(now)]
        if any(isinstance(event, HostVented) for _, event in said):
            break
    return said


def never_vents(program, instrument):
    dog = Watchdog(LIMITS)
    ready(dog, program)
    said = judge(dog, sorted(instrument.run(program), key=lambda each: each[0]))
    assert [each for each in said if isinstance(each[1], HostVented)] == []
    assert not dog.venting
    assert dog.alarm is None


@settings(max_examples=40)
@given(program=programs, instrument=honest_ones)
def test_no_honest_instrument_is_vented(program, instrument):
    never_vents(program, instrument)


@pytest.mark.long
@settings(max_examples=150)
@given(program=programs, instrument=honest_ones)
def test_no_honest_instrument_of_many_is_vented(program, instrument):
    never_vents(program, instrument)


# ---- any other ----------------------------------------------------------------------------------

plain = (
    st.lists(
        st.one_of(
            st.builds(ramp, st.floats(0, 100), rates),
            st.builds(hold, st.floats(0.2, 2)),
            st.builds(rest, st.floats(0.2, 2)),
        ),
        min_size=1,
        max_size=6,
    )
    .map(tuple)
    .filter(short_enough)
)
spells = st.lists(
    st.tuples(st.floats(0.1, 4), st.floats(0, 3), st.floats(0, 200), st.integers(0, 2)),
    min_size=1,
    max_size=8,
)


@settings(max_examples=300)
@given(program=plain, lies=spells)
def test_whoever_stays_beyond_the_program_is_vented_within_half_a_second(program, lies):
    """Clock, segment and pressure are whatever the instrument likes; the host's clock decides."""
    dog = Watchdog(LIMITS)
    ready(dog, program)
    now = clock_s = 0.0
    index = 0
    since = None  # when the pressure began to stay beyond what the program can show by the host's
    dog.on_event(State(InstrumentState.RUNNING, "started", 0.0), now)
    for number, (lasts_s, pace, mbar, skips) in enumerate(lies):
        index += skips
        for k in range(max(1, round(lasts_s / 0.05))):
            now += 0.05
            clock_s += 0.05 * pace + 1e-6
            late_s = LIMITS.clock_s + LIMITS.clock_fraction * now + LIMITS.program_slack_s
            sample = Sample(0, clock_s, mbar, 0.01 * number + 1e-4 * k, index)
            said = [*dog.on_event(sample, now), *dog.check(now)]
            if any(isinstance(event, HostVented) for event in said):
                return
            moments = [now + late_s - j * 0.01 for j in range(int((1.1 + 2 * late_s) / 0.01))]
            most = max(command_mbar(program, t) for t in moments)
            beyond = mbar > LIMITS.overshoot_above(most) + 10
            since = None if not beyond else now if since is None else since
            assert since is None or now - since <= 0.5, (now, clock_s, mbar, most, index)


@pytest.mark.parametrize("mbar", [20, 60, 100, 500])
@pytest.mark.parametrize("honestly", [True, False], ids=["says final vent", "says hold"])
def test_five_seconds_of_suction_that_do_not_end(mbar, honestly):
    """With an honest clock it takes less than 0.5 s, however much it pulls."""
    program = (ramp(mbar, 1e5), hold(5))
    dog = Watchdog(LIMITS)
    ready(dog, program)
    dog.on_event(State(InstrumentState.RUNNING, "started", 0.0), 0.0)
    for k in range(1, 200):
        now = k / 20
        index = 2 if honestly and now > 5.001 else 1
        said = dog.on_event(Sample(k, now, mbar - 1, 1e-4 * k, index), now) or dog.check(now)
        if said:
            break
    [vent] = said
    assert isinstance(vent, HostVented)
    assert 5 < now <= (5.95 if honestly and mbar == 20 else 5.5)


@pytest.mark.parametrize("stays_mbar", [35, 40, 60, 100])
@pytest.mark.parametrize("opens", [(), (rest(2),), (RELEASE,)], ids=["end", "rest", "release"])
def test_a_valve_that_opens_in_part(stays_mbar, opens):
    program = (ramp(100, 1e5), hold(1), *opens)
    dog = Watchdog(LIMITS)
    ready(dog, program)
    index = lambda t: 0 if t == 0 else 1 if t <= 1.0 else 2  # noqa: E731
    now, reason = pulled(dog, index, lambda t: 100 if t <= 1.0 else stays_mbar, 3, rate_hz=50)
    assert f"overshoot: {stays_mbar} mbar" in reason
    assert now - 1.0 <= 0.5


@pytest.mark.parametrize("clock", [0.2, 0.8, 0.93, 1.1, 1.3, 2.0])
def test_a_clock_that_is_wrong(clock):
    """Segment and pressure are right by it; by the host's clock the program is slow or fast."""
    dog = Watchdog(LIMITS)
    program = (ramp(100, 10), hold(10))
    ready(dog, program)
    [(now, vent), *_] = judge(dog, Honest(clock=clock).run(program))
    assert "ahead of the host's" in vent.reason if clock > 1 else "stale data" in vent.reason
    allowed_s = LIMITS.clock_s / (abs(clock - 1) - LIMITS.clock_fraction * clock)
    assert now <= allowed_s + 0.5


@pytest.mark.parametrize("stops", [False, True], ids=["jumps", "stops"])
def test_a_clock_that_jumps_or_stops(stops):
    dog = Watchdog(LIMITS)
    program = (ramp(100, 10), hold(10))
    ready(dog, program)
    said = [(0.0, State(InstrumentState.RUNNING, "started", 0.0))]
    for k in range(1, 200):
        now = k / 20
        time_s = now if now < 5 else 5 + 1e-6 * k if stops else now + 5.2
        said.append((now, Sample(k, time_s, min(100, 10 * time_s), 1e-4 * k, int(time_s > 10))))
    [(vented, vent), *_] = judge(dog, said)
    assert isinstance(vent, HostVented)
    assert 5 <= vented <= 5.5


# ---- suction time is a sum ----------------------------------------------------------------------

SHORT = Limits(max_suction_s=3)


def pulled(dog, segment_at, pressure_at, lasts_s, rate_hz=20):
    """Seconds until the driver vented, and why; None if it did not."""
    dog.on_event(State(InstrumentState.RUNNING, "started", 0.0), 0.0)
    for k in range(1, round(lasts_s * rate_hz)):
        now = k / rate_hz
        sample = Sample(k, now, pressure_at(now), 1e-4 * k, segment_at(now))
        for event in (*dog.on_event(sample, now), *dog.check(now)):
            return now, event.reason
    return None


@pytest.mark.parametrize("dips_s", [(), (1.0, 2.0, 3.0), (2.55,), (2.8,)])
def test_a_dip_is_no_pause(dips_s):
    """It pulls through the rest of 0.3 s; a sample below 5 mbar changes nothing, wherever."""
    program = (ramp(60, 1e5), hold(2.5), rest(0.3), ramp(60, 1e5), hold(2.5))
    dog = Watchdog(SHORT)
    ready(dog, program)
    now, reason = pulled(
        dog,
        lambda t: 1 if t <= 2.5 else 2 if t <= 2.8 else 4,
        lambda t: 3.0 if any(abs(t - dip) < 0.01 for dip in dips_s) else 60.0,
        6,
    )
    assert "without a pause" in reason
    assert 3.5 <= now <= 4.2


def test_a_pause_that_was_seen_begins_anew():
    program = (ramp(60, 1e5), hold(2.5), rest(0.3), ramp(60, 1e5), hold(2.5))
    dog = Watchdog(SHORT)
    ready(dog, program)
    segments = lambda t: 1 if t <= 2.5 else 2 if t <= 2.8 else 4  # noqa: E731
    pressure = lambda t: 60.0 if t <= 2.55 or t > 2.8 else 1.0  # noqa: E731
    assert pulled(dog, segments, pressure, 5.2) is None


def test_a_program_with_pauses_is_as_long_as_it_likes():
    program = (ramp(60, 1e5), hold(2.9), RELEASE) * 10
    dog = Watchdog(SHORT)
    ready(dog, program)
    said = judge(dog, sorted(Honest().run(program), key=lambda each: each[0]))
    assert [each for each in said if isinstance(each[1], HostVented)] == []
