"""One reading of the pressure that is none is found; what a pump does is no glitch."""

from dataclasses import replace

import numpy as np
import pytest

from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_glitches import pressure_glitches
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program

PROGRAMS = (
    "ramp:100@20,ramp:0@20", "ramp:100@80,hold:3,ramp:0@80", "ramp:300@60,release,rest:2",
    "mode1:80,2,2,4", "mode1:450,1,1,3", "ramp:400@200,ramp:0@200", "mode3:100,2@50",
    "ramp:20@5",
)  # fmt: skip


def measured(program, *, stated=True, rate_hz=20.0, noise_mbar=0.2, lag_s=0.0, seed=0):
    asked = parse_program(program)
    rng = np.random.default_rng(seed)
    time = np.arange(int(asked.duration_s * rate_hz)) / rate_hz
    pressure = PressurePath.of_program(asked).late_by(lag_s)(time)
    pressure = pressure + rng.normal(0, noise_mbar, len(time))
    return Curve("c", Setup(6.0, 1.0, asked if stated else None), time, pressure, 3e-3 * pressure)


def found(curve, noise_mbar=0.2):
    return np.flatnonzero(pressure_glitches(curve, noise_mbar)).tolist()


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("rate_hz", [5.0, 20.0, 100.0])
@pytest.mark.parametrize("program", PROGRAMS)
def test_what_a_pump_does_is_none(program, rate_hz, stated):
    for lag_s in (0.0, 0.03, 0.1, 0.4):
        assert found(measured(program, stated=stated, rate_hz=rate_hz, lag_s=lag_s)) == []


@pytest.mark.parametrize("size_mbar", [30.0, -40.0, 94.0])
@pytest.mark.parametrize("at", [[1], [57], [98], [120, 121], [30, 90]])
def test_a_reading_that_is_none_is_found(size_mbar, at):
    """One of +30 mbar made a tension of 3 % nothing, and a placement's scatter 41 %."""
    curve = measured("ramp:100@20,ramp:0@20")
    assert len(curve) == 200
    curve = Curve("c", curve.setup, curve.time_s, bent(curve, at, size_mbar), curve.deflection_mm)
    assert found(curve) == at


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("size_mbar", [30.0, 200.0, 700.0, -40.0, -700.0])
@pytest.mark.parametrize("at", [[0], [0, 1], [99], [98, 99], [0, 99]], ids=str)
def test_the_first_and_the_last_may_be_none(at, size_mbar, stated):
    """Of a curve without a program whose first reading was 200 mbar nothing was a loading."""
    curve = measured("ramp:100@20", stated=stated)
    down = measured("ramp:100@20,ramp:0@20", stated=stated)
    assert len(curve) == 100
    some = (
        at[-1] == 99 and abs(size_mbar) < 100
    )  # what the last one shows may be a vent, or a pulse
    for one in ((down,) if size_mbar < 0 else (curve,)) if some else (curve, down):
        here = [k - 100 + len(one) if k > 1 else k for k in at]
        off = replace(one, pressure_mbar=bent(one, here, size_mbar))
        assert found(off) == here
        assert (off.phase == one.phase).mean() > 0.98


@pytest.mark.parametrize(
    "course", [[0, 0, 80], [0, 80, 80], [80, 80, 0], [80, 20, 5], [80, 0, 0, 0], [40, 60, 80]]
)
def test_a_step_or_a_vent_at_an_end_is_none(course):
    """What is seen of it may be one reading, and is taken for none where nothing else says so."""
    pressure = np.array([*[course[0]] * 9, *course, *[course[-1]] * 9], dtype=float)
    curve = Curve("c", Setup(6.0, 1.0), 0.05 * np.arange(len(pressure)), pressure, 3e-3 * pressure)
    assert found(curve) == []


def bent(curve, at, size_mbar):
    pressure = curve.pressure_mbar.copy()
    pressure[at] += size_mbar
    return pressure


def test_noise_is_none():
    curve = measured("ramp:100@20,ramp:0@20", noise_mbar=4.0, rate_hz=200.0)
    assert found(curve, 4.0) == []


def test_a_short_pulse_that_was_asked_for_is_none():
    """Of 0.1 s at 10 samples a second one alone is high."""
    program = "ramp:80@2000,hold:0.1,release,rest:1,ramp:80@2000,hold:0.1,release,rest:1"
    assert found(measured(program, rate_hz=10.0)) == []


@pytest.mark.parametrize("size_mbar", [30.0, -40.0, 700.0, 5000.0])
def test_phases_are_read_without_it(size_mbar):
    """Of a curve without a program the loading ended at the first glitch."""
    curve = measured("ramp:100@20,ramp:0@20", stated=False)
    off = replace(curve, pressure_mbar=bent(curve, [57, 150], size_mbar))
    differ = np.flatnonzero(off.phase != curve.phase)
    assert len(differ) <= 2  # beside the peak, where noise tells
    assert off.first_load().sum() == pytest.approx(100, abs=2)
