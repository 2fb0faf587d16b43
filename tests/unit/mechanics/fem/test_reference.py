"""The suction test against the curves of other programs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_answers import GeometryTo, reference_curves

from skinlab.errors import InputError
from skinlab.mechanics.fem.element import QUAD8_FULL
from skinlab.mechanics.fem.suction import (
    LINEAR_DILATATION_MESH,
    MESH_OF_RECORD,
    SCREENING_MESH,
    VERIFICATION_MESH,
    Discretisation,
    Geometry,
    solve,
)
from skinlab.mechanics.materials.compressibility import kappa_ratio

CASES = reference_curves(Path(__file__).parents[3] / "data" / "fe_reference")
CERTAIN = [case for case in CASES if case.certain]
SOME = {0, 7, 14, 19}  # the usual skin, a stiff one, one of high ν, another opening


def test_the_cases_are_there():
    assert len(CASES) == 26
    assert len(CERTAIN) == 21


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.name, marks=[pytest.mark.long] * (number not in SOME))
        for number, case in enumerate(CERTAIN)
    ],
)
def test_verification_mesh_within_a_thousandth(case):
    curve = solve(case.geometry, case.parameters, 100.0, discretisation=VERIFICATION_MESH)
    assert curve.stopped == ""
    assert np.abs(case.deviation(curve)).max() <= 1e-3


@pytest.mark.parametrize("case", CERTAIN, ids=lambda case: case.name)
def test_mesh_of_record_within_two_thousandths_and_to_the_end(case):
    curve = solve(case.geometry, case.parameters, 100.0)
    assert curve.stopped == ""
    assert curve.holds_to_mbar == 100.0
    assert np.abs(case.deviation(curve)).max() <= 2e-3
    pressure, deflection = case.curve()
    np.testing.assert_allclose(curve(pressure), deflection, rtol=4e-3, atol=1e-9)


@pytest.mark.parametrize("case", CASES[:2], ids=lambda case: case.name)
def test_same_mesh_same_numbers(case):
    """Uniform squares of 0.25 mm, 8 nodes, full integration: the other program's very mesh."""
    mesh = Discretisation("u0.25", QUAD8_FULL, 0.25 / 3, 1.0, 0.25 / 3, 0.25 / 6, 0.25)
    curve = solve(case.geometry, case.parameters, 100.0, discretisation=mesh)
    theirs = case.on_mesh["quad8_full_u0.25"]
    np.testing.assert_allclose(curve([20.0, 50.0, 100.0]) * 1e3, theirs, atol=0.02)  # µm


@pytest.mark.parametrize("nu", [0.45, 0.48])
@pytest.mark.parametrize(("x1", "x2"), [(0.01, 0.1), (0.03, 1.0), (0.1, 4.9)])
def test_an_element_that_cannot_lock_agrees_at_high_nu(nu, x1, x2):
    parameters = {"X1_MPa": x1, "X2_MPa": x2, "kappa_MPa": x1 * kappa_ratio(nu, "paper")}
    p = np.array([20.0, 50.0, 100.0])
    record = solve(Geometry(6.0, 1.0), parameters, 100.0)
    mixed = solve(Geometry(6.0, 1.0), parameters, 100.0, discretisation=LINEAR_DILATATION_MESH)
    both = p <= min(record.holds_to_mbar, mixed.holds_to_mbar)
    assert both.sum() >= 2  # the 9-node mesh folds a little earlier
    np.testing.assert_allclose(record(p)[both], mixed(p)[both], rtol=6e-3)


@pytest.mark.parametrize("case", [c for c in CASES if c.nu == 0.48], ids=lambda case: case.name)
def test_both_agree_with_the_reference_at_high_nu(case):
    for mesh in (MESH_OF_RECORD, LINEAR_DILATATION_MESH):
        curve = solve(case.geometry, case.parameters, 100.0, discretisation=mesh)
        assert np.abs(case.deviation(curve)).max() <= 2e-3


def test_the_problem_has_no_length_of_its_own():
    """w/R depends on p/X1, X2/X1, κ/X1 and h/R alone."""
    parameters = {"X1_MPa": 0.03, "X2_MPa": 1.0, "kappa_MPa": 0.18}
    twice = {k: 2 * v for k, v in parameters.items()}
    p = np.array([10.0, 40.0])
    small = solve(Geometry(2.0, 0.5), parameters, 50.0)(p)
    large = solve(Geometry(8.0, 2.0), twice, 100.0)(2 * p)
    np.testing.assert_allclose(large, 4 * small, rtol=1e-5)


def test_where_the_model_ends_hardly_matters():
    parameters = CASES[0].parameters
    near, far = (
        solve(GeometryTo(6.0, 1.0, ends_mm=end), parameters, 100.0)([100.0]) for end in (9.0, 15.0)
    )
    assert abs(near - far) < 5e-4  # mm
    assert Geometry(6.0, 1.0).outer_radius_mm == 9.0
    assert Geometry(2.0, 1.0).outer_radius_mm == 7.0


def test_what_is_out_of_range_is_refused():
    good = CASES[0].parameters
    for geometry in ((0.0, 1.0), (6.0, -1.0), (6.0, np.nan)):
        with pytest.raises(InputError):
            Geometry(*geometry)
    for parameters in ({**good, "X1_MPa": 0.0}, {**good, "kappa_MPa": np.inf}):
        with pytest.raises(InputError, match="MPa"):
            solve(Geometry(6.0, 1.0), parameters, 100.0)
    with pytest.raises(InputError, match="pressure_mbar"):
        solve(Geometry(6.0, 1.0), good, 0.0)


def test_a_curve_ends_a_little_beyond_its_ends():
    curve = solve(Geometry(6.0, 1.0), CASES[0].parameters, 100.0)
    inside, outside = [-2.0, 0.0, 50.0, 102.0], [-2.1, 102.1]
    assert np.isfinite(curve(inside)).all()
    assert np.isnan(curve(outside)).all()
    assert curve([0.0])[0] == 0.0


def test_meshes_have_names_of_their_own():
    meshes = (MESH_OF_RECORD, SCREENING_MESH, VERIFICATION_MESH, LINEAR_DILATATION_MESH)
    assert len({d.name for d in meshes}) == 4
    assert replace(MESH_OF_RECORD, name="other") != MESH_OF_RECORD
