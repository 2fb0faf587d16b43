"""The course of the pressure that a curve was measured with: a rig behind its program."""

import numpy as np
import pytest

from skinlab.curves.campaign import Campaign
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.discrepancy.fit import Fitter
from skinlab.discrepancy.misfit import errors_of
from skinlab.discrepancy.records import fitted_lag_s, records_of, without
from skinlab.discrepancy.settings import ERRORS
from skinlab.discrepancy.table_domes import TableDomes
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.inference.pressure_course import smooth_course
from skinlab.mechanics.effects.model import felt_path
from skinlab.mechanics.fem.suction import Geometry

PROGRAM = "ramp:100@80,hold:3,ramp:0@80,hold:2"


def first_order(time_s, lag_s):
    path = PressurePath.of_program(parse_program(PROGRAM))
    return felt_path({"regulator_lag": {"tau_s": lag_s}}, path)(time_s)


def second_order(time_s, period_s, damping):
    """A regulator that overshoots: p'' = ω² (asked − p) − 2 ζ ω p', in small steps."""
    asked = PressurePath.of_program(parse_program(PROGRAM))
    step, omega = 1e-4, 2.0 * np.pi / period_s
    fine = np.arange(0.0, time_s[-1] + step, step)
    p, speed, found = 0.0, 0.0, np.empty(len(fine))
    for i, aim in enumerate(asked(fine)):
        speed += step * (omega**2 * (aim - p) - 2.0 * damping * omega * speed)
        p += step * speed
        found[i] = p
    return np.interp(time_s, fine, found)


def record_of(time_s, true_mbar, seed, step_mbar=1.0, program=PROGRAM):
    """Return the record of a rig that reads in steps, and the root mean square of its path."""
    rng = np.random.default_rng(seed)
    read = true_mbar + rng.normal(0.0, 0.26, len(time_s))
    read = step_mbar * np.round(read / step_mbar)
    w = 0.05 * np.sqrt(np.maximum(true_mbar, 0.0)) + rng.normal(0.0, 1e-3, len(time_s))
    setup = Setup(6.0, 1.1, parse_program(program))
    curve = Curve("rig", setup, time_s, read, w)
    (record,) = records_of(Campaign("made", 1.0, 0.26, (curve,)))
    off = record.path(time_s) - true_mbar
    return record, float(np.sqrt(np.mean(off**2))), off


@pytest.mark.parametrize("rate_hz", [10, 50, 200])
@pytest.mark.parametrize("lag_s", [0.05, 0.24, 0.8])
def test_a_rig_that_lags_is_followed_more_closely_than_its_readings_alone_allow(rate_hz, lag_s):
    time_s = np.arange(0.0, 7.5, 1.0 / rate_hz)
    true = first_order(time_s, lag_s)
    with_course, without = [], []
    for seed in range(5):
        record, off, _ = record_of(time_s, true, seed)
        with_course.append(off)
        noise = record.pressure_sd_mbar
        plain = smooth_course(time_s, record.pressure_mbar, noise, apart=2.0)
        path = PressurePath.of_samples(time_s, plain, ERRORS.corners[0] * noise)
        without.append(float(np.sqrt(np.mean((path(time_s) - true) ** 2))))
        assert record.pressure_sd_mbar > 0  # each sample keeps its own reading
        found = fitted_lag_s(
            PressurePath.of_program(parse_program(PROGRAM)), time_s, record.pressure_mbar
        )
        assert found == pytest.approx(lag_s, abs=0.15 / np.sqrt(rate_hz))
    assert np.mean(with_course) < 1.02 * np.mean(without)
    if rate_hz >= 50:
        assert np.mean(with_course) < 0.75 * np.mean(without)


