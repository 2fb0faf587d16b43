from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.inference.methods import get_method, method_names, stochastic
from skinlab.inference.problem import Options, Problem, check
from skinlab.inference.result import document
from skinlab.inference.samples import choose
from skinlab.mechanics.fem.skin import Skin
from skinlab.parameters import Space
from skinlab.tables.forward import simulate

SETUP = Setup(6.0, 1.0, parse_program("ramp:100@20"))
TRUE = np.array([0.03, 1.0, 0.32])


class Bowl:
    """A misfit with a known minimum and a valley, in mm²."""

    def __init__(self, centre, scales):
        self.centre, self.scales = np.array(centre), np.array(scales)
        self.asked = 0

    def __call__(self, parameters):
        self.asked += len(parameters)
        return (((parameters - self.centre) / self.scales) ** 2).sum(axis=1)

    rest = 0.0

    def residuals(self, parameters):
        return (parameters - self.centre) / self.scales

    differences = residuals

    def slopes(self, parameters):
        return np.tile(np.diag(1.0 / self.scales), (len(parameters), 1, 1))


UNIT = Space.box(("a", "b"), (0.0, 0.0), (1.0, 1.0))


@pytest.fixture(scope="module")
def blind_curve() -> Curve:
    curve, warning = simulate(Skin(tuple(TRUE)), SETUP, direct=True)
    assert warning is None
    return curve


@pytest.mark.parametrize("name", method_names())
class TestEveryMethod:
    def test_finds_a_minimum_inside(self, name):
        problem = Problem(UNIT, Bowl([0.3, 0.7], [1.0, 1.0]), 10)
        estimate = get_method(name)(problem, Options(), np.random.default_rng(0))
        np.testing.assert_allclose(estimate.parameters, [0.3, 0.7], atol=2e-3)
        assert estimate.converged
        expected = problem.error_um(estimate.parameters[None])[0]
        assert estimate.error_um == pytest.approx(expected)

    def test_same_seed_same_bits(self, name):
        def once(seed):
            problem = Problem(UNIT, Bowl([0.3, 0.7], [1.0, 0.01]), 10)
            return get_method(name)(problem, Options(samples=100), np.random.default_rng(seed))

        np.testing.assert_array_equal(once(5).parameters, once(5).parameters)

    def test_stays_inside_the_space(self, name):
        problem = Problem(UNIT, Bowl([1.5, -0.5], [1.0, 1.0]), 10)
        estimate = get_method(name)(problem, Options(), np.random.default_rng(0))
        assert np.all((estimate.parameters >= 0.0) & (estimate.parameters <= 1.0))
        np.testing.assert_allclose(estimate.parameters, [1.0, 0.0], atol=0.05)


def test_evaluations_are_counted():
    bowl = Bowl([0.3, 0.7], [1.0, 1.0])
    estimate = stochastic.identify(
        Problem(UNIT, bowl, 10), Options(samples=50, best=5), np.random.default_rng(0)
    )
    assert estimate.evaluations == bowl.asked == 50 * estimate.iterations


def test_candidates_without_a_model_are_passed_over():
    class HalfEmpty(Bowl):
        def __call__(self, parameters):
            return np.where(parameters[:, 0] < 0.5, np.inf, super().__call__(parameters))

    problem = Problem(UNIT, HalfEmpty([0.6, 0.7], [1.0, 1.0]), 10)
    estimate = stochastic.identify(problem, Options(), np.random.default_rng(0))
    np.testing.assert_allclose(estimate.parameters, [0.6, 0.7], atol=2e-3)


@pytest.mark.parametrize(
    "options",
    [
        Options(best=1),
        Options(samples=10, best=11),
        Options(tolerance_um=-1),
        Options(tolerance_um=math.inf),
    ],
)
def test_options_that_cannot_work_are_refused(options):
    with pytest.raises(InputError, match="expected"):
        check(options)


@pytest.mark.parametrize("seeds", [5, pytest.param(20, marks=pytest.mark.long)])
def test_the_papers_blind_test(grid, blind_curve, seeds):
    """The issue's bounds; they are also what the paper's Table 1 and Figure 11 show."""
    identifier = Identifier(grid, method="sto", options=Options(samples=1000, best=20))
    found = [dataclasses.replace(identifier, seed=seed)(blind_curve) for seed in range(seeds)]
    values = np.array([[v.value for v in r.parameters.values()] for r in found])
    x1, x2, nu = values.mean(axis=0)
    assert 0.029 <= x1 <= 0.032
    assert 0.9 <= x2 <= 1.2
    assert 0.28 <= nu <= 0.34
    assert max(r.error_um for r in found) < 1.0


