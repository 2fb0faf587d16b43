"""Fitted curves that are computed again, where a model of one's own was fitted."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.discrepancy.model_identifier import with_model
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.inference.stored_results import StoredResult, StoredValue
from skinlab.inference.uncertainty import Sensor
from skinlab.mechanics.effects.model import Skin, response
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.model_file import EffectRange, Header, Model, Range
from skinlab.report.fitted import fit_again
from skinlab.report.methods import assumptions, how

NOISE_UM = 2.0
PHASES = ("load", "hold", "unload", "rest")


@pytest.fixture(scope="module")
def identifier(table) -> Identifier:
    effects = {
        "viscoelasticity": {"g": EffectRange(0.2), "tau_s": EffectRange(2.0)},
        "deflection_gain": {"gain": EffectRange(1.05)},
    }
    given = Identifier(table, sensor=Sensor(NOISE_UM, 0.0))
    return with_model(given, Model(Header("creeping"), effects=effects))


@pytest.fixture(scope="module")
def noise_mm():
    return 1e-3 * NOISE_UM * np.random.default_rng(1).standard_normal(120)


@pytest.fixture(scope="module")
def curve(noise_mm) -> Curve:
    program = parse_program("ramp:60@30,hold:2,ramp:0@30")
    time_s = np.arange(120) / 20.0
    path = PressurePath.of_program(program)
    truth = {"viscoelasticity": {"g": 0.3, "tau_s": 1.0}, "deflection_gain": {"gain": 1.05}}
    w = response(Skin((0.025, 2.95, 0.28)), truth, Geometry(6.0, 1.0), path, time_s).deflection_mm
    return Curve("creep", Setup(6.0, 1.0, program), time_s, path(time_s), w + noise_mm)


def result_of(**values: float) -> StoredResult:
    parameters = {name.replace("__", "."): StoredValue(v) for name, v in values.items()}
    return StoredResult(phases=PHASES, parameters=parameters, rms_um=NOISE_UM, noise_um=NOISE_UM)


def test_effects_are_in_it_stored_values_before_those_of_the_model(curve, identifier, noise_mm):
    stored = result_of(
        X1_MPa=0.025, X2_MPa=2.95, nu=0.28, viscoelasticity__g=0.3, viscoelasticity__tau_s=1.0
    )
    fit = fit_again(curve, stored, identifier)
    assert fit.mask.all()
    np.testing.assert_allclose(fit.residual_mm, noise_mm, atol=1e-9)
    assert 0.87 < fit.within <= 1.0
    low, high = fit.ranges["viscoelasticity.g"]
    assert low <= 0.3 <= high


def test_the_base_law_alone_is_not_drawn_for_a_model_with_effects(curve, identifier, noise_mm):
    fit = fit_again(curve, result_of(X1_MPa=0.025, X2_MPa=2.95, nu=0.28), identifier)
    assert np.abs(fit.residual_mm - noise_mm).max() > 5e-3  # the model's own g, not the true one
    assert "differs from then" in fit.remark
    with pytest.raises(InputError, match="not those of its model"):
        fit_again(curve, result_of(X1_MPa=0.025), identifier)


@pytest.mark.parametrize(("share", "differs"), [(0.998, False), (1.002, False), (0.98, True)])
def test_the_database_in_place_of_finite_elements_is_no_other_program(
    curve, identifier, share, differs
):
    """It "leaves 4.41 µm, where 4.41 µm is stored", and nothing differed."""
    stored = result_of(
        X1_MPa=0.025, X2_MPa=2.95, nu=0.28, viscoelasticity__g=0.3, viscoelasticity__tau_s=1.0
    )
    now_um = 1e3 * np.sqrt(np.mean(fit_again(curve, stored, identifier).residual_mm ** 2))
    again = msgspec.structs.replace(stored, rms_um=share * now_um)
    assert ("differs from then" in fit_again(curve, again, identifier).remark) == differs


def test_a_thickness_with_an_uncertainty_is_in_it_as_it_was_found(curve, identifier, noise_mm):
    """The model has no such effect: the curve was drawn with the stated thickness."""
    thicker = replace(curve, setup=replace(curve.setup, thickness_mm=1 / 1.1, thickness_sd_mm=0.1))
    stored = result_of(
        X1_MPa=0.025, X2_MPa=2.95, nu=0.28, viscoelasticity__g=0.3, viscoelasticity__tau_s=1.0,
        thickness_error__ratio=1.1,
    )  # fmt: skip
    fit = fit_again(thicker, stored, identifier)
    np.testing.assert_allclose(fit.residual_mm, noise_mm, atol=1e-9)
    low, high = fit.ranges["thickness_error.ratio"]
    assert low < 1.1 < high


def test_the_model_is_told(identifier):
    said = " ".join(how(identifier, PHASES))
    assert "“creeping”" in said
    assert "load, hold, unload, rest" in said
    assert "each by its sample's error" in said
    assert "Gaussian" not in said
    first, second = assumptions(identifier)[:2]
    assert "deflection_gain" in first
    assert "viscoelasticity" in second


def test_bounds_of_a_model_are_what_was_searched(table, curve):
    model = Model(Header("narrow"), parameters={"nu": Range(0.25, 0.35)})
    identifier = with_model(Identifier(table), model)
    fit = fit_again(curve, result_of(X1_MPa=0.025, X2_MPa=2.95, nu=0.28), identifier)
    assert fit.ranges["nu"] == (0.25, 0.35)
