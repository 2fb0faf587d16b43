"""The covariance against dense matrices: even and uneven times, lost samples, several curves."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from skinlab.inference.covariance import Covariance, OrnsteinUhlenbeck, independent, products
from skinlab.mechanics.fem import kernel


def dense(covariance: Covariance) -> np.ndarray:
    whole = np.diag(covariance.variance_mm2) + covariance.columns_mm @ covariance.columns_mm.T
    if covariance.ou is not None:
        t = covariance.time_s
        process = covariance.ou.size_mm**2 * np.exp(-np.abs(t[:, None] - t) / covariance.ou.time_s)
        curve = np.searchsorted(covariance.ends, np.arange(covariance.count), side="right")
        whole += np.where(curve[:, None] == curve, process, 0.0)
    return whole


@st.composite
def covariances(draw):
    curves = draw(st.integers(1, 3))
    counts = [draw(st.integers(2, 15)) for _ in range(curves)]
    u = sum(counts)
    gaps = draw(arrays(float, u, elements=st.floats(0.001, 2.0)))
    time = np.concatenate([np.cumsum(g) for g in np.split(gaps, np.cumsum(counts)[:-1])])
    ou = draw(
        st.none()
        | st.builds(OrnsteinUhlenbeck, size_mm=st.floats(1e-3, 20.0), time_s=st.floats(0.01, 10.0))
    )
    columns = draw(arrays(float, (u, draw(st.integers(0, 3))), elements=st.floats(-3.0, 3.0)))
    variance = draw(arrays(float, u, elements=st.floats(0.01, 10.0)))
    ends = tuple(int(e) for e in np.cumsum(counts))
    return Covariance(variance, columns, ends, ou, time)


@given(covariances())
def test_whitening_and_determinant_are_those_of_the_dense_matrix(covariance):
    whole = dense(covariance)
    W = covariance.whiten(np.eye(covariance.count))
    np.testing.assert_allclose(W.T @ W @ whole, np.eye(covariance.count), atol=1e-7)
    assert covariance.log_determinant == pytest.approx(np.linalg.slogdet(whole)[1], abs=1e-7)


@given(covariances())
def test_products_are_those_of_whitened_values(covariance):
    values = np.random.default_rng(0).normal(size=(covariance.count, 3))
    white = covariance.whiten(values)
    other = replace(covariance, variance_mm2=2.0 * covariance.variance_mm2)
    longer = replace(covariance, shapes_mm=1.5 * covariance.shapes_mm)
    for library in (kernel.library, lambda: None):  # compiled where it is there, and numpy
        with patch.object(kernel, "library", library):
            for others in ([other, covariance], [other, covariance, longer]):
                found, log_determinant = products(others, values)
                np.testing.assert_allclose(found[1], white.T @ white, rtol=1e-6, atol=1e-8)
                expected = [one.log_determinant for one in others]
                assert log_determinant == pytest.approx(expected, abs=1e-7)


def test_as_many_columns_as_samples_nearly():
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(90, 70))
    one = Covariance(np.full(90, 0.3), columns, (90,), OrnsteinUhlenbeck(1.0, 0.5), np.arange(90.0))
    values = rng.normal(size=(90, 2))
    white = one.whiten(values)
    np.testing.assert_allclose(products([one], values)[0][0], white.T @ white, rtol=1e-8)


def test_what_is_no_covariance_is_an_error():
    one = Covariance(np.array([1.0, -2.0, 1.0]), np.zeros((3, 0)), (3,))
    with pytest.raises(np.linalg.LinAlgError):
        products([one], np.ones((3, 1)))


@pytest.mark.long
@given(covariances(), st.randoms(use_true_random=False))
def test_colouring_undoes_whitening(covariance, random):
    values = np.random.default_rng(random.randrange(2**32)).normal(size=(covariance.count, 2))
    np.testing.assert_allclose(covariance.colour(covariance.whiten(values)), values, atol=1e-7)
    np.testing.assert_allclose(
        covariance.whiten(values[:, 0]), covariance.whiten(values)[:, 0], atol=1e-10
    )


@given(covariances(), st.data())
def test_lost_samples_leave_the_covariance_of_the_others(covariance, data):
    kept = data.draw(arrays(bool, covariance.count, elements=st.booleans()))
    if not kept.any():
        return
    part = covariance.only(kept)
    whole = dense(covariance)[np.ix_(kept, kept)]
    W = part.whiten(np.eye(part.count))
    np.testing.assert_allclose(W.T @ W @ whole, np.eye(part.count), atol=1e-7)


def test_the_density_is_scipys():
    from scipy.stats import multivariate_normal

    rng = np.random.default_rng(0)
    time = np.sort(rng.uniform(0, 5, 40))
    covariance = Covariance(
        rng.uniform(1, 2, 40), rng.normal(size=(40, 2)), (40,), OrnsteinUhlenbeck(1.5, 0.3), time
    )
    r = rng.normal(size=40)
    expected = multivariate_normal(np.zeros(40), dense(covariance)).logpdf(r)
    assert covariance.log_density(r) == pytest.approx(expected, rel=1e-10)


def test_an_even_process_is_the_ar1_of_the_textbooks():
    """As pints' AR1LogLikelihood: log N(x₁; 0, s²) + Σ log N(xᵢ; ρ xᵢ₋₁, s² (1 − ρ²))."""
    from scipy.stats import norm

    rho, s, n = 0.9, 3.0, 60
    x = np.random.default_rng(1).normal(0, s, n)
    process = OrnsteinUhlenbeck(s, -0.05 / np.log(rho))
    covariance = Covariance(np.full(n, 1e-9), np.zeros((n, 0)), (n,), process, 0.05 * np.arange(n))
    expected = (
        norm.logpdf(x[0], 0, s) + norm.logpdf(x[1:], rho * x[:-1], s * np.sqrt(1 - rho**2)).sum()
    )
    assert covariance.log_density(x) == pytest.approx(expected, rel=1e-6)