def test_auto_finds_the_truth_of_a_noise_free_curve(grid, blind_curve):
    result = Identifier(grid)(blind_curve)
    # Medians, since the mesh may err: in this direction a sensor without noise does not help.
    values = list(result.parameters.values())
    np.testing.assert_allclose([v.value for v in values], TRUE, rtol=0.015)
    assert all(v.low < t < v.high for v, t in zip(values, TRUE, strict=True))
    assert result.error_um < 0.002
    assert result.rms_um == pytest.approx(result.error_um * np.sqrt(len(blind_curve)))
    assert result.flags == ()
    np.testing.assert_allclose(result.model_mm, blind_curve.deflection_mm, atol=1e-4)


def test_only_the_first_loading_is_fitted(grid):
    setup = dataclasses.replace(SETUP, program=parse_program("ramp:100@20,ramp:0@20"))
    curve, _ = simulate(Skin(tuple(TRUE)), setup)
    result = Identifier(grid)(curve)
    assert result.points == 201
    assert result.fitted.sum() == 101
    assert np.isnan(result.model_mm[~result.fitted]).all()
    assert Identifier(grid, phases=("load", "unload"))(curve).fitted.all()


def test_samples_beyond_the_database_are_left_out_and_flagged(grid):
    curve, _ = simulate(
        Skin(tuple(TRUE)), dataclasses.replace(SETUP, program=parse_program("ramp:100@20"))
    )
    far = Curve(
        "far",
        SETUP,
        np.append(curve.time_s, [5.05, 5.1]),
        np.append(curve.pressure_mbar, [101.0, 102.5]),
        np.append(curve.deflection_mm, [0.93, 0.935]),
    )
    result = Identifier(grid)(far)
    assert result.fitted.sum() == 102
    assert "outside_database" in result.flags


def test_another_skin_geometry_is_an_error_with_its_flag(grid):
    curve, _ = simulate(
        Skin(tuple(TRUE)), dataclasses.replace(SETUP, thickness_mm=1.2), direct=True
    )
    result = Identifier(grid)(curve)
    if result.error is not None:  # a database of one geometry only
        assert result.flags == ("outside_database",)
        assert result.parameters is None


def test_a_skin_outside_the_grid_ends_at_its_bound(grid):
    curve, _ = simulate(Skin((0.15, 1.0, 0.32)), SETUP, direct=True)
    result = Identifier(grid)(curve)
    assert any(flag.startswith("at_bound:") for flag in result.flags)


def test_the_document_has_the_contracts_fields(grid, blind_curve):
    identifier = Identifier(grid)
    whole = document(identifier.provenance(), [identifier(blind_curve)])
    assert set(whole) == {
        "schema", "model", "database", "method", "seed", "interval", "curves", "joint", "advice",
    }  # fmt: skip
    assert whole["schema"] == "skinlab.identification/1"
    assert set(whole["model"]) == {"name", "hash", "kappa", "effects"}
    (entry,) = whole["curves"]
    assert set(entry) == {
        "file", "error", "points", "fitted_points", "phases", "aperture_mm", "thickness_mm",
        "parameters", "nu_consistent", "kappa_MPa", "order", "correlation", "error_um", "rms_um",
        "noise_um", "iterations", "evaluations", "seconds", "flags", "error_model",
        "placement", "optimum", "outliers",
    }  # fmt: skip
    assert entry["order"] == ["X1_MPa", "X2_MPa", "nu"]
    assert set(entry["parameters"]["nu"]) == {"value", "low", "high"}


def test_a_very_long_curve_is_thinned_and_says_so(grid, blind_curve):
    at = np.linspace(0, 100, 30_000)
    deflection = np.interp(at, blind_curve.pressure_mbar, blind_curve.deflection_mm)
    long = dataclasses.replace(
        blind_curve, time_s=at / 20, pressure_mbar=at, deflection_mm=deflection, segment=None
    )
    result = Identifier(grid, method="lm")(long)
    assert "thinned:6" in result.flags
    assert "outside_database" not in result.flags
    assert result.fitted_points == 5000
    assert result.points == 30_000
    once = Options().having(passes=1)
    one_by_one = Identifier(grid, method="rls", options=once)(long)
    assert one_by_one.fitted_points == 500
    assert "thinned:60" in one_by_one.flags


def test_what_is_fitted_after_a_hold_keeps_its_phases(table):
    program = parse_program("hold:3,ramp:100@20,hold:2")
    t = np.arange(0.0, 10.01, 0.1)
    p = program.pressure_mbar(t)
    chosen = choose(Curve("c", Setup(6.0, 1.1, program), t, p, 0.01 * p), ("load",), table)
    assert set(chosen.samples.phase) == {"load"}
