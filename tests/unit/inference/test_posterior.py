"""The draws against posteriors that are known, in closed form or by brute force."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import gamma

from skinlab.inference.intervals import (
    correlation,
    is_logarithmic,
    most_of_the_range,
    summary,
)
from skinlab.inference.joint import GaussianPrior, JointMisfit
from skinlab.inference.optimise import polish
from skinlab.inference.posterior import _evened, _half_power, sample
from skinlab.inference.problem import Problem
from skinlab.inference.settings import INTERVALS, POSTERIOR
from skinlab.parameters import Space

CUBE = Space.box(("a", "b", "c"), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


class Residuals:
    """A sum of squares from functions of (n, k) points."""

    rest = 0.0

    def __init__(self, differences, slopes):
        self.differences, self.slopes = differences, slopes

    def __call__(self, parameters):
        return (self.differences(parameters) ** 2).sum(axis=1)


def linear(J, centre):
    return Residuals(lambda p: (p - centre) @ J.T, lambda p: np.tile(J, (len(p), 1, 1)))


def banana(width=0.01):
    """A valley b = 0.2 + 2 (a − 0.5)², `width` wide and all of a long; c is not fixed at all."""

    def differences(p):
        return np.stack(
            [(p[:, 1] - 0.2 - 2 * (p[:, 0] - 0.5) ** 2) / width, (p[:, 0] - 0.5) / 0.15], axis=1
        )

    def slopes(p):
        s = np.zeros((len(p), 2, 3))
        s[:, 0, 0] = -4 * (p[:, 0] - 0.5) / width
        s[:, 0, 1] = 1 / width
        s[:, 1, 0] = 1 / 0.15
        return s

    return Residuals(differences, slopes)


def quantile(values, weight, q):
    order = np.argsort(values)
    return np.interp(q, np.cumsum(weight[order]), values[order])


def test_a_gaussian_comes_out_with_its_mean_and_covariance():
    J = np.linalg.inv(
        np.linalg.cholesky(np.array([[4, 3.8, 0], [3.8, 4, 0.3], [0, 0.3, 1.0]]) * 1e-4)
    )
    centre = np.array([0.5, 0.45, 0.55])
    draws = sample(CUBE, linear(J, centre), centre[None], np.random.default_rng(0))
    mean = draws.weight @ draws.unit
    covariance = (draws.unit - mean).T @ ((draws.unit - mean) * draws.weight[:, None])
    expected = np.linalg.inv(J.T @ J)
    np.testing.assert_allclose(mean, centre, atol=2e-3)
    np.testing.assert_allclose(covariance, expected, atol=0.1 * expected.max())
    assert draws.effective > 500
    assert draws.weight.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("width", [0.1, 0.01, 0.001])
def test_a_curved_valley_is_followed(width):
    """Given a, b is Gaussian and c is even: the marginals are those of a alone, in closed form."""
    problem = banana(width)
    found = polish(CUBE, problem, np.array([[0.2, 0.8, 0.5], [0.9, 0.1, 0.5]]))
    draws = sample(CUBE, problem, found.unit, np.random.default_rng(1))
    assert draws.effective > 300
    a = np.linspace(0, 1, 4001)
    density = np.exp(-0.5 * ((a - 0.5) / 0.15) ** 2)
    expected = np.interp([0.05, 0.5, 0.95], np.cumsum(density) / density.sum(), a)
    got = [quantile(draws.unit[:, 0], draws.weight, q) for q in (0.05, 0.5, 0.95)]
    np.testing.assert_allclose(got, expected, atol=0.02)
    free = [quantile(draws.unit[:, 2], draws.weight, q) for q in (0.05, 0.5, 0.95)]
    np.testing.assert_allclose(free, [0.05, 0.5, 0.95], atol=0.03)


def test_an_optimum_on_the_boundary_keeps_its_half():
    J = np.diag([1 / 0.1, 1 / 0.1, 1 / 0.1])
    centre = np.array([0.0, 0.5, 1.0])
    draws = sample(CUBE, linear(J, centre), centre[None], np.random.default_rng(2))
    half = 0.1 * 1.645  # 90 % of a half Gaussian
    assert quantile(draws.unit[:, 0], draws.weight, 0.9) == pytest.approx(half, rel=0.05)
    assert quantile(draws.unit[:, 2], draws.weight, 0.1) == pytest.approx(1 - half, rel=0.05)


def test_draws_are_from_the_density_that_is_asked_for():
    """χ² is only what it resembles: here one that is twice as narrow."""
    J, centre = np.diag([1 / 0.02] * 3), np.full(3, 0.5)

    def log_density(p):
        return -0.125 * (((p - centre) @ J.T) ** 2).sum(axis=1)

    draws = sample(
        CUBE, linear(J, centre), centre[None], np.random.default_rng(3), log_density=log_density
    )
    mean = draws.weight @ draws.unit
    sd = np.sqrt(draws.weight @ (draws.unit - mean) ** 2)
    np.testing.assert_allclose(sd, 0.04, rtol=0.08)


def test_a_density_eight_times_wider_than_it_looked_is_no_single_draw():
    """Of eight unknowns one draw had nearly all weight, and further rounds drew beside it only."""
    space = Space.box(tuple("abcdefgh"), (0.0,) * 8, (1.0,) * 8)
    centre, sd = np.full(8, 0.5), 0.04
    narrow = linear(np.eye(8) * 8.0 / sd, centre)
    for seed in range(3):
        draws = sample(
            space, narrow, centre[None], np.random.default_rng(seed), draws=1024,
            log_density=lambda p: -0.5 * np.square((p - centre) / sd).sum(axis=1),
        )  # fmt: skip
        mean = draws.weight @ draws.unit
        seen = np.sqrt(draws.weight @ np.square(draws.unit - mean))
        assert draws.effective >= 19.0
        assert np.abs(mean - centre).max() < 0.5 * sd
        assert 0.6 * sd < np.median(seen) < 1.1 * sd


def test_weights_are_evened_out_only_where_they_are_worth_too_few():
    rng = np.random.default_rng(0)
    good = rng.random(200)
    good /= good.sum()
    assert _evened(good) is good
    steep = np.exp(-20.0 * np.arange(200.0))
    steep /= steep.sum()
    evened = _evened(steep)
    assert 1.0 / np.square(evened).sum() >= POSTERIOR.least
    assert (np.diff(evened) <= 0.0).all()
    one = np.zeros(50)
    one[:3] = (0.998, 1e-3, 1e-3)
    assert 1.0 / np.square(_evened(one)).sum() >= 1.5  # of three that are not nothing
    assert _evened(one)[3:].max() == 0.0


def test_same_seed_same_bits():
    one, two = (
        sample(CUBE, banana(), np.array([[0.5, 0.2, 0.5]]), np.random.default_rng(7))
        for _ in range(2)
    )
    np.testing.assert_array_equal(one.unit, two.unit)
    np.testing.assert_array_equal(one.weight, two.weight)


def test_no_model_at_the_minimum_is_an_error():
    nothing = Residuals(
        lambda p: np.full((len(p), 2), np.nan), lambda p: np.full((len(p), 2, 3), 0)
    )
    with pytest.raises(ValueError, match="no model"):
        sample(CUBE, nothing, np.full((1, 3), 0.5), np.random.default_rng(0))


class TestPolish:
    def test_finds_the_minimum_of_a_narrow_valley_from_everywhere(self):
        starts = np.random.default_rng(0).random((50, 3))
        found = polish(CUBE, banana(1e-3), starts)
        np.testing.assert_allclose(found.unit[:, 0], 0.5, atol=1e-4)
        np.testing.assert_allclose(found.unit[:, 1], 0.2, atol=1e-4)
        assert found.converged.all()

    def test_stays_inside_and_ends_on_the_boundary(self):
        J, centre = np.array([[1.0, 0.9, 0], [0, 1, 0.5], [0, 0, 1]]), np.array([1.4, 0.3, -0.2])
        found = polish(CUBE, linear(J, centre), np.full((1, 3), 0.5))
        from scipy.optimize import lsq_linear

        expected = lsq_linear(J, J @ centre, bounds=(0, 1)).x
        np.testing.assert_allclose(found.unit[0], expected, atol=1e-6)

    def test_held_unknowns_keep_their_value(self):
        held = np.array([[True, False, False]])
        found = polish(CUBE, banana(), np.array([[0.3, 0.9, 0.4]]), held=held)
        np.testing.assert_allclose(found.unit[0], [0.3, 0.2 + 2 * 0.04, 0.4], atol=1e-6)

    def test_where_the_model_ends_no_step_is_taken(self):
        def differences(p):
            return np.where(p[:, :1] > 0.4, np.nan, p - 0.6)

        problem = Residuals(differences, lambda p: np.tile(np.eye(3), (len(p), 1, 1)))
        found = polish(CUBE, problem, np.array([[0.1, 0.5, 0.5], [0.9, 0.5, 0.5]]))
        assert 0.1 < found.unit[0, 0] <= 0.4
        assert np.isinf(found.cost[1])


class TestSummary:
    def drawn(self, seed=0, n=40_000):
        x = np.random.default_rng(seed).normal(0, 1, n)
        return x, np.full(n, 1 / n), -0.5 * x**2

    def test_of_a_gaussian_is_the_textbooks(self):
        middle, low, high = summary(*self.drawn())
        np.testing.assert_allclose([low, middle, high], [-1.555, 0, 1.555], atol=0.03)  # 88 %

    def test_of_a_gaussian_at_a_bound_goes_to_the_bound(self):
        x, weight, log_density = (v[self.drawn()[0] > 0.3] for v in self.drawn())
        middle, low, high = summary(x, weight / weight.sum(), log_density, (0.3, 30.0))
        assert low == 0.3
        assert low < middle < high
        inside = (x >= low) & (x <= high)
        assert inside.mean() == pytest.approx(0.88, abs=0.01)

    def test_of_a_skewed_density_it_is_the_shortest(self):
        x = np.random.default_rng(5).gamma(3.0, 1.0, 100_000)
        _, low, high = summary(x, np.full(len(x), 1e-5), 2.0 * np.log(x) - x)
        density = gamma(3.0)
        assert density.cdf(high) - density.cdf(low) == pytest.approx(0.88, abs=0.005)
        assert density.pdf(low) == pytest.approx(density.pdf(high), abs=0.02)

    def test_a_value_at_the_end_of_the_range_is_not_left_out(self):
        """Flat beyond: the end is as likely as any, and was left out by the shortest interval."""
        x = np.linspace(0.2, 0.49, 20_000)
        weight = x - 0.2  # density rises away from 0.2, likelihood is nearly flat
        log_density = -0.5 * ((x - 0.4) / 0.16) ** 2
        _, low, high = summary(x, weight / weight.sum(), log_density, (0.2, 0.49))
        assert low == 0.2
        assert high == 0.49

    def test_an_end_of_the_range_holds_as_theory_says(self):
        """Half of all falls at a bound are none, the other half χ²: 2.0 holds in 92 %."""
        rng = np.random.default_rng(8)
        held = []
        for off in rng.standard_normal(2000):  # one reading of a value that is 0, in 0 to 20
            x = np.linspace(0.0, max(off, 0.0) + 6.0, 1000)
            log_density = -0.5 * (x - off) ** 2
            weight = np.exp(log_density - log_density.max())
            held.append(summary(x, weight, log_density, (0.0, 20.0))[1] == 0.0)
        assert np.mean(held) == pytest.approx(0.92, abs=0.02)

    def test_the_middle_is_inside_where_the_shortest_is_elsewhere(self):
        x = np.concatenate([np.linspace(0.0, 0.01, 950), np.linspace(5.0, 9.0, 51)])
        weight = np.full(len(x), 1 / len(x))
        likely = np.where(x > 8.0, 0.0, -9.0)
        middle, low, high = summary(x, weight, likely, at_end=x > 8.9)
        assert low <= middle <= high
        assert high == 9.0
        assert summary(x, weight, np.where(x < 0.02, 0.0, -9.0))[2] <= 0.01

    def test_where_another_unknown_is_at_its_end_a_value_counts_without_weight(self):
        x, weight, log_density = self.drawn(3)
        corner = -2.5, 1e-12, -0.99
        x, weight, log_density = (
            np.append(v, c) for v, c in zip((x, weight, log_density), corner, strict=True)
        )
        at_end = x == corner[0]
        _, without, _ = summary(x, weight, log_density)
        _, low, _ = summary(x, weight, log_density, at_end=at_end)
        assert low == pytest.approx(corner[0], abs=0.03)
        assert low <= corner[0]
        assert low < without
        log_density[-1] = -1.01  # just too unlikely
        assert summary(x, weight, log_density, at_end=at_end)[1] == without

    def test_what_is_likely_is_inside_though_it_has_next_to_no_weight(self):
        """A valley's narrow end: the likeliest skins of all, and one draw in a hundred."""
        x, weight, log_density = self.drawn(4)
        narrow = x > 2.3
        log_density = np.where(narrow, 0.0, -0.5 * x**2 - 0.9)
        _, low, high = summary(x, weight, log_density)
        assert high == x.max()
        inside = (x >= low) & (x <= high)
        assert inside.mean() >= INTERVALS.weight - 0.01
        likely = 2.0 * (log_density.max() - log_density) <= INTERVALS.likely_fall
        assert inside[likely].all()

    def test_the_scale_does_not_matter(self):
        x, weight, log_density = self.drawn(2)
        middle, low, high = summary(x, weight, log_density)
        other = summary(np.exp(x), weight, log_density, logarithmic=True)
        np.testing.assert_allclose(np.log(other), [middle, low, high], atol=1e-9)

    def test_all_weight_on_one_draw_is_an_answer(self):
        x = np.array([0.2, 0.3, 0.4])
        middle, low, high = summary(x, np.array([0.0, 1.0, 0.0]), np.array([-9e9, 0.0, -np.inf]))
        assert low <= middle <= high
        assert np.isfinite([low, middle, high]).all()

    def test_a_flat_range_that_begins_near_zero_is_not_logarithmic(self):
        share = np.random.default_rng(0).random(1000)
        assert not is_logarithmic(0.499 * share)  # its least draw is far below a fifth of the most
        assert is_logarithmic(0.005 * 40**share)

    def test_most_of_the_range(self):
        prior = np.random.default_rng(2).random(2000)
        assert most_of_the_range((0.2, 0.8), prior)
        assert not most_of_the_range((0.4, 0.6), prior)
        factor_of_100 = 100.0**prior
        assert most_of_the_range((2.0, 40.0), factor_of_100)
        assert not most_of_the_range((40.0, 60.0), factor_of_100)