def test_drawn_errors_have_the_covariance():
    rng = np.random.default_rng(2)
    covariance = Covariance(
        np.full(6, 0.5),
        np.ones((6, 1)),
        (3, 6),
        OrnsteinUhlenbeck(2.0, 0.5),
        np.tile([0, 0.2, 1.0], 2),
    )
    drawn = np.array(
        [covariance.colour(rng.standard_normal(covariance.count)) for _ in range(20_000)]
    )
    np.testing.assert_allclose(np.cov(drawn.T), dense(covariance), atol=0.2)


def test_what_the_columns_did_is_taken_off():
    covariance = independent(np.ones(50), 30.0 * np.ones((50, 1)))
    noise = np.random.default_rng(3).normal(size=50)
    left = covariance.without_columns(noise + 25.0)
    np.testing.assert_allclose(left, noise - noise.mean(), atol=0.05)
    products = [
        sum(
            v[1:] @ v[:-1]
            for v in [
                covariance.without_columns(covariance.colour(rng.standard_normal(covariance.count)))
            ]
        )
        for rng in map(np.random.default_rng, range(3000))
    ]
    assert np.mean(products) == pytest.approx(covariance.expected_product(1), abs=0.5)


@given(covariances())
def test_random_effects_of_other_sizes_share_one_decomposition_and_nothing_else(covariance):
    values = np.random.default_rng(0).normal(size=(covariance.count, 2))
    sizes = np.random.default_rng(1).uniform(0.1, 3.0, covariance.columns_mm.shape[1])
    longer = replace(covariance, sizes=sizes)
    turned = replace(covariance, shapes_mm=covariance.shapes_mm[::-1].copy())
    several = [covariance, longer, turned, longer]
    with patch("skinlab.inference.covariance.WORTH_SHARING", 0):  # of curves this short, too
        found, log_determinant = products(several, values)
    for i, one in enumerate(several):
        alone, log_alone = products([one], values)
        np.testing.assert_allclose(found[i], alone[0], rtol=1e-7, atol=1e-8)
        assert log_determinant[i] == pytest.approx(log_alone[0], abs=1e-7)
