"""Newton's method and the path: quadratic, balanced in energy, and honest where it ends."""

import numpy as np
import pytest

from skinlab.mechanics.fem.newton import StepSettings, extrapolate, follow, solve_point
from skinlab.mechanics.fem.suction import (
    LINEAR_DILATATION_MESH,
    MBAR,
    MESH_OF_RECORD,
    Geometry,
    assembly_for,
    solve,
)

SKIN = {"X1_MPa": 0.03, "X2_MPa": 1.0, "kappa_MPa": 0.17757575757575758}
GEOMETRY = Geometry(6.0, 1.0)
LAW = "extended_neo_hookean"


@pytest.mark.parametrize("mesh", [MESH_OF_RECORD, LINEAR_DILATATION_MESH], ids=lambda m: m.name)
def test_newton_converges_quadratically(mesh):
    assembly, _ = assembly_for(GEOMETRY, mesh, LAW)
    path = follow(assembly, 40 * MBAR, SKIN, 3.0)
    # Constrained to quadratic from a start that is 1 % of the solution off: c' = C c².
    u = path.displacements[-1] * 1.01
    corrections = []
    while not corrections or corrections[-1] > 1e-11:
        state = assembly.evaluate(u, 40 * MBAR, SKIN)
        factor = state.matrix.factorise()
        step = factor.solve(-state.residual)
        corrections.append(float(np.abs(step).max()))
        u += step
        assert len(corrections) < 10
    seen = np.log([c for c in corrections if c > 1e-11])  # above round-off
    orders = np.diff(seen)[1:] / np.diff(seen)[:-1]
    assert orders[-1] == pytest.approx(2.0, abs=0.3)
    np.testing.assert_allclose(u, path.displacements[-1], atol=1e-8)


@pytest.mark.parametrize("x1", [0.01, 0.03, 0.1])
def test_every_accepted_point_is_an_equilibrium(x1):
    skin = {**SKIN, "X1_MPa": x1}
    assembly, apex = assembly_for(GEOMETRY, MESH_OF_RECORD, LAW)
    path = follow(assembly, 100 * MBAR, skin, 3.0, watch=apex)
    for p, u in zip(path.pressure_mpa[1:], path.displacements[1:], strict=True):
        state = assembly.evaluate(u, p, skin)
        factor = state.matrix.factorise()
        step = factor.solve(-state.residual)
        assert np.abs(step).max() < StepSettings().correction


@pytest.mark.parametrize("mesh", [MESH_OF_RECORD, LINEAR_DILATATION_MESH], ids=lambda m: m.name)
def test_work_of_the_pressure_is_the_stored_energy(mesh):
    assembly, apex = assembly_for(GEOMETRY, mesh, LAW)
    tight = StepSettings(extrapolation_error=1e-6, correction=1e-11)
    path = follow(assembly, 100 * MBAR, SKIN, 3.0, tight, watch=apex)
    p, volume, energy = (np.array(x) for x in (path.pressure_mpa, path.volume, path.energy))
    # ∫ p dV = p V − ∫ V dp, with V(p) as cubic Hermite: dV/dp = load · du/dp
    slope = np.array(
        [
            assembly.evaluate(u, q, SKIN).load @ s
            for q, u, s in zip(p, path.displacements, path.slopes, strict=True)
        ]
    )
    h = np.diff(p)
    area = (0.5 * h * (volume[1:] + volume[:-1]) + h**2 / 12 * (slope[:-1] - slope[1:])).sum()
    work = p[-1] * volume[-1] - area
    assert volume[0] == pytest.approx(0.0, abs=1e-12)
    assert work == pytest.approx(energy[-1], rel=1e-6)


def test_the_slope_is_that_of_the_curve():
    pressure = 47.0
    h = np.array([2.0, 1.0, 0.5])
    tight = StepSettings(extrapolation_error=1e-6, correction=1e-12)
    at = solve(GEOMETRY, SKIN, pressure, settings=tight).slope_mm_per_mbar[-1]
    w = [
        [solve(GEOMETRY, SKIN, pressure + s * k, settings=tight).deflection_mm[-1] for s in (-1, 1)]
        for k in h
    ]
    errors = [abs((up - down) / (2 * k) - at) for (down, up), k in zip(w, h, strict=True)]
    assert np.polyfit(np.log(h), np.log(errors), 1)[0] == pytest.approx(2, abs=0.1)


def test_the_curve_does_not_depend_on_the_steps():
    pressure = np.arange(0.0, 101.0)
    usual = solve(GEOMETRY, SKIN, 100.0)(pressure)
    many = solve(GEOMETRY, SKIN, 100.0, settings=StepSettings(extrapolation_error=1e-7))(pressure)
    assert len(solve(GEOMETRY, SKIN, 100.0).pressure_mbar) < 20
    np.testing.assert_allclose(usual, many, atol=5e-5)  # mm: 0.05 µm


def test_a_curve_goes_on_from_the_end_of_a_shorter_one():
    short, whole = solve(GEOMETRY, SKIN, 100.0), solve(GEOMETRY, SKIN, 150.0)
    points, spent = len(short.path.pressure_mpa), short.iterations
    further = solve(GEOMETRY, SKIN, 150.0, after=short)
    assert (further.holds_to_mbar, further.stopped) == (150.0, "")
    p = np.linspace(0.0, 150.0, 151)
    np.testing.assert_allclose(further(p), whole(p), atol=1e-4)
    assert (further(p[:100]) == short(p[:100])).all()  # where they part, to round-off
    assert further.iterations < 1.5 * spent
    assert (len(short.path.pressure_mpa), short.iterations) == (points, spent)


def test_extrapolation_is_exact_for_cubics():
    assembly, _ = assembly_for(GEOMETRY, MESH_OF_RECORD, LAW)
    path = follow(assembly, 1e-4, SKIN, 3.0)
    cubic = np.polynomial.Polynomial([0.0, 1.0, -2.0, 0.5])
    path.pressure_mpa = [1.0, 1.5]
    path.displacements = [np.array([cubic(p)]) for p in path.pressure_mpa]
    path.slopes = [np.array([cubic.deriv()(p)]) for p in path.pressure_mpa]
    assert extrapolate(path, 2.2)[0] == pytest.approx(cubic(2.2), rel=1e-13)


def test_what_does_not_converge_gives_nothing():
    assembly, _ = assembly_for(GEOMETRY, MESH_OF_RECORD, LAW)
    far = np.zeros(assembly.n)
    point, spent = solve_point(assembly, far, 0.05, SKIN, StepSettings())  # 500 mbar in one step
    assert point is None
    assert spent >= 1


def test_a_path_that_fails_says_where():
    few = StepSettings(most_iterations=1, tries=1)
    curve = solve(GEOMETRY, SKIN, 100.0, settings=few)
    assert curve.stopped.startswith("no convergence beyond ")
    assert curve.holds_to_mbar < 100.0
    assert np.isnan(curve([99.0])).all()
