"""A curve whose pressure is another program's is refused; a rig that is only a bad one is not."""

import re

import numpy as np
import pytest

from skinlab.curves.campaign import read_campaign
from skinlab.curves.csv import write_curve
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.curves.program_check import check_program
from skinlab.errors import InputError

RAMP = "ramp:100@20,ramp:0@20"
HOLD = "ramp:100@20,hold:5,ramp:0@20"
PULSES = "mode1:80,2,2,4"
PROGRAMS = (
    RAMP, HOLD, PULSES, "ramp:100@20", "ramp:60@5", "ramp:200@40,hold:10,release",
    "ramp:50@25,hold:2,ramp:100@25,hold:2,ramp:0@25", "mode4:100@50,3,3",
)  # fmt: skip


def measured(program, stated=None, rate_hz=20.0, lag_s=0.0, late_s=0.0, longer_s=1.0, change=None):
    """Return a curve by a program, of which another is stated; vented at its end."""
    asked = parse_program(program)
    time = np.arange(int((asked.duration_s + longer_s) * rate_hz)) / rate_hz
    path = PressurePath.of_program(asked)
    vented = PressurePath((*path.time_s, path.time_s[-1]), (*path.pressure_mbar, 0.0))
    pressure = vented.late_by(lag_s)(time - late_s)
    if change is not None:
        time, pressure = change(time, pressure)
    setup = Setup(6.0, 1.0, parse_program(stated or program))
    return Curve("c.csv", setup, time, pressure, 0.001 * pressure)


RNG = np.random.default_rng(0)


def glitches(time, pressure):
    found = pressure.copy()
    found[RNG.random(len(found)) < 0.01] = 1000.0
    return time, found


CHANGES = {
    "noise of 1 mbar in steps of 1": lambda t, p: (t, np.round(p + RNG.normal(0, 1, len(p)))),
    "cut short": lambda t, p: (t[: len(t) // 3], p[: len(t) // 3]),
    "begun later, with its clock": lambda t, p: (t[30:], p[30:]),
    "another clock": lambda t, p: (t + 1000.0, p),
    "samples lost": lambda t, p: (t[kept := RNG.random(len(t)) > 0.3], p[kept]),
    "jitter": lambda t, p: (t + RNG.uniform(-0.02, 0.02, len(t)), p),
    "10 % too much": lambda t, p: (t, 1.1 * p),
    "a leak of 15 %": lambda t, p: (t, 0.85 * p),
    "glitches": glitches,
}


@pytest.mark.parametrize("program", PROGRAMS)
class TestAsStated:
    @pytest.mark.parametrize("change", CHANGES)
    def test_whatever_a_rig_adds(self, program, change):
        check_program(measured(program, change=CHANGES[change]))

    @pytest.mark.parametrize("lag_s", [0.0, 0.05, 0.3, 0.9, 2.0])
    @pytest.mark.parametrize("late_s", [-1.0, -0.4, 0.6, 1.0])
    def test_a_rig_that_is_late(self, program, lag_s, late_s):
        check_program(measured(program, lag_s=lag_s, late_s=late_s, longer_s=3.0))

    @pytest.mark.parametrize("lost", [0, 10, 30])
    def test_where_first_samples_are_lost_segments_are_by_the_clock(self, program, lost):
        whole = measured(program)
        kept = check_program(measured(program, change=lambda t, p: (t[lost:], p[lost:])))
        assert kept.segments.tolist() == whole.segments[lost:].tolist()

    def test_of_another_clock_they_are_since_the_first_sample(self, program):
        moved = check_program(measured(program, change=lambda t, p: (t + 1000.0, p)))
        assert moved.segments.tolist() == measured(program).segments.tolist()

    def test_many_samples(self, program):
        check_program(measured(program, rate_hz=1000.0, lag_s=0.3))


@pytest.mark.parametrize(
    ("program", "stated", "says"),
    [
        (HOLD, "ramp:60@5", "it goes to 100 mbar"),
        ("ramp:100@20,hold:5", "ramp:200@40,hold:5", "it goes to 100 mbar"),
        (RAMP, "ramp:100@5,ramp:0@5", "after "),
        (HOLD, RAMP, "after "),
        (RAMP, HOLD, "after "),
        (HOLD, "ramp:100@20", "after "),
        (PULSES, RAMP, "it goes to 80 mbar"),
        (PULSES, "mode1:80,5,5,2", "after "),
        ("ramp:10@2,ramp:0@2", RAMP, "it goes to 10 mbar"),  # in kPa
    ],
)
def test_another_program_is_named(program, stated, says):
    for lag_s in (0.0, 0.2):
        with pytest.raises(InputError) as told:
            check_program(measured(program, stated, lag_s=lag_s))
        sentence = str(told.value)
        parsed = re.escape(str(parse_program(stated)))
        assert re.match(
            rf"c\.csv: the pressure does not follow its program {parsed}: {says}", sentence
        ), sentence
        assert sentence.endswith("; correct or leave out `program`")


def test_a_wrong_rate_within_what_a_late_rig_does_is_not_seen():
    """A lag of 2 s makes 80 mbar in 5 s of 160: the price of allowing for one."""
    check_program(measured("ramp:80@16", "ramp:160@32", longer_s=0.0))


def test_a_rise_until_a_height_is_left_aside():
    check_program(measured(RAMP, "until:1mm@20,ramp:0@20"))


def test_suction_that_is_recorded_as_negative_is_another_mistake():
    check_program(measured(RAMP, change=lambda t, p: (t, -p)))


def test_a_campaign_that_states_another_program_is_refused(tmp_path):
    with (tmp_path / "a.csv").open("w") as stream:
        write_curve(stream, measured(HOLD))
    entry = '[campaign]\ntitle = "t"\n[[curve]]\nfile = "a.csv"\naperture_mm = 6.0\n'
    entry += "thickness_mm = 1.0\n"
    path = tmp_path / "campaign.toml"
    for program in ("", f'program = "{HOLD}"'):
        path.write_text(entry + program)
        assert len(read_campaign(path).curves) == 1
    path.write_text(entry + 'program = "ramp:60@5"')
    with pytest.raises(InputError, match=r"a\.csv: the pressure does not follow its"):
        read_campaign(path)
