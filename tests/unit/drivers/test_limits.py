from __future__ import annotations

import pytest

from drivers.errors import LocalProtocolError
from drivers.events import Hello, Load, Segment, SegmentKind
from drivers.limits import Bounds, Limits, check_load, program_bounds

K = SegmentKind
UP = Segment(K.RAMP, target_mbar=100, rate_mbar_per_s=20)
DOWN = Segment(K.RAMP, target_mbar=0, rate_mbar_per_s=20)
RELEASE = Segment(K.RELEASE)


def hold(seconds):
    return Segment(K.HOLD, duration_s=seconds)


def rest(seconds):
    return Segment(K.REST, duration_s=seconds)


def hello(**limits):
    values = {"max_pressure_mbar": 500, "max_suction_s": 60, "min_rate_hz": 1, "max_rate_hz": 1000}
    return Hello(
        dialect="reference", protocol_version=1, model="m", firmware="f", serial_number="s",
        aperture_mm=6, simulated=True, **(values | limits),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("segments", "pressure", "suction"),
    [
        ((UP, DOWN), 100, 10),
        ((UP, DOWN, UP, DOWN), 100, 20),  # a ramp to zero is no pause
        ((UP, hold(3), RELEASE, UP, hold(1)), 100, 8),
        ((UP, hold(3), rest(5), UP), 100, 8),
        ((UP, hold(3), rest(0.1), UP), 100, 13.1),  # too short for a pause
        ((UP, DOWN, hold(100)), 100, 10),
        ((rest(1000),), 0, 0),
    ],
)
def test_bounds_of_a_program(segments, pressure, suction):
    assert program_bounds(segments) == Bounds(pressure, pytest.approx(suction))


@pytest.mark.parametrize(
    ("load", "limits", "says", "match"),
    [
        (Load((UP,), 20, 500.001, 5), Limits(), {}, "500.001 mbar.*limit of the driver"),
        (Load((UP,), 20, 100, 5), Limits(max_pressure_mbar=50), {}, "100 mbar.*0 to 50 mbar"),
        (Load((UP,), 20, 100, 5), Limits(), {"max_pressure_mbar": 99}, "99 mbar.*the instrument"),
        (Load((UP, hold(56)), 20, 100, 61), Limits(), {}, "61 s.*60 s.*limit of the driver"),
        (Load((UP,), 20, 100, 5), Limits(), {"max_suction_s": 4}, "5 s.*4 s.*the instrument"),
        (Load((UP,), 0.5, 100, 5), Limits(), {}, "0.5 Hz.*1 to 1000 Hz"),
        (Load((UP,), 20, 99, 5), Limits(), {}, "above the program's own"),
        (Load((UP,), 20, 100, 4), Limits(), {}, "above the program's own"),
        (Load((UP,), 20, float("nan"), 5), Limits(), {}, "nan"),
        (Load((), 20, 100, 5), Limits(), {}, "empty"),
    ],
)
def test_beyond_a_limit(load, limits, says, match):
    with pytest.raises(LocalProtocolError, match=match):
        check_load(load, limits, hello(**says))


def test_at_the_limits():
    up = Segment(K.RAMP, target_mbar=500, rate_mbar_per_s=100)
    check_load(Load((up, hold(55)), 1000, 500, 60), Limits(), hello())
    check_load(Load((UP, *[hold(0.1)] * 550), 1, 100, 60), Limits(), hello())


@pytest.mark.parametrize(
    "change",
    [
        {"max_pressure_mbar": 501},
        {"max_suction_s": 61},
        {"stale_s": 0},
        {"vent_time_s": float("nan")},
    ],
)
def test_limits_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        Limits(**change)