def test_where_a_lag_is_all_that_a_rig_does_the_path_has_no_corners_of_noise():
    """A channel that looks silent, since it reads in whole mbar, errs by more than it shows.

    Its path went after the readings, with 230 to 480 corners: a play of 1 mbar took off a tenth.
    """
    time_s = np.arange(0.0, 7.5, 0.005)
    true = first_order(time_s, 0.16)
    rng = np.random.default_rng(4)
    for _ in range(5):
        read = np.round(true + rng.normal(0.0, 0.27, len(time_s)))
        w = 0.05 * np.sqrt(true) + rng.normal(0.0, 1e-3, len(time_s))
        setup = Setup(6.0, 1.1, parse_program(PROGRAM))
        curve = Curve("rig", setup, time_s, read, w)
        (record,) = records_of(Campaign("made", 1.0, None, (curve,)))
        assert np.sqrt(np.mean((record.path(time_s) - true) ** 2)) < 0.085
        assert len(record.path.time_s) < 120


def test_it_begins_where_the_rig_began():
    """The first reading is as noisy as others, and dw/dp is largest there."""
    time_s = np.arange(0.0, 7.5, 0.005)
    true = first_order(time_s, 0.24)
    assert np.mean([abs(record_of(time_s, true, s)[2][0]) for s in range(8)]) < 0.15


@pytest.mark.parametrize(("period_s", "damping"), [(0.6, 0.3), (1.5, 0.7), (0.3, 0.15)])
def test_another_rig_is_followed_as_it_is(period_s, damping):
    """No lag of the first order is like it: the readings say what it does."""
    time_s = np.arange(0.0, 7.5, 0.01)
    true = second_order(time_s, period_s, damping)
    noise = np.hypot(0.26, 1.0 / np.sqrt(12.0))
    for seed in range(3):
        _, off, each = record_of(time_s, true, seed)
        assert off < 0.6 * noise
        assert np.abs(each).max() < 4.0 * noise


def test_a_program_that_another_ran_misleads_nobody():
    """The header says one program, and the rig ran another one."""
    time_s = np.arange(0.0, 7.5, 0.01)
    true = first_order(time_s, 0.2)
    _, off, _ = record_of(time_s, true, 0, program="ramp:60@10,hold:1,ramp:0@30")
    assert off < 0.6 * np.hypot(0.26, 1.0 / np.sqrt(12.0))


@pytest.mark.parametrize("rate_hz", [10, 20])
def test_between_samples_a_late_rig_is_followed_too(rate_hz):
    """After a jump the chord of two samples is off by millibars, and with it what lags behind."""
    program, lag_s = "mode1:100,1,1,4", 0.12
    asked = PressurePath.of_program(parse_program(program))
    true = felt_path({"regulator_lag": {"tau_s": lag_s}}, asked)
    time_s = np.arange(0.0, asked.time_s[-1], 1.0 / rate_hz)
    fine_s = np.arange(0.0, time_s[-1], 0.005)
    record, _, _ = record_of(time_s, true(time_s), 3, step_mbar=0.01, program=program)
    chord = np.abs(np.interp(fine_s, time_s, true(time_s)) - true(fine_s)).max()
    assert chord > (10.0 if rate_hz == 10 else 2.5)
    assert np.abs(record.path(fine_s) - true(fine_s)).max() < 1.0


def test_a_lag_of_the_first_order_is_followed_in_closed_form():
    """After a corner: p − slope lag (1 − exp(−t / lag)); after a jump its share exp(−t / lag)."""
    t = np.linspace(0.0, 3.0, 601)
    for lag_s in (0.03, 0.1, 0.4):
        fade = np.exp(-t / lag_s)
        for path, exact in (
            (PressurePath((0.0, 0.0, 3.0), (0.0, 100.0, 100.0)), 100.0 * (1.0 - fade)),
            (PressurePath((0.0, 3.0), (0.0, 300.0)), 100.0 * (t - lag_s * (1.0 - fade))),
        ):
            felt = felt_path({"regulator_lag": {"tau_s": lag_s}}, path)(t)
            bend = 100.0 if path.time_s[1] == 0.0 else 100.0 * lag_s
            assert np.abs(felt - exact).max() < 0.0036 * bend


