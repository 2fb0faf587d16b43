"""A model's bounds and law are kept to, whatever else it says; and its bounds are told as its."""

from __future__ import annotations

import re

import numpy as np
import pytest

from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.discrepancy.model_identifier import with_model
from skinlab.discrepancy.starts import unknowns_of
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.inference.uncertainty import Sensor
from skinlab.mechanics.fem.skin import Skin
from skinlab.mechanics.materials import get_law
from skinlab.mechanics.model_file import EffectRange, Header, Model, Normal, Range, check_model
from skinlab.mechanics.names import plain
from skinlab.report.text import describe, explain
from skinlab.tables.forward import simulate

OFFSET = {"deflection_offset": {"offset_um": EffectRange(0.0)}}
SETUP = Setup(6.0, 1.0, parse_program("ramp:100@20"))


@pytest.fixture(scope="module")
def curve():
    found, _ = simulate(Skin((0.03, 1.0, 0.32)), SETUP)
    return found


@pytest.mark.parametrize(
    "effects",
    [
        pytest.param({}, id="plain"),
        pytest.param(OFFSET, id="with an effect", marks=pytest.mark.long),
    ],
)
def test_bounds_of_the_laws_parameters_hold(table, curve, effects):
    model = Model(Header("m"), {"X2_MPa": Range(2.0, 5.0, "log-uniform")}, effects)
    found = with_model(Identifier(table, sensor=Sensor(3.0, 0.0)), model)(curve)
    at = found.parameters["X2_MPa"]
    assert 2.0 * (1 - 1e-9) <= at.low <= at.value <= at.high <= 5.0 * (1 + 1e-9)
    assert "at_bound:X2_MPa" in found.flags
    (sentence,) = [s for s in explain(found) if "at the end of" in s and "X2" in s]
    assert "X2 at the end of the model's own bounds" in sentence
    assert "database" not in sentence
    lines = describe(found).splitlines()
    for name in found.parameters:  # no label runs into its value
        assert any(re.match(rf"  {plain(name)[0]} +-?[0-9]", line) for line in lines), lines


def test_the_databases_end_is_told_as_the_databases(table):
    stiff, _ = simulate(Skin((0.3, 1.0, 0.32)), SETUP, direct=True)
    found = Identifier(table, sensor=Sensor(3.0, 0.0))(stiff)
    assert "at_bound:X1_MPa" in found.flags
    (sentence,) = [s for s in explain(found) if "at the end of the database" in s]
    assert "X1" in sentence


@pytest.mark.parametrize(
    "effects",
    [
        pytest.param({}, id="plain"),
        pytest.param(OFFSET, id="with an effect", marks=pytest.mark.long),
    ],
)
def test_a_normal_prior_of_the_laws_parameters_counts(table, curve, effects):
    model = Model(Header("m"), {"nu": Range(0.2, 0.49, Normal(0.4, 1e-3))}, effects)
    found = with_model(Identifier(table, sensor=Sensor(3.0, 0.0)), model)(curve)
    at = found.parameters["nu"]
    assert at.value == pytest.approx(0.4, abs=5e-3)
    assert at.high - at.low < 0.01


def test_the_prior_of_unknowns_has_the_derivatives_it_says():
    ranges = {
        "X1_MPa": Range(0.01, 0.1, Normal(0.03, 0.01)),
        "X2_MPa": Range(0.0, 1e4, Normal(1.0, 0.2)),
        "nu": Range(0.2, 0.49, Normal(0.3, 0.1)),
    }
    unknowns = unknowns_of(Model(Header("m"), ranges, OFFSET))
    assert unknowns.space.transforms == ("log", "ratio", "linear")
    u = np.array([*unknowns.space.coordinates(np.array([0.04, 1.3, 0.35])), 0.7])
    h = 1e-6
    rise = [
        (unknowns.prior_rows(u + h * e) - unknowns.prior_rows(u - h * e)) / (2 * h)
        for e in np.eye(len(u))
    ]
    np.testing.assert_allclose(unknowns.prior_slopes(u), np.stack(rise, axis=1), atol=1e-6)


def test_bounds_are_stated_once():
    """What a model, an axis, a skin and a fit may be comes from the law's declaration."""
    law = get_law()
    for one in law.parameters:
        for bad in (one.high * 1.01, np.nan):
            values = {p.name: p.typical for p in law.parameters} | {one.name: bad}
            with pytest.raises(InputError, match=one.name):
                Skin(tuple(values.values()))
        wide = Model(Header("m"), {one.name: Range(one.low, one.high * 1.01)})
        with pytest.raises(InputError, match=rf"parameters\.{one.name}\.high"):
            check_model(wide)
    low, high = Model(Header("m")).space.bounds
    for one, a, b in zip(law.parameters, low, high, strict=True):
        assert one.low <= a < b <= one.high


@pytest.mark.parametrize("method", ["auto", "sto", "gn", "lm"])
def test_the_papers_grid_answers_in_the_other_convention(grid, curve, method):
    found = Identifier(grid, method=method, kappa="consistent", sensor=Sensor(3.0, 0.0))(curve)
    assert found.error is None
    low, high = grid.model(grid.spec.geometry, np.linspace(0, 100, 5), "consistent").space.bounds
    at = [v.value for v in found.parameters.values()]
    assert np.all(np.array(at) >= low - 1e-9)
    assert np.all(np.array(at) <= high + 1e-9)
    assert found.derived["nu_consistent"] == pytest.approx(found.parameters["nu"].value)


def test_the_grid_gives_no_answer_outside_its_nodes(grid):
    model = grid.model(grid.spec.geometry, np.linspace(0, 100, 5))
    low, high = model.space.bounds
    inside = 0.5 * (low + high)
    assert np.isfinite(model.deflection_mm(inside[None])).all()
    for d in range(3):
        for end, step in ((low, -0.01), (high, 0.01)):
            at = inside.copy()
            at[d] = end[d] + step * (high[d] - low[d])
            assert np.isnan(model.deflection_mm(at[None])).all()
            assert np.isnan(model.coordinate_slopes(at[None])).all()
