from __future__ import annotations

import numpy as np
import pytest

from skinlab.inference.covariance import independent
from skinlab.inference.error_models.words import contradiction, contradiction_in
from skinlab.inference.noise import (
    MESH_ERROR,
    contradicted_pressure_noise,
    jumps,
    legendre,
    mesh_error_shapes,
    pressure_error_mm,
    pressure_noise_mbar,
    roughness,
    sample_sd_mm,
    slope_mm_per_mbar,
)
from skinlab.mechanics.fem.suction import Geometry
from skinlab.tables.misfit import Misfit

TIME = np.arange(400) / 20.0


def test_the_shapes_are_orthonormal_polynomials():
    x = (np.arange(20_000) + 0.5) / 20_000
    shapes = legendre(x, 5)
    np.testing.assert_allclose(shapes.T @ shapes / len(x), np.eye(5), atol=1e-4)
    np.testing.assert_allclose(shapes[:, 0], 1.0)


def test_a_whitened_misfit_is_the_quadratic_form(table):
    rng = np.random.default_rng(1)
    pressure = np.linspace(0, 100, 60)
    model = table.model(Geometry(6.0, 1.0), pressure)
    measured = model.deflection_mm(np.array([[0.03, 1.0, 0.32]]))[0] + rng.normal(0, 0.003, 60)
    sigma, shapes = np.full(60, 0.003), mesh_error_shapes(pressure, measured)
    misfit: Misfit = model.misfit(measured, independent(sigma, shapes))
    candidates = np.array([[0.03, 1.0, 0.32], [0.02, 2.0, 0.4], [0.05, 2.0, 0.3]])
    residual = model.deflection_mm(candidates) - measured
    inverse = np.linalg.inv(np.diag(sigma**2) + shapes @ shapes.T)
    expected = np.einsum("ni,ij,nj->n", residual, inverse, residual)
    np.testing.assert_allclose(misfit(candidates), expected, rtol=1e-8)


def test_the_mesh_errs_by_the_share_that_was_measured():
    shapes = mesh_error_shapes(np.linspace(0, 100, 101), np.full(101, 1.0))
    np.testing.assert_allclose(np.sqrt((shapes**2).mean(axis=0)), MESH_ERROR, rtol=0.1)


def test_roughness_is_the_noise_and_not_the_course():
    rng = np.random.default_rng(2)
    smooth = 0.4 * np.log1p(TIME) + 0.02 * np.sin(TIME)
    found = [roughness(smooth + rng.normal(0, 0.003, len(TIME))) for _ in range(50)]
    assert np.mean(found) == pytest.approx(0.003, rel=0.03)
    assert np.isnan(roughness(np.ones(2)))


def test_pressure_noise_is_seen_through_the_ramp():
    rng = np.random.default_rng(3)
    ramp = 20.0 * TIME[:101]
    pump = ramp - 3.0 * (1 - np.exp(-ramp / 10))  # lags behind at first
    found = [
        pressure_noise_mbar(TIME[:101], np.round(pump + rng.normal(0, 0.2, 101), 1))
        for _ in range(50)
    ]
    assert np.mean(found) == pytest.approx(0.2, rel=0.1)


@pytest.mark.parametrize(
    "pressure",
    [
        np.linspace(0, 100, 51),
        100.0 * np.linspace(0, 1, 51) ** 2,
        np.round(np.linspace(0, 100, 51) ** 1.1, 3),
        np.repeat(np.arange(0, 100, 10.0), 5),  # steps: corners are no noise
    ],
)
def test_a_smooth_pressure_has_no_noise(pressure):
    assert pressure_noise_mbar(np.arange(len(pressure)) * 0.1, pressure) == 0.0


def test_slopes_agree_with_the_models(table):
    pressure = np.sort(np.random.default_rng(4).uniform(0, 100, 80))
    for parameters in ([0.03, 1.0, 0.32], [0.008, 3.0, 0.25], [0.15, 0.5, 0.45]):
        at = np.array([parameters])
        model, up, down = (
            table.model(Geometry(6.0, 1.0), pressure + shift).deflection_mm(at)[0]
            for shift in (0.0, 0.05, -0.05)
        )
        np.testing.assert_allclose(
            slope_mm_per_mbar(pressure, model), (up - down) / 0.1, rtol=0.05, atol=2e-5
        )


def test_what_pressure_noise_does_is_its_slope_or_what_the_bend_leaves_of_that():
    pressure = np.linspace(0, 100, 101)
    curve = 0.1 * np.cbrt(pressure + 0.5)  # steep near zero
    found = pressure_error_mm(pressure, curve, np.full(101, 0.5))
    straight = slope_mm_per_mbar(pressure, curve) * 0.5
    np.testing.assert_allclose(found[20:], straight[20:], rtol=0.01)
    z = np.random.default_rng(5).standard_normal(20_000)
    at = pressure[5] + 0.5 * z
    expected = np.sqrt(np.mean((0.1 * np.cbrt(at + 0.5) - curve[5]) ** 2))
    assert found[5] == pytest.approx(expected, rel=0.05)


