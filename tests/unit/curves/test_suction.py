"""Which curves are refused for a suction that is recorded as negative."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinlab.curves.curve import Curve, Setup
from skinlab.curves.suction import check_dome, check_height, check_outward, check_suction
from skinlab.errors import InputError


def curve(pressure_mbar):
    time = 0.05 * np.arange(len(pressure_mbar))
    return Curve("c", Setup(6.0, 1.0), time, np.asarray(pressure_mbar), 0.0 * time)


def test_a_suction_below_zero_is_refused_also_after_a_rest():
    down = -np.linspace(0, 100, 50)
    for pressure in (down, np.concatenate([np.zeros(500), down]), np.append(down, [80.0])):
        with pytest.raises(InputError, match="c: pressure_mbar goes down to -100; expected"):
            check_suction(curve(pressure))


def test_noise_glitches_and_an_overshoot_of_the_vent_are_not():
    rng = np.random.default_rng(0)
    up = np.linspace(0, 100, 50)
    for pressure in (
        rng.normal(0, 0.5, 100),
        np.append(up, [-80.0, -80.0]),
        np.concatenate([up, np.full(10, -5.0)]),
        np.concatenate([np.zeros(20), [-50.0]]),
    ):
        check_suction(curve(pressure))


def test_a_pressure_in_another_unit_or_above_nothing_is_refused():
    up = np.linspace(0, 100, 50)
    for pressure in (100 * up, 1013.0 - up, -100 * up, np.concatenate([np.zeros(99), 100 * up])):
        with pytest.raises(InputError, match=r"c: pressure_mbar goes to -?10.*is its unit right"):
            check_suction(curve(pressure))
    check_suction(curve(np.append(up, [5e3, 5e3])))  # two glitches


def test_a_sensor_that_reads_the_same_all_the_time_is_refused():
    dead = curve(np.linspace(0.0, 100.0, 50))
    with pytest.raises(InputError, match="c: the deflection is 0 mm at every suction; expected a"):
        check_dome(dead)
    nothing_happens = curve(np.full(50, 0.5))
    moves = Curve(
        "c", dead.setup, dead.time_s, dead.pressure_mbar, np.where(np.arange(50) < 40, 0.0, 0.01)
    )
    for good in (nothing_happens, moves):
        check_dome(good)


def test_a_dome_that_is_higher_than_its_opening_is_wide_is_refused():
    """A curve in µm, answered with a scatter of placements of 39 %; one reading may be a glitch."""
    flat = curve(np.linspace(0.0, 100.0, 50))
    mm = 3e-3 * flat.pressure_mbar
    high = Curve("c", flat.setup, flat.time_s, flat.pressure_mbar, 1e3 * mm)
    with pytest.raises(InputError, match="c: deflection_mm goes to 300 under an opening of 6 mm"):
        check_height(high)
    glitch = np.where(np.arange(50) == 20, 9.9, mm)
    check_height(Curve("c", flat.setup, flat.time_s, flat.pressure_mbar, glitch))


def test_a_dome_below_zero_is_refused_and_a_zero_that_is_off_or_drifts_is_not():
    """Such a curve was answered by the stiffest skin that there is."""
    there_and_back = np.concatenate([np.linspace(0.0, 100.0, 50), np.linspace(98.0, 0.0, 49)])
    flat = curve(there_and_back)
    dome = 4e-3 * flat.pressure_mbar

    def check(deflection_mm):
        check_outward(replace(flat, deflection_mm=deflection_mm))

    with pytest.raises(
        InputError, match=r"c: deflection_mm falls by 0\.29 under suction; expected"
    ):
        check(0.2 - dome)
    for good in (dome - 0.6, 0.05 * dome - 1e-3 * flat.time_s, np.where(dome > 0.39, -1.0, dome)):
        check(good)
    check_outward(curve(np.full(50, 0.5)))
    check_outward(Curve("c", flat.setup, *np.empty((3, 0))))
