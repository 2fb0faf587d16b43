from __future__ import annotations

import itertools

import numpy as np
import pytest

from skinlab.curves.curve import Curve, Setup, phases_from_pressure
from skinlab.curves.program import parse_program
from skinlab.errors import InputError


def sampled(text: str, interval_s: float, noise_mbar: float, seed: int = 0):
    program = parse_program(text)
    time_s = np.arange(0, program.duration_s + 1e-9, interval_s)
    noise = np.random.default_rng(seed).normal(0, noise_mbar, len(time_s))
    return program, time_s, program.pressure_mbar(time_s) + noise


@pytest.mark.parametrize("noise_mbar", [0.0, 0.2])
@pytest.mark.parametrize("interval_s", [0.05, 0.1])
@pytest.mark.parametrize(
    "text",
    [
        "ramp:100@20",
        "ramp:100@20,ramp:0@20",
        "ramp:300@60,ramp:0@60",
        "ramp:100@80,hold:8,ramp:0@80,hold:4",
        "mode1:300,2,3,2",
        "mode3:100,2@20",
        "mode2:100@20,3",
    ],
)
def test_phases_read_from_the_pressure_are_those_of_the_program(text, interval_s, noise_mbar):
    program, time_s, pressure = sampled(text, interval_s, noise_mbar)
    asked = np.array(program.phases)[program.segment_at(time_s)]
    found = phases_from_pressure(pressure)
    # A few samples at each change of phase may go either way: near zero and the top it cannot be
    # told where a noisy ramp begins.
    changes = len(list(itertools.groupby(asked))) - 1
    assert (found != asked).sum() <= 8 * changes


def test_first_loading_ends_with_the_first_unloading():
    program, time_s, pressure = sampled("mode2:100@20,3", 0.05, 0.2)
    curve = Curve("c", Setup(6, 1, program), time_s, pressure, 0.009 * pressure)
    chosen = np.flatnonzero(curve.first_load())
    assert chosen[0] == 0
    assert chosen[-1] == 100
    assert curve.in_phases(("load",)).sum() == 101
    assert curve.in_phases(("load", "unload")).all()


def test_the_devices_own_segments_win_over_time():
    program = parse_program("ramp:100@20,ramp:0@20")
    n = 10
    segment = np.array([0] * 7 + [1] * 3)
    curve = Curve(
        "c", Setup(6, 1, program), np.arange(n) / 2, np.zeros(n), np.zeros(n), segment=segment
    )
    assert curve.phase.tolist() == ["load"] * 7 + ["unload"] * 3


def test_samples_without_the_first_ones_keep_their_phases():
    """They had counted their program from the first that is kept."""
    program = parse_program("hold:3,ramp:100@20,hold:2")
    t = np.arange(0.0, 10.01, 0.1)
    p = program.pressure_mbar(t)
    curve = Curve("c", Setup(6.0, 1.0, program), t, p, 0.01 * p)
    kept = curve.phase == "load"
    assert set(curve.only(kept).phase) == {"load"}
    after = t > 5.0
    np.testing.assert_array_equal(curve.only(after).phase, curve.phase[after])
    np.testing.assert_array_equal(curve.only(after).only(kept[after]).time_s, t[after & kept])