SOFT = (0.01, 0.5, 0.3)  # some 50 µm a mbar at 8 mm near zero


def soft_skin_under_a_late_rig(table, seed, noise_mbar=0.3):
    program = parse_program("ramp:60@60,hold:2,ramp:0@60,hold:4")
    path = PressurePath.of_program(program)
    t = np.arange(0.0, program.duration_s, 0.05)
    felt = felt_path({"regulator_lag": {"tau_s": 0.25}}, path)(t)
    w = table.model(Geometry(8.0, 1.1), felt).deflection_mm(np.array([SOFT]))[0]
    rng = np.random.default_rng(seed)
    w = w + rng.normal(0.0, 2e-3, len(t))
    read = felt + rng.normal(0.0, noise_mbar, len(t))
    curve = Curve("soft", Setup(8.0, 1.1, program), t, read, w)
    records = records_of(Campaign("made", 2.0, noise_mbar, (curve,)))
    return Fitter(records, errors_of(records), TableDomes(table), finite_elements=False)


def test_no_fit_gains_by_following_the_readings_noise_less_than_the_skin_would(table):
    """A fit of three unknowns gains χ² of three degrees over the truth, and no more."""
    true = np.array([np.log(SOFT[0]), np.log(SOFT[1] / SOFT[0]), SOFT[2]])

    def gains(fitter, fit):
        known = fitter.model(Unknowns(()))
        return float(np.square(fitter.residuals_of_many(known, true[None])).sum()) - fit.chi2

    at_readings, on_paths = [], []
    for seed in range(12):
        fitter = soft_skin_under_a_late_rig(table, seed)
        fit = fitter.fit(Unknowns(()), true)
        at_readings.append(gains(fitter, fit))
        fitter = fitter.on_paths(fit)
        on_paths.append(gains(fitter, fitter.fit(Unknowns(()), fit.u)))
    assert np.mean(at_readings) > 30.0  # what was wrong
    assert np.mean(on_paths) < 8.0


def test_what_readings_are_off_their_path_is_put_on_the_deflections(table):
    fitter = soft_skin_under_a_late_rig(table, 1)
    (old,) = fitter.records
    fit = fitter.fit(Unknowns(()), np.array([np.log(SOFT[0]), np.log(50.0), SOFT[2]]))
    moved = fitter.on_paths(fit)
    (new,) = moved.records
    np.testing.assert_array_equal(new.pressure_mbar, old.on_path_mbar)
    assert new.pressure_sd_mbar == old.pressure_sd_mbar  # it stays an error
    ramp = (old.curve.time_s > 0.5) & (old.curve.time_s < 0.9)
    skin = np.array([fit.unknowns.skin(fit.u).values])
    below, above = (
        table.model(Geometry(8.0, 1.1), old.on_path_mbar[ramp] + way).deflection_mm(skin)[0]
        for way in (-0.1, 0.1)
    )
    by_slope = (above - below) / 0.2 * old.off_path_mbar[ramp]
    assert np.abs(by_slope).max() > 5e-3
    np.testing.assert_allclose(new.off_path_mm[ramp], by_slope, atol=2e-4)
    assert moved.on_paths(fit) is None
    # Samples that are left out take theirs with them.
    (kept,) = without(moved.records, [ramp])
    np.testing.assert_array_equal(kept.straight_mm, new.straight_mm[ramp])


def test_a_record_that_follows_its_program_is_on_its_path(table):
    fitter = soft_skin_under_a_late_rig(table, 1)
    (late,) = fitter.records
    curve = late.curve
    asked = PressurePath.of_program(curve.setup.program)(curve.time_s)
    curve = Curve("prompt", curve.setup, curve.time_s, asked, curve.deflection_mm)
    records = records_of(Campaign("made", 2.0, 0.05, (curve,)))
    fitter = Fitter(records, errors_of(records), TableDomes(table), finite_elements=False)
    assert fitter.on_paths(fitter.fit(Unknowns(()), np.array([-4.6, 3.9, 0.3]))) is None
