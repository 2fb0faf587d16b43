"""Paths of pressure: from programs, from noisy samples."""

import numpy as np
import pytest

from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.errors import InputError


@pytest.mark.parametrize(
    "text", ["ramp:100@20", "ramp:100@80,hold:8,ramp:0@80,hold:4", "mode1:100,2,1,3",
             "ramp:50@10,release,rest:2,ramp:20@5"],
)  # fmt: skip
def test_a_programs_path_is_its_pressure(text):
    program = parse_program(text)
    path = PressurePath.of_program(program)
    times = np.linspace(-1, program.duration_s + 1, 500)
    np.testing.assert_array_equal(path(times), program.pressure_mbar(times))
    assert path.top_mbar == program.max_pressure_mbar
    assert hash(path) == hash(PressurePath.of_program(parse_program(text)))


def test_noise_does_not_become_corners():
    program = parse_program("ramp:100@80,hold:8,ramp:0@80,hold:4")
    times = np.arange(0, 14.5, 0.05)
    rng = np.random.default_rng(5)
    samples = program.pressure_mbar(times) + 0.2 * rng.standard_normal(len(times))
    path = PressurePath.of_samples(times, samples, 0.8)
    assert len(path.time_s) < 12
    assert np.abs(path(times) - samples).max() <= 0.8
    assert np.abs(path(times) - program.pressure_mbar(times)).max() < 1.5


def test_a_straight_line_needs_its_ends():
    times = np.linspace(0, 5, 101)
    path = PressurePath.of_samples(times, 20 * times, 1e-6)
    assert path == PressurePath((0.0, 5.0), (0.0, 100.0))


@pytest.mark.parametrize(
    ("times", "pressures", "match"),
    [
        ((0.0,), (0.0,), "two knots or more"),
        ((0.0, 1.0), (0.0,), "two knots or more"),
        ((0.0, 2.0, 1.0), (0.0, 1.0, 2.0), "in order of time"),
        ((0.0, np.nan), (0.0, 1.0), "finite"),
        ((0.0, 1.0), (0.0, np.inf), "finite"),
    ],
)
def test_what_is_no_path(times, pressures, match):
    with pytest.raises(InputError, match=match):
        PressurePath(times, pressures)
    with pytest.raises(InputError, match=match):
        PressurePath.of_samples(np.array(times), np.array(pressures), 0.1)


def test_a_tolerance_is_positive():
    with pytest.raises(InputError, match="tolerance_mbar"):
        PressurePath.of_samples(np.array([0.0, 1.0]), np.array([0.0, 1.0]), 0.0)


@pytest.mark.parametrize("lag_s", [0.05, 0.15, 0.3, 1.5])
@pytest.mark.parametrize("text", ["mode1:80,1,1,3", "mode3:100,1@20"])
def test_what_is_late_follows_its_equation_within_a_steep_rise_too(text, lag_s):
    # `mode1` rises "at once", in 40 ms: one chord over them was off by 1.3 % of it.
    path = PressurePath.of_program(parse_program(text))
    late, felt = path.late_by(lag_s), 0.0
    for a, b, p, q in zip(
        path.time_s, path.time_s[1:], path.pressure_mbar, path.pressure_mbar[1:], strict=False
    ):
        if b > a:  # lag dx/dt = p(t) − x
            since = np.linspace(0.0, b - a, 50)
            behind = lag_s * (q - p) / (b - a)
            exact = (
                p + behind * (since / lag_s - 1.0) + (felt - p + behind) * np.exp(-since / lag_s)
            )
            np.testing.assert_allclose(late(a + since), exact, atol=0.004 * path.top_mbar)
            felt = exact[-1]