def test_arrays_are_copies_and_read_only():
    time_s = np.arange(6.0)
    curve = Curve("c", Setup(6, 1), time_s, time_s, time_s)
    time_s[0] = -1
    assert curve.time_s[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        curve.deflection_mm[0] = 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"time_s": [0, 1, 1, 2, 3, 4]}, "time_s does not increase at sample 3"),
        ({"pressure_mbar": [0, 1, np.nan, 3, 4, 5]}, "pressure_mbar is not finite at sample 3"),
        ({"deflection_mm": [0, 1, 2]}, "deflection_mm has (3,) values"),
    ],
)
def test_refuses_arrays_that_are_no_curve(change, says):
    arrays = {name: np.arange(6.0) for name in ("time_s", "pressure_mbar", "deflection_mm")}
    arrays |= {name: np.array(values, dtype=float) for name, values in change.items()}
    with pytest.raises(InputError) as caught:
        Curve("c", Setup(6, 1), **arrays)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("setup", "says"),
    [
        ({"aperture_mm": 5}, "no probe has this opening"),
        ({"aperture_mm": float("nan")}, "no probe has this opening"),
        ({"thickness_mm": 0}, "expected 0.1–10 mm"),
        ({"thickness_mm": float("nan")}, "expected 0.1–10 mm"),
        ({"thickness_sd_mm": 2}, "expected 0 to the thickness"),
        ({"cycle": 0}, "cycle 0: expected 1 to 10000"),
        ({"cycle": 10**20}, f"cycle {10**20}: expected 1 to 10000"),
    ],
)
def test_refuses_a_setup_that_cannot_be(setup, says):
    with pytest.raises(InputError) as caught:
        Setup(**{"aperture_mm": 6.0, "thickness_mm": 1.0, **setup})
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("column", "make", "sentence"),
    [
        ("time_s", lambda t: (1e9 * t).astype("m8[ns]"), "time_s has durations, expected numbers"),
        ("time_s", lambda t: (1e9 * t).astype("M8[ns]"), "time_s has dates, expected numbers in s"),
        ("time_s", lambda t: 3.0, "time_s has () values"),
        ("time_s", lambda t: None, "time_s has () values"),
        ("pressure_mbar", lambda p: p + 1j, "pressure_mbar has complex numbers, expected"),
        ("deflection_mm", lambda w: w > 3.0, "deflection_mm has truth values, expected numbers in"),
        ("deflection_mm", lambda w: w[:, None], "deflection_mm has (6, 1) values, expected (6,)"),
        ("deflection_mm", lambda w: w[1:], "deflection_mm has (5,) values, expected (6,)"),
        ("deflection_mm", lambda w: [f"{x} mm" for x in w], "deflection_mm: could not convert"),
        (
            "deflection_mm",
            lambda w: np.ma.masked_array(w, mask=w == 3.0),
            "c: deflection_mm is masked at sample 4; expected numbers alone: leave such samples",
        ),
    ],
)
def test_what_is_no_column_of_numbers_is_refused(column, make, sentence):
    """A mask had been ignored, and durations were taken for seconds, a billion times too many."""
    columns = {name: np.arange(6.0) for name in ("time_s", "pressure_mbar", "deflection_mm")}
    with pytest.raises(InputError) as told:
        Curve("c", Setup(6, 1), **columns | {column: make(columns[column])})
    assert sentence in str(told.value)


def test_numbers_of_any_kind_are_numbers():
    whole, masked = np.arange(6), np.ma.masked_array(np.arange(6.0), mask=False)
    curve = Curve("c", Setup(np.float32(6), np.int64(1)), whole, masked, whole.astype(object))
    assert [type(a) for a in (curve.time_s, curve.pressure_mbar)] == [np.ndarray, np.ndarray]
    assert curve.deflection_mm.dtype == float


@pytest.mark.parametrize(
    ("field", "value", "sentence"),
    [
        ("aperture_mm", "6", "aperture_mm '6': expected a number"),
        ("thickness_mm", None, "thickness_mm None: expected a number"),
        ("thickness_sd_mm", True, "thickness_sd_mm True: expected a number or None"),
        ("program", "ramp:100@20", "program 'ramp:100@20': expected a Program or None"),
        ("cycle", 1.0, "cycle 1.0: expected a whole number"),
        ("placement", 3, "placement 3: expected a text or None"),
    ],
)
def test_a_setup_of_other_types_is_refused(field, value, sentence):
    with pytest.raises(InputError, match=sentence):
        Setup(**{"aperture_mm": 6.0, "thickness_mm": 1.0} | {field: value})
    with pytest.raises(InputError, match="setup None: expected a Setup"):
        Curve("c", None, *np.arange(18.0).reshape(3, 6))