def test_one_glitch_is_not_rough():
    noise = np.random.default_rng(7).normal(0, 0.003, 100)
    before = roughness(noise)
    noise[70] += 0.3
    assert roughness(noise) == pytest.approx(before, rel=0.1)


def test_a_step_is_told_from_noise_and_from_what_bends():
    n = np.arange(101)
    for seed in range(20):
        noise = 3.0 * np.random.default_rng(seed).standard_normal(len(n))
        assert jumps(noise + 60.0 * (n > 50))
        assert not jumps(noise)
        assert not jumps(noise + 60.0 * np.exp(-n / 4))
    assert not jumps(np.zeros(10))


def test_steps_of_the_readings_are_no_slips():
    """A slow curve rises by one step of 10 µm at a time, and what is left of it is saw teeth."""
    n, noise = np.arange(201), np.random.default_rng(1)
    found = []
    for seed in range(20):
        rises = np.cumsum(np.full(len(n), 0.17 + 0.01 * seed))
        read = 10.0 * np.round((rises + noise.normal(0.0, 0.5, len(n))) / 10.0)
        found.append(jumps(read - rises, 10.0))
        assert jumps(read - rises + 60.0 * (n > 100), 10.0)
    assert sum(found) == 0


def channels(rng, sd_mbar):
    """Return times and readings of pressure channels that drift, of five programs."""
    for n, hz in ((51, 10.0), (101, 20.0), (501, 100.0)):
        t = np.arange(n) / hz
        ramp = 100.0 * t / t[-1]
        steps, hold = 25.0 * np.floor(ramp / 20.0), np.minimum(3.0 * ramp, 100.0)
        for program in (ramp, np.minimum(ramp, 100.0 - ramp), hold, steps, 100 * np.tanh(t)):
            drift = 0.3 * np.cumsum(np.sqrt(1.0 / hz) * rng.standard_normal(n))
            readings = program + drift + sd_mbar * rng.standard_normal(n)
            yield t, readings
            yield t, 0.5 * np.round(readings / 0.5)


@pytest.mark.parametrize(
    ("true_mbar", "stated_mbar", "at_least", "at_most"),
    [
        (0.05, 0.05, 0.0, 0.01), (0.2, 0.2, 0.0, 0.01), (2.0, 2.0, 0.0, 0.01),
        (2.0, 0.1, 0.99, 1.0), (0.05, 3.0, 0.5, 1.0),
    ],
)  # fmt: skip
def test_a_stated_pressure_noise_is_contradicted_by_the_readings(
    true_mbar, stated_mbar, at_least, at_most
):
    """Half of the channels are rounded to 0.5 mbar, of which 0.05 mbar of noise do not show."""
    rng = np.random.default_rng(173)
    each = [channel for _ in range(7) for channel in channels(rng, true_mbar)]
    found = [contradicted_pressure_noise(t, p, stated_mbar) is not None for t, p in each]
    assert len(found) >= 200
    assert at_least <= np.mean(found) <= at_most


def test_a_pressure_that_is_a_program_contradicts_nothing():
    t = np.arange(101) / 20.0
    assert contradicted_pressure_noise(t, 20.0 * t, 3.0) is None
    assert contradicted_pressure_noise(t[:15], 20.0 * t[:15], 0.0) is None


def test_a_sample_has_the_noise_of_both_channels():
    """The screen took the noise that the readings showed where another was stated."""
    rng = np.random.default_rng(1)
    time_s = np.arange(200) / 20
    smooth = 10.0 * time_s
    mbar = smooth + rng.normal(0.0, 0.5, 200)
    mm = 0.004 * smooth
    found = sample_sd_mm(time_s, mbar, mm, 3.0, None)
    stated = sample_sd_mm(time_s, mbar, mm, 3.0, 2.0)
    still = sample_sd_mm(time_s, mbar, mm, 3.0, 0.0)
    inside = slice(10, -10)
    assert still[inside] == pytest.approx(3e-3)
    assert found[inside] == pytest.approx(np.hypot(3e-3, 0.004 * 0.5), rel=0.15)
    assert stated[inside] == pytest.approx(np.hypot(3e-3, 0.004 * 2.0), rel=0.1)


@pytest.mark.parametrize(("stated_um", "found_um"), [(3.0, 12.34), (250.0, 1.5e3), (0.05, 1e-3)])
def test_a_contradiction_is_read_as_it_is_told(stated_um, found_um):
    clause = contradiction(stated_um, found_um) + " with errors that last"
    told = contradiction_in(f"lasts 2 s; {clause}; steps")
    assert told is not None
    assert told[:2] == pytest.approx((stated_um, found_um), rel=0.005)
    assert told.clause == clause
    assert contradiction_in("residuals are as white noise's") is None
