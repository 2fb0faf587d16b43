"""The paper's methods, each against what its theory says."""

from __future__ import annotations

import json

import numpy as np
import pytest

from skinlab.curves.curve import Curve, Setup
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.inference.methods import (
    gauss_newton,
    gauss_newton_linesearch,
    heuristic_kalman,
    levenberg_marquardt,
    recursive_least_squares,
    stochastic,
)
from skinlab.inference.problem import Options, Problem
from skinlab.inference.uncertainty import Sensor
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials import get_law
from skinlab.parameters import Space
from skinlab.report.text import describe, explain
from skinlab.reproduction.published_values import PAPER_BOX

UNIT = Space.box(("a", "b"), (0.0, 0.0), (1.0, 1.0))
TRUE = np.array([0.6, 0.3])
TIME = np.linspace(0.0, 1.0, 30)
ALL = ["auto", "gn", "gn-linesearch", "hka", "lm", "rls", "sto"]


class Sampled:
    """Deflections `model(parameters) (u,)`, mm, with their slopes, sample by sample."""

    rest = 0.0

    def __init__(self, model, slopes, measured):
        self.model, self.of_one, self.measured = model, slopes, measured

    def differences(self, parameters):
        return np.array([self.model(p) - self.measured for p in parameters])

    def slopes(self, parameters):
        return np.array([self.of_one(p) for p in parameters])

    def __call__(self, parameters):
        squares = np.square(self.differences(parameters)).sum(axis=1)
        return np.where(np.isfinite(squares), squares, np.inf)

    def sample(self, parameters, t):
        difference = self.model(parameters)[t] - self.measured[t]
        return float(-difference), self.of_one(parameters)[t]


class ResidualsOnly(Sampled):
    sample = None

    def slopes(self, parameters):
        return np.full((len(parameters), len(self.measured), parameters.shape[1]), np.nan)


def saturating(parameters):
    a, b = parameters
    return a * (1.0 - np.exp(-TIME / (0.2 + b)))


def saturating_slopes(parameters):
    a, b = parameters
    decay = np.exp(-TIME / (0.2 + b))
    return np.column_stack([1.0 - decay, -a * decay * TIME / (0.2 + b) ** 2])


def saturation(measured=None, kind=Sampled):
    """Return a problem whose residual at TRUE is zero, unless it is measured otherwise."""
    measured = saturating(TRUE) if measured is None else measured
    return Problem(UNIT, kind(saturating, saturating_slopes, measured), len(TIME))


WIDE = Space.box(("a", "b"), (-50.0, -50.0), (50.0, 50.0))  # no estimate on the way reaches an edge


def line(rng, space=UNIT):
    """Return a linear problem with noise, its design (u, 2) and what is measured (u,)."""
    design = np.column_stack([np.ones(40), np.linspace(-1.0, 1.0, 40)])
    measured = design @ [0.4, 0.6] + 0.05 * rng.normal(size=40)
    misfit = Sampled(lambda x: design @ x, lambda x: design, measured)
    return Problem(space, misfit, 40), design, measured


def run(method, problem, options=None, seed=0, **arguments):
    return method.identify(problem, options or Options(), np.random.default_rng(seed), **arguments)


