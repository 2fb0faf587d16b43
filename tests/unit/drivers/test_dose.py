from __future__ import annotations

import pytest
from honest import Honest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dose import Dose, DoseMeter, program_dose
from drivers.events import (
    Arm,
    HostVented,
    InstrumentState,
    Load,
    Sample,
    Segment,
    SegmentKind,
    State,
)
from drivers.limits import Limits
from drivers.watchdog import Watchdog

RAMP = (Segment(SegmentKind.RAMP, 100, 20), Segment(SegmentKind.RAMP, 0, 20))
PULSES = (Segment(SegmentKind.RAMP, 60, 1e5), Segment(SegmentKind.HOLD, duration_s=2),
          Segment(SegmentKind.RELEASE), Segment(SegmentKind.REST, duration_s=5)) * 3  # fmt: skip


NOTHING = Dose()


def measured(pairs, before=NOTHING):
    meter = DoseMeter(before)
    for time_s, mbar in pairs:
        meter.add(Sample(0, time_s, mbar, 0.0, 0))
    return meter.total


def test_of_a_program():
    assert program_dose(RAMP) == Dose(500, 10)
    assert program_dose(PULSES).suction_mbar_s == pytest.approx(360, rel=1e-3)
    assert program_dose(PULSES).time_s == pytest.approx(6, rel=1e-3)
    at_zero = (Segment(SegmentKind.HOLD, duration_s=9), Segment(SegmentKind.REST, duration_s=9))
    assert program_dose(at_zero) == Dose()


@pytest.mark.parametrize("program", [RAMP, PULSES])
def test_of_samples_is_that_of_the_program(program):
    samples = [e for _, e in Honest(rate_hz=100).run(program) if isinstance(e, Sample)]
    dose = measured([(s.device_time_s, s.pressure_mbar) for s in samples])
    assert dose.suction_mbar_s == pytest.approx(program_dose(program).suction_mbar_s, rel=0.05)
    assert dose.time_s == pytest.approx(program_dose(program).time_s, rel=0.08)


def test_noise_at_rest_is_no_dose():
    assert measured([(k / 20, 2 * (-1) ** k) for k in range(10_000)]) == Dose()


def test_a_clock_that_jumps_is_no_hour_of_suction():
    """One sample from 1000 s ahead was vented for, and refused the site for half a day."""
    jumped = measured([(0.0, 100), (0.05, 100), (1000.0, 100)])
    assert jumped.suction_mbar_s == pytest.approx(100 * 60.05)


def test_neither_a_dip_nor_lost_samples_make_it_less():
    whole = measured([(k / 20, 60) for k in range(201)])
    assert whole == Dose(pytest.approx(600), pytest.approx(10))
    assert measured([(0, 60), (10, 60)]) == whole
    dips = measured([(k / 20, 0 if k % 100 == 50 else 60) for k in range(201)])
    assert dips.time_s == pytest.approx(10)
    assert dips.suction_mbar_s > 590


def test_runs_add_up_and_go_on_from_before():
    once = [(k / 20, 60) for k in range(21)]
    assert measured([*once, *once], Dose(1000, 10)) == Dose(pytest.approx(1120), pytest.approx(12))


@given(st.lists(st.tuples(st.floats(0, 1e4), st.floats(-10, 500)), max_size=30))
def test_it_never_shrinks(pairs):
    meter, before = DoseMeter(), Dose()
    for time_s, mbar in pairs:
        meter.add(Sample(0, time_s, mbar, 0.0, 0))
        assert meter.total.suction_mbar_s >= before.suction_mbar_s
        assert meter.total.time_s >= before.time_s
        before = meter.total


def test_the_limit_refuses_and_vents():
    dog = Watchdog(Limits(max_dose_mbar_s=1000))
    load = Load(RAMP, 20, 100, 10)
    assert dog.refusal(load) is None
    dog.carry_dose(Dose(500, 10))
    assert dog.refusal(load) is None  # exactly
    dog.carry_dose(Dose(501, 10))
    assert "needs a dose of 500 mbar·s and the site has had 501 mbar·s" in dog.refusal(load)
    dog.commanded(load, 0.0)
    assert "1000 mbar·s allowed in one visit" in dog.refusal(Arm())
    dog.carry_dose(Dose(700, 10))
    dog.on_event(State(InstrumentState.RUNNING, "", 0.0), 0.0)
    said = []
    for k in range(200):
        now, mbar = k / 20, min(k, 200 - k)
        said += dog.on_event(Sample(k, now, mbar, 1e-4 * k, int(now > 5)), now)
        if said:
            break
    [vent] = said
    assert isinstance(vent, HostVented)
    assert "a dose of 100" in vent.reason


@pytest.mark.parametrize("pace", [0.1, 1.0, 10.0])
def test_by_the_hosts_clock_where_samples_tell_it(pace):
    """A rate that is ten times too high had made a tenth of the dose."""
    meter = DoseMeter()
    for run in range(2):
        for k in range(101):
            mbar = 60 if 0 < k < 100 else 0
            meter.add(Sample(k, pace * k / 20, mbar, 0.0, 0, 100.0 * run + k / 20))
    assert meter.total == Dose(pytest.approx(2 * 60 * 4.95), pytest.approx(10))
