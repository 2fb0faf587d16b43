from __future__ import annotations

import numpy as np
import pytest

from skinlab.inference.noise import (
    MESH_ERROR,
    Whitening,
    judge,
    legendre,
    mesh_error_shapes,
    pressure_noise_mbar,
    roughness,
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


def test_whitening_is_a_root_of_the_inverse_covariance():
    rng = np.random.default_rng(0)
    sigma, shapes = rng.uniform(0.5, 2.0, 30), rng.normal(size=(30, 3))
    W = Whitening(sigma, shapes)(np.eye(30))
    covariance = np.diag(sigma**2) + shapes @ shapes.T
    np.testing.assert_allclose(W.T @ W @ covariance, np.eye(30), atol=1e-10)


def test_a_whitened_misfit_is_the_quadratic_form(table):
    rng = np.random.default_rng(1)
    pressure = np.linspace(0, 100, 60)
    model = table.model(Geometry(6.0, 1.0), pressure)
    measured = model.deflection_mm(np.array([[0.03, 1.0, 0.32]]))[0] + rng.normal(0, 0.003, 60)
    sigma, shapes = np.full(60, 0.003), mesh_error_shapes(pressure, measured)
    misfit: Misfit = model.misfit(measured, Whitening(sigma, shapes))
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


def test_white_residuals_are_seldom_called_a_misfit():
    rng = np.random.default_rng(5)
    called = [judge(rng.normal(0, 0.003, 60), np.zeros(60), 57.0, None).above for _ in range(2000)]
    assert np.mean(called) < 0.015


def test_a_smooth_residual_is_called_a_misfit_and_its_noise_is_told():
    rng = np.random.default_rng(6)
    wave = 0.006 * np.sin(np.linspace(0, 9, 60))
    found = judge(wave + rng.normal(0, 0.003, 60), np.zeros(60), 57.0, None)
    assert found.above
    assert found.value_um == pytest.approx(3.0, rel=0.3)
    assert found.assumed_um > 4.0


def test_a_stated_noise_is_taken_at_its_word():
    found = judge(np.full(60, 0.1), np.zeros(60), 57.0, 3.0)
    assert (found.value_um, found.assumed_um, found.above) == (3.0, 3.0, False)