class TestStochastic:
    def test_the_papers_example_of_eq_10(self):
        assert stochastic.least_samples(0.99, 0.01) == 459

    @pytest.mark.parametrize(("rho", "e"), [(0.9, 0.1), (0.99, 0.02), (0.5, 0.3)])
    def test_eq_10_is_the_chance_of_one_hit(self, rho, e):
        """Of draws with the least N, a fraction ρ at least has a point in the best e; not N − 1."""
        least = stochastic.least_samples(rho, e)
        assert 1 - (1 - e) ** least >= rho > 1 - (1 - e) ** (least - 1)
        rng = np.random.default_rng(8)
        hits = np.mean([(stochastic.draw(rng, least, 1, "uniform") < e).any() for _ in range(2000)])
        assert hits == pytest.approx(1 - (1 - e) ** least, abs=4 * np.sqrt(rho * (1 - rho) / 2000))

    @pytest.mark.parametrize(("rho", "e"), [(0, 0.1), (1, 0.1), (0.9, 0), (0.9, 1), (np.nan, 0.1)])
    def test_what_is_no_probability_is_refused(self, rho, e):
        with pytest.raises(InputError, match="more than 0 and less than 1"):
            stochastic.least_samples(rho, e)

    def test_more_samples_than_fit_into_memory_are_refused(self):
        with pytest.raises(InputError, match="more than 1000000 samples"):
            stochastic.least_samples(0.99, 1e-9)
        with pytest.raises(InputError, match="expected 2 to 1000000"):
            run(stochastic, saturation(), Options(samples=10**9))

    def test_a_latin_hypercube_has_one_point_in_every_slice(self):
        points = stochastic.draw(np.random.default_rng(7), 50, 3, "lhs")
        slices = np.sort(np.floor(50 * points), axis=0)
        np.testing.assert_array_equal(slices, np.tile(np.arange(50)[:, None], (1, 3)))

    @pytest.mark.parametrize("sampling", ["uniform", "lhs"])
    def test_either_sampling_finds_the_minimum_and_repeats_its_bits(self, sampling):
        options = Options(samples=200, best=10).having(sampling=sampling)
        found = run(stochastic, saturation(), options, seed=3)
        np.testing.assert_allclose(found.parameters, TRUE, atol=0.02)
        again = run(stochastic, saturation(), options, seed=3)
        np.testing.assert_array_equal(found.parameters, again.parameters)

    def test_another_sampling_is_refused(self):
        with pytest.raises(InputError, match="expected uniform or lhs"):
            run(stochastic, saturation(), Options().having(sampling="sobol"))


class TestGaussNewton:
    def test_converges_quadratically_where_the_residual_is_zero(self):
        def distance(steps):
            options = Options(most_iterations=steps, tolerance_um=0.0)
            found = run(gauss_newton, saturation(), options, start=TRUE + 0.05)
            return np.linalg.norm(found.parameters - TRUE)

        e1, e2, e3 = (distance(steps) for steps in (1, 2, 3))
        assert e2 < 2.0 * e1**2
        assert e3 < 2.0 * e2**2
        assert e1 > 1e-4  # or this would show nothing

    def test_one_step_solves_a_linear_problem(self):
        problem, design, measured = line(np.random.default_rng(1))
        expected = np.linalg.lstsq(design, measured, rcond=None)[0]
        found = run(gauss_newton, problem, Options(most_iterations=1))
        np.testing.assert_allclose(found.parameters, expected, rtol=1e-9)

    def test_differences_stand_in_for_a_missing_jacobian(self):
        start = np.array([0.9, 0.0])
        with_slopes = run(gauss_newton, saturation(), start=start)
        without = run(gauss_newton, saturation(kind=ResidualsOnly), start=start)
        np.testing.assert_allclose(without.parameters, with_slopes.parameters, atol=1e-8)

    def test_differences_look_only_where_there_is_a_model(self):
        def model(x):
            return saturating(x) if x[0] >= 0.4 and x[1] <= 0.6 else np.full(len(TIME), np.nan)

        corner = np.array([0.4, 0.6])
        misfit = ResidualsOnly(model, saturating_slopes, saturating(TRUE))
        found = gauss_newton.Search(Problem(UNIT, misfit, len(TIME))).jacobian(corner)
        np.testing.assert_allclose(found[:-1], saturating_slopes(corner), atol=1e-5)

    def test_starts_at_the_minimal_values(self):
        found = run(gauss_newton, saturation(), Options(most_iterations=0))
        np.testing.assert_array_equal(found.parameters, [0.0, 0.0])
        assert not found.converged

    def test_starts_where_the_model_begins(self):
        def model(x):
            return saturating(x) if x[0] > 0.4 else np.full(len(TIME), np.nan)

        problem = Problem(UNIT, Sampled(model, saturating_slopes, saturating(TRUE)), len(TIME))
        found = run(gauss_newton, problem, Options(most_iterations=0))
        assert found.parameters == pytest.approx([0.41, 0.41])  # the first hundredth
        np.testing.assert_allclose(run(gauss_newton, problem).parameters, TRUE, atol=1e-6)

    def test_slopes_by_the_unit_cube_are_those_of_the_space(self):
        space = get_law().space
        by_x1, by_ratio = np.log(0.2 / 0.005), np.log(1000.0 / 0.5)
        expected = [[0.03 * by_x1, 0, 0], [by_x1, by_ratio, 0], [0, 0, 0.499]]
        slopes = space.by_unit(np.array([0.03, 1.0, 0.32]))
        np.testing.assert_allclose(slopes, expected, rtol=1e-12, atol=1e-15)