def test_correlations_are_those_of_the_draws():
    rng = np.random.default_rng(3)
    draws = rng.multivariate_normal([0, 0], [[1, -0.8], [-0.8, 1]], 50_000)
    matrix = correlation(draws, np.full(len(draws), 1 / len(draws)))
    assert matrix[0][1] == pytest.approx(-0.8, abs=0.01)
    assert matrix[0][0] == 1.0


def test_joint_misfits_add_up():
    J = np.diag([3.0, 2.0, 1.0])
    parts = [linear(J, np.full(3, 0.4)), banana(), GaussianPrior(1, 0.5, 0.1)]
    joint = JointMisfit(parts)
    points = np.random.default_rng(4).random((5, 3))
    np.testing.assert_allclose(joint(points), sum(p(points) for p in parts))
    np.testing.assert_allclose((joint.differences(points) ** 2).sum(axis=1), joint(points))
    step = 1e-6
    for i in range(3):
        rise = joint.differences(points + step * np.eye(3)[i]) - joint.differences(
            points - step * np.eye(3)[i]
        )
        np.testing.assert_allclose(joint.slopes(points)[:, :, i], rise / (2 * step), atol=1e-5)
    residuals = Problem(None, joint, 3).residuals(points[0])
    assert residuals @ residuals == pytest.approx(joint(points[:1])[0])


def test_a_space_with_a_factor_goes_there_and_back():
    space = Space(
        ("a_MPa", "b_MPa", "c"), (0.01, 1.0, 0.2), (0.1, 100.0, 0.48), ("log", "ratio", "linear")
    ).extended("ratio", 0.5, 2.0)
    unit = np.random.default_rng(5).random((6, 4))
    np.testing.assert_allclose(space.to_unit(space.from_unit(unit)), unit, atol=1e-12)
    assert space.names[-1] == "ratio"
    assert space.bounds[1][-1] == 2.0
    assert space.from_unit(np.array([0.5, 0.5, 0.5, 0.5]))[-1] == pytest.approx(1.0)


@pytest.mark.parametrize("n", [5, 8, 11])
def test_what_is_beyond_all_numbers_weighs_nothing(n):
    """Far draws: a warning of numpy would be an error here."""
    values = np.array([1.0, 4.0, 1e200])
    np.testing.assert_allclose(_half_power(values, n), [1.0, 2.0**n, np.inf])
