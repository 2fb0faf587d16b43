"""The marginal likelihood and what is weighed by it, against dense algebra and known answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, t

from skinlab.inference.covariance import Covariance, OrnsteinUhlenbeck, independent
from skinlab.inference.error_models.heavy_tails import bound, weights
from skinlab.inference.likelihood import LinearModel
from skinlab.mechanics.fem import kernel

TIME = np.sort(np.random.default_rng(9).uniform(0, 5, 50))  # uneven


def dense(covariance: Covariance) -> np.ndarray:
    W = covariance.whiten(np.eye(covariance.count))
    return np.linalg.inv(W.T @ W)


def problem(seed=0, k=3):
    rng = np.random.default_rng(seed)
    covariance = Covariance(
        rng.uniform(0.5, 2.0, 50),
        rng.normal(size=(50, 2)),
        (20, 50),
        OrnsteinUhlenbeck(1.5, 0.4),
        TIME,
    )
    slopes = rng.normal(size=(50, k))
    root = rng.normal(size=(k, k))
    return LinearModel(rng.normal(size=50) * 2, slopes, root @ root.T + np.eye(k)), covariance


def test_the_marginal_likelihood_is_that_of_dense_algebra():
    linear, covariance = problem()
    prior = np.linalg.inv(linear.precision)
    whole = dense(covariance) + linear.slopes_mm @ prior @ linear.slopes_mm.T
    expected = multivariate_normal(np.zeros(50), whole).logpdf(linear.residual_mm)
    assert linear.log_marginals([covariance])[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("library", [kernel.library, lambda: None], ids=["compiled", "numpy"])
def test_what_curves_err_by_alone_is_integrated_out_curve_by_curve(library, monkeypatch):
    """Zeros of each curve and what all share, in other sizes and places, many at once."""
    monkeypatch.setattr(kernel, "library", library)
    monkeypatch.setattr("skinlab.inference.covariance.WORTH_SHARING", 0)  # of curves this short
    linear, _ = problem(2)
    rng = np.random.default_rng(5)
    ends = (15, 15, 30, 50)  # the second has no samples
    each = np.searchsorted(ends, np.arange(50), side="right")
    zeros = (each[:, None] == np.array([0, 2, 3])).astype(float)
    shapes = np.hstack([zeros, rng.normal(size=(50, 2)), zeros * rng.normal(size=(50, 3))])
    ou = OrnsteinUhlenbeck(1.5, 0.4)
    one = Covariance(rng.uniform(0.5, 2.0, 50), shapes, ends, ou, np.tile(TIME[:25], 2))
    larger = replace(one, sizes=rng.uniform(0.1, 3.0, 8))
    elsewhere = replace(one, shapes_mm=shapes[::-1].copy())
    several = [one, larger, elsewhere, replace(larger, variance_mm2=2.0 * one.variance_mm2)]
    prior = np.linalg.inv(linear.precision)
    expected = [
        multivariate_normal(
            np.zeros(50), dense(c) + linear.slopes_mm @ prior @ linear.slopes_mm.T
        ).logpdf(linear.residual_mm)
        for c in several
    ]
    assert linear.log_marginals(several) == pytest.approx(expected, rel=1e-9)


def test_with_a_flat_prior_it_is_restricted_likelihood():
    """Differences between covariances are those of REML (Patterson and Thompson 1971)."""
    linear, covariance = problem(1)
    flat = LinearModel(linear.residual_mm, linear.slopes_mm, 1e-9 * np.eye(3))
    other = Covariance(
        2 * covariance.variance_mm2, covariance.columns_mm, covariance.ends, covariance.ou, TIME
    )

    def reml(c):
        X, y, V = linear.slopes_mm, linear.residual_mm, np.linalg.inv(dense(c))
        XVX = X.T @ V @ X
        P = V - V @ X @ np.linalg.solve(XVX, X.T @ V)
        return -0.5 * (-np.linalg.slogdet(V)[1] + np.linalg.slogdet(XVX)[1] + y @ P @ y)

    got = flat.log_marginals([covariance])[0] - flat.log_marginals([other])[0]
    assert got == pytest.approx(reml(covariance) - reml(other), rel=1e-6)


def test_each_sample_left_out_is_predicted_by_the_others():
    linear, covariance = problem(2)
    whole = dense(covariance) + linear.slopes_mm @ np.linalg.solve(
        linear.precision, linear.slopes_mm.T
    )
    off, variance = linear.left_out(covariance)
    i = 17
    others = np.arange(50) != i
    weights = np.linalg.solve(whole[np.ix_(others, others)], whole[others, i])
    assert off[i] == pytest.approx(linear.residual_mm[i] - weights @ linear.residual_mm[others])
    assert variance[i] == pytest.approx(whole[i, i] - weights @ whole[others, i])


def test_a_long_curves_diagonal_is_that_of_the_whole_inverse():
    """It is taken piece by piece: where pieces met it was off by 28 %."""
    time = np.arange(600) / 200
    process = OrnsteinUhlenbeck(5e-3, 0.3)
    covariance = Covariance(np.full(600, 1e-6), np.zeros((600, 0)), (600,), process, time)
    apart = np.abs(time[:, None] - time)
    whole = 1e-6 * np.eye(600) + 25e-6 * np.exp(-apart / 0.3)
    linear = LinearModel(np.zeros(600), np.zeros((600, 0)), np.zeros((0, 0)))
    np.testing.assert_allclose(
        linear.scores(covariance)[1], np.diag(np.linalg.inv(whole)), rtol=1e-9
    )


def test_the_white_part_is_what_the_posterior_says():
    linear, covariance = problem(3)
    whole = dense(covariance) + linear.slopes_mm @ np.linalg.solve(
        linear.precision, linear.slopes_mm.T
    )
    D = np.diag(covariance.variance_mm2)
    mean = D @ np.linalg.solve(whole, linear.residual_mm)
    variance = np.diag(D - D @ np.linalg.solve(whole, D))
    expected = (mean**2 + variance) / covariance.variance_mm2
    np.testing.assert_allclose(linear.white_square(covariance), expected, rtol=1e-7)


@pytest.mark.parametrize("freedom", [3.0, 6.0])
def test_the_mixtures_bound_is_students_density(freedom):
    """With nothing but white noise it is exact: pints' StudentTLogLikelihood, number for number."""
    scale = 2.5
    r = np.random.default_rng(4).standard_t(freedom, 80) * scale
    square = (r / scale) ** 2
    gaussian = independent(scale / np.sqrt(weights(square, freedom))).log_density(r)
    expected = t(freedom, 0, scale).logpdf(r).sum()
    assert gaussian + bound(square, freedom).sum() == pytest.approx(expected, rel=1e-10)