class TestLineSearch:
    # From far out a step of Gauss-Newton on arctan overshoots, by more each time.
    FAR = Space.box(("a",), (-5.0,), (4.0,))

    def arctangent(self):
        def slopes(x):
            return (1.0 / (1.0 + x**2))[:, None]

        return Problem(self.FAR, Sampled(np.arctan, slopes, np.zeros(1)), 1)

    def test_reaches_what_gauss_newton_jumps_across(self):
        assert not run(gauss_newton, self.arctangent()).converged
        found = run(gauss_newton_linesearch, self.arctangent())
        assert found.converged
        assert abs(found.parameters[0]) < 1e-6

    @pytest.mark.parametrize("seed", range(5))
    def test_never_increases_the_misfit(self, seed):
        rng = np.random.default_rng(seed)
        problem = saturation(saturating(TRUE) + 0.1 * rng.normal(size=len(TIME)))
        start = rng.random(2)
        errors = [
            run(gauss_newton_linesearch, problem, Options(most_iterations=n), start=start).error_um
            for n in range(8)
        ]
        assert (np.diff(errors) <= 0.0).all()

    def test_finds_the_minimum_on_the_boundary_of_a_skew_valley(self):
        """Cutting the unconstrained step at the boundary would end elsewhere."""
        design = np.array([[1.0, 0.9], [0.9, 1.0]])
        measured = design @ [1.5, 0.2]
        problem = Problem(UNIT, Sampled(lambda x: design @ x, lambda x: design, measured), 2)
        on_edge = design[:, 1] @ (measured - design[:, 0]) / (design[:, 1] @ design[:, 1])
        found = run(gauss_newton_linesearch, problem)
        np.testing.assert_allclose(found.parameters, [1.0, on_edge], atol=1e-6)
        assert found.converged


class TestRecursiveLeastSquares:
    def test_one_pass_without_forgetting_is_least_squares(self):
        problem, design, measured = line(np.random.default_rng(2), WIDE)
        expected = np.linalg.lstsq(design, measured, rcond=None)[0]
        found = run(
            recursive_least_squares,
            problem,
            Options().having(passes=1, forgetting=1.0, covariance=1e8),
            start=np.zeros(2),
        )
        np.testing.assert_allclose(found.parameters, expected, rtol=1e-6)

    def test_the_first_covariance_is_in_the_parameters_units(self):
        """With λ = 1 and P = I a pass minimises Σ (M − Ω)² + ‖x − x₀‖², whatever the space."""
        space = Space.box(("a", "b"), (-10.0, -3.0), (20.0, 50.0))
        problem, design, measured = line(np.random.default_rng(3), space)
        x0 = np.array([1.0, -1.0])
        expected = np.linalg.solve(design.T @ design + np.eye(2), design.T @ measured + x0)
        options = Options().having(passes=1, forgetting=1.0)
        found = run(recursive_least_squares, problem, options, start=x0)
        np.testing.assert_allclose(found.parameters, expected, rtol=1e-8)

    def test_one_pass_weighs_samples_as_its_forgetting_factors_say(self):
        problem, design, measured = line(np.random.default_rng(4), WIDE)
        factors = [0.9]
        while len(factors) < 40:
            factors.append(0.9 * factors[-1] + 0.1)  # eq. (16)
        # Sample t is forgotten by the factors of those behind it: λ_{t+1} … λ_{u−1}.
        weights = np.append(np.cumprod(factors[:0:-1])[::-1], 1.0)
        normal = design.T @ (weights[:, None] * design)
        expected = np.linalg.solve(normal, design.T @ (weights * measured))
        found = run(
            recursive_least_squares,
            problem,
            Options().having(passes=1, covariance=1e8),
            start=np.zeros(2),
        )
        np.testing.assert_allclose(found.parameters, expected, rtol=1e-6)

    @pytest.mark.parametrize("kind", [Sampled, ResidualsOnly])
    def test_repeated_passes_reach_a_nonlinear_minimum(self, kind):
        found = run(recursive_least_squares, saturation(kind=kind))
        np.testing.assert_allclose(found.parameters, TRUE, atol=1e-4)
        assert found.converged

    def test_a_step_to_where_there_is_no_model_is_taken_back(self):
        def model(x):
            return saturating(x) if x[0] < 0.7 else np.full(len(TIME), np.nan)

        def slopes(x):
            return saturating_slopes(x) if x[0] < 0.7 else np.full((len(TIME), 2), np.nan)

        # The first samples, which are too high, throw the estimate out of the model.
        measured = saturating(TRUE) + 0.3 * (TIME < 0.1)
        problem = Problem(UNIT, Sampled(model, slopes, measured), len(TIME))
        found = run(recursive_least_squares, problem, Options().having(passes=1, covariance=1e3))
        assert np.isfinite(found.error_um)
        assert found.parameters[0] < 0.7

    def test_ends_where_there_are_no_slopes(self):
        nothing = np.full((len(TIME), 2), np.nan)
        misfit = Sampled(saturating, lambda x: nothing, saturating(TRUE))
        found = run(recursive_least_squares, Problem(UNIT, misfit, len(TIME)))
        assert not found.converged
        assert found.iterations == 1

    def test_a_direction_that_no_sample_speaks_of_is_left_alone(self):
        design = np.column_stack([np.ones(40), np.zeros(40)])
        measured = 0.4 + 0.01 * np.sin(np.arange(40))
        problem = Problem(UNIT, Sampled(lambda x: design @ x, lambda x: design, measured), 40)
        options = Options(tolerance_um=0.0).having(passes=2000)
        found = run(recursive_least_squares, problem, options, start=np.array([0.2, 0.7]))
        assert found.parameters[1] == pytest.approx(0.7)

    def test_the_passes_are_bounded(self):
        options = Options(tolerance_um=0.0).having(passes=3)
        found = run(recursive_least_squares, saturation(), options)
        assert (found.iterations, found.converged) == (3, False)

    @pytest.mark.parametrize(
        "arguments", [{"forgetting": 0.0}, {"covariance": -1.0}, {"passes": 0}]
    )
    def test_arguments_that_cannot_work_are_refused(self, arguments):
        with pytest.raises(InputError, match="expected"):
            run(recursive_least_squares, saturation(), Options().having(**arguments))


class TestLevenbergMarquardt:
    @pytest.mark.parametrize("kind", [Sampled, ResidualsOnly])
    def test_reaches_the_minimum(self, kind):
        noisy = saturating(TRUE) + 0.02 * np.random.default_rng(5).normal(size=len(TIME))
        problem = saturation(noisy, kind)
        found = run(levenberg_marquardt, problem)
        F, r = saturating_slopes(found.parameters), problem.residuals(found.parameters)[:-1]
        np.testing.assert_allclose(F.T @ r, 0.0, atol=1e-6)
        assert found.converged

    def test_the_start_does_not_matter_where_there_is_one_minimum(self):
        ends = [
            run(levenberg_marquardt, saturation(), start=np.array(start)).parameters
            for start in ([0.01, 0.01], [1.0, 0.0], [0.0, 1.0], [0.99, 0.99])
        ]
        np.testing.assert_allclose(ends, np.tile(TRUE, (4, 1)), atol=1e-6)

    def test_goes_around_where_there_is_no_model(self):
        def model(x):
            return saturating(x) if x[1] > 0.25 else np.full(len(TIME), np.nan)

        problem = Problem(UNIT, Sampled(model, saturating_slopes, saturating(TRUE)), len(TIME))
        found = run(levenberg_marquardt, problem, start=np.array([0.95, 0.9]))
        np.testing.assert_allclose(found.parameters, TRUE, atol=1e-6)


class TestHeuristicKalman:
    def test_the_covariance_shrinks_and_the_mean_moves_to_the_best(self):
        rng = np.random.default_rng(6)
        best = rng.normal([0.3, 0.7], 0.05, (20, 2))
        mean, deviation = np.array([0.5, 0.5]), np.array([0.2, 0.2])
        new_mean, new_deviation = heuristic_kalman.update(mean, deviation, best, 0.4)
        assert (new_deviation < deviation).all()
        assert (new_deviation > 0.0).all()
        centre = best.mean(axis=0)
        assert (np.abs(new_mean - centre) < np.abs(mean - centre)).all()

    def test_the_filter_fuses_as_kalmans_does(self):
        """Equal variances: the mean goes half way, the variance halves; a = α v/(v + W)."""
        best = np.array([[0.4], [0.8]])  # mean 0.6, variance 0.04
        mean, deviation = heuristic_kalman.update(np.array([0.2]), np.array([0.2]), best, 0.9)
        assert mean == pytest.approx([0.4])
        a = 0.9 * 0.04 / (0.04 + 0.02)
        assert deviation == pytest.approx([0.2 + a * (np.sqrt(0.02) - 0.2)])

    def test_a_slower_one_shrinks_less(self):
        best = np.array([[0.4], [0.8]])
        slow, fast = (
            heuristic_kalman.update(np.array([0.2]), np.array([0.2]), best, slowdown)[1]
            for slowdown in (0.2, 1.0)
        )
        assert slow > fast

    def test_passes_over_candidates_without_a_model(self):
        def model(x):
            return saturating(x) if x[0] > 0.5 else np.full(len(TIME), np.nan)

        problem = Problem(UNIT, Sampled(model, saturating_slopes, saturating(TRUE)), len(TIME))
        found = run(heuristic_kalman, problem, Options(samples=100, best=10))
        np.testing.assert_allclose(found.parameters, TRUE, atol=1e-3)

    def test_a_slowdown_that_cannot_work_is_refused(self):
        with pytest.raises(InputError, match="expected"):
            run(heuristic_kalman, saturation(), Options().having(slowdown=0.0))


EVERY = [
    gauss_newton,
    gauss_newton_linesearch,
    heuristic_kalman,
    levenberg_marquardt,
    recursive_least_squares,
]


@pytest.mark.parametrize("method", EVERY, ids=lambda method: method.METHOD.name)
def test_without_any_model_there_is_no_answer(method):
    nothing = np.full(len(TIME), np.nan)
    problem = Problem(UNIT, Sampled(lambda x: nothing, saturating_slopes, TIME), len(TIME))
    found = run(method, problem, Options(samples=50, best=5, most_iterations=3))
    assert not found.converged
    assert found.error_um == np.inf


@pytest.mark.parametrize("method", [gauss_newton, gauss_newton_linesearch, levenberg_marquardt])
def test_the_papers_blind_test(method, grid):
    """Table 1: methods with slopes end at the true values, with E = 0."""
    true = np.array([0.03, 1.0, 0.32])
    model = grid.model(Geometry(6.0, 1.0), np.linspace(0.0, 100.0, 51))
    problem = Problem(PAPER_BOX, model.misfit(model.deflection_mm(true[None])[0]), 51)
    found = run(method, problem)
    np.testing.assert_allclose(found.parameters, true, rtol=1e-3)
    assert found.error_um < 1e-3


class Speckled:
    """A bowl with a model at one candidate of a draw only, now and then at more."""

    def __init__(self, finite):
        self.finite, self.calls = finite, 0

    def __call__(self, parameters):
        self.calls += 1
        cost = ((parameters - TRUE) ** 2).sum(axis=1)
        cost[self.finite(self.calls) :] = np.inf
        return cost


def test_sto_does_not_converge_on_a_box_of_one_candidate():
    """One finite candidate collapsed the box onto itself, and was called converged."""
    problem = Problem(UNIT, Speckled(lambda call: 1), 10)
    found = stochastic.identify(problem, Options(most_iterations=30), np.random.default_rng(0))
    assert not found.converged
    assert np.isfinite(found.error_um)
    problem = Problem(UNIT, Speckled(lambda call: 1 if call < 4 else 1000), 10)
    found = stochastic.identify(problem, Options(), np.random.default_rng(0))
    assert found.converged
    np.testing.assert_allclose(found.parameters, TRUE, atol=2e-3)


@pytest.mark.parametrize("method", ["lm", "auto", "gn", "sto"])
def test_a_curve_without_any_pressure_has_an_answer(table, method):
    """MINPACK refuses fewer residuals than unknowns, which ended in a traceback."""
    zero = np.zeros(51)
    curve = Curve("zero", Setup(6.0, 1.0), np.arange(51) / 10, zero, zero)
    result = Identifier(table, method=method)(curve)
    assert result.error is None
    json.dumps(result.to_json(), allow_nan=False)


@pytest.mark.parametrize("noise_um", [None, 3.0])
@pytest.mark.parametrize("method", ALL)
def test_a_curve_that_no_skin_has_is_flagged(table, method, noise_um):
    """`sto` said nothing of a deflection of zero up to 100 mbar."""
    time_s = np.arange(51) / 10
    curve = Curve("zero", Setup(6.0, 1.0), time_s, 20 * time_s, np.zeros(51))
    result = Identifier(table, method=method, sensor=Sensor(noise_um))(curve)
    assert result.error is None
    assert "misfit_above_noise" in result.flags
    json.dumps(result.to_json(), allow_nan=False)


@pytest.mark.parametrize("method", [method for method in ALL if method != "rls"])
def test_every_method_contradicts_a_stated_noise_that_its_residuals_show_to_be_wrong(table, method):
    """`rls` ends far off: what it misses is a misfit."""
    pressure = np.linspace(0.0, 100.0, 51)
    skin = table.model(Geometry(6.0, 1.0), pressure).deflection_mm(np.array([[0.02, 2.0, 0.3]]))[0]
    noise = np.random.default_rng(173).normal(0.0, 3e-3, 51)
    curve = Curve("c", Setup(6.0, 1.0), pressure / 20.0, pressure, skin + noise)
    flag = "stated_noise_contradicted"
    for stated_um, contradicted in ((3.0, False), (1.0, True), (9.0, True)):
        result = Identifier(table, method=method, sensor=Sensor(stated_um, 0.0))(curve)
        assert (flag in result.flags) == contradicted
        assert ("misfit_above_noise" in result.flags) == (stated_um == 1.0)
        assert (f"stated {stated_um:.3g} µm, found" in describe(result)) == contradicted
    assert flag not in Identifier(table, method=method)(curve).flags


@pytest.mark.parametrize("method", ALL)
def test_a_glitch_contradicts_no_stated_noise(table, method):
    pressure = np.linspace(0.0, 100.0, 51)
    skin = table.model(Geometry(6.0, 1.0), pressure).deflection_mm(np.array([[0.02, 2.0, 0.3]]))[0]
    noise = np.random.default_rng(173).normal(0.0, 3e-3, 51)
    noise[20] += 0.1
    curve = Curve("c", Setup(6.0, 1.0), pressure / 20.0, pressure, skin + noise)
    result = Identifier(table, method=method, sensor=Sensor(3.0, 0.0))(curve)
    assert "stated_noise_contradicted" not in result.flags


@pytest.mark.parametrize("method", ["auto", "lm"])
@pytest.mark.parametrize(("stated_mbar", "said"), [(None, False), (2.0, False), (0.1, True)])
def test_a_stated_pressure_noise_that_the_readings_contradict(table, method, stated_mbar, said):
    rng, pressure = np.random.default_rng(173), np.linspace(0.0, 100.0, 101)
    skin = table.model(Geometry(6.0, 1.0), pressure).deflection_mm(np.array([[0.02, 2.0, 0.3]]))[0]
    readings = pressure + rng.normal(0.0, 2.0, 101)
    curve = Curve("c", Setup(6.0, 1.0), pressure / 20.0, readings, skin + rng.normal(0, 1e-3, 101))
    result = Identifier(table, method=method, sensor=Sensor(None, stated_mbar))(curve)
    found = [f for f in result.flags if f.startswith("stated_pressure_noise_contradicted:")]
    assert bool(found) == said
    if said:
        assert float(found[0].partition(":")[2]) == pytest.approx(2.0, rel=0.3)
        assert any("shows a noise of" in sentence for sentence in explain(result))
