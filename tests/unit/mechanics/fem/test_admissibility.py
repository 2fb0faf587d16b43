"""What is not admissible is marked, with the pressure up to which the curve holds."""

import dataclasses

import numpy as np
import pytest

from skinlab.mechanics.fem.admissibility import NO_LIMITS, Limits, fault, surface
from skinlab.mechanics.fem.assembly import ellipticity, stress_and_tangent
from skinlab.mechanics.fem.newton import StepSettings
from skinlab.mechanics.fem.suction import MESH_OF_RECORD, Geometry, assembly_for, solve
from skinlab.mechanics.materials import get_law
from skinlab.mechanics.materials.compressibility import kappa_ratio

GEOMETRY = Geometry(6.0, 1.0)
LAW = "extended_neo_hookean"


def skin(x1, x2, nu):
    return {"X1_MPa": x1, "X2_MPa": x2, "kappa_MPa": x1 * kappa_ratio(nu, "paper")}


CREASES = [(0.01, 0.1, 0.2), (0.03, 0.1, 0.28), (0.07, 0.1, 0.28), (0.01, 0.4, 0.32)]


@pytest.mark.parametrize("entry", CREASES)
def test_soft_skin_is_marked_from_its_crease_on(entry):
    curve = solve(GEOMETRY, skin(*entry), 100.0)
    assert "at the tape's edge beyond" in curve.stopped
    assert 15 < curve.holds_to_mbar < 95
    assert curve.holds_to_mbar == curve.pressure_mbar[-1]
    p = np.arange(0.0, 101.0, 2.0)
    w = curve(p)
    assert np.isfinite(w[p <= curve.holds_to_mbar]).all()
    assert np.isnan(w[p > curve.holds_to_mbar]).all()
    # Before it nothing has changed: the same numbers as with no limits.
    unlimited = solve(GEOMETRY, skin(*entry), 100.0, settings=StepSettings(limits=NO_LIMITS))
    before = p[p <= curve.holds_to_mbar]
    np.testing.assert_allclose(curve(before), unlimited(before), rtol=1e-3)


@pytest.mark.parametrize("entry", CREASES)
def test_the_crease_is_where_the_volume_at_the_edge_turns_back(entry):
    """An independent sign of the fold: least det F falls with pressure up to it, then rises."""
    curve = solve(GEOMETRY, skin(*entry), 100.0)
    assert (np.diff(curve.path.j_min) < 5e-3).all()
    unlimited = solve(GEOMETRY, skin(*entry), 100.0, settings=StepSettings(limits=NO_LIMITS))
    j, p = np.array(unlimited.path.j_min), unlimited.pressure_mbar
    assert (np.diff(j)[p[1:] > curve.holds_to_mbar] > 0).any()


@pytest.mark.parametrize("entry", [(0.03, 1.0, 0.32), (0.01, 4.9, 0.2), (0.01, 0.1, 0.48)])
def test_good_skin_is_not_marked(entry):
    curve = solve(GEOMETRY, skin(*entry), 100.0)
    assert curve.stopped == ""
    assert curve.holds_to_mbar == 100.0


def test_each_check_answers_with_its_phrase():
    assembly, _ = assembly_for(GEOMETRY, MESH_OF_RECORD, LAW)
    parameters = skin(0.03, 1.0, 0.32)
    u = np.zeros(assembly.n)
    state = assembly.evaluate(u, 0.0, parameters)
    assert surface(assembly, u) == (0.0, 1.0)
    assert fault(assembly, u, state, Limits()) == ""
    assert "creases" in fault(assembly, u, state, Limits(surface_stretch=1.1))
    assert "volume" in fault(assembly, u, state, Limits(j_max=0.9))
    assert "volume" in fault(assembly, u, state, Limits(j_min=1.1))
    shears = dataclasses.replace(state, least_acoustic=lambda: -1e-9)
    assert "ellipticity" in fault(assembly, u, shears, Limits())
    assert fault(assembly, u, shears, NO_LIMITS) == ""
    nodes = assembly.mesh.free_surface
    rim, next_to_it = assembly.mesh.nodes[nodes[-1], 0], nodes[-2]
    u[assembly.equation[2 * next_to_it]] = 0.1  # beyond the rim
    assert rim == 3.0
    assert surface(assembly, u)[0] == pytest.approx(180.0)
    assert "folds" in fault(assembly, u, state, Limits())


def test_ellipticity_at_rest_is_the_shear_modulus():
    parameters = skin(0.03, 1.0, 0.32)
    rest = np.array([1.0, 0.0, 0.0, 1.0, 1.0])[:, None]
    _, _, moduli, _ = stress_and_tangent(rest, get_law(LAW), parameters)
    assert ellipticity(moduli)[0] == pytest.approx(2 * 0.03, rel=1e-12)


def test_ellipticity_is_the_least_curvature_of_the_energy_along_rank_one():
    parameters = skin(0.01, 4.9, 0.2)
    law = get_law(LAW)
    f = np.array([0.7, 0.2, -0.1, 1.3, 1.1])
    _, _, moduli, _ = stress_and_tangent(f[:, None], law, parameters)
    h = 1e-3
    least = np.inf
    for a in np.arange(0, np.pi, np.pi / 36):
        for n in np.arange(8) * np.pi / 8:
            rank_one = np.outer([np.cos(a), np.sin(a)], [np.cos(n), np.sin(n)]).ravel()
            step = np.append(rank_one, 0.0) * h
            e = [
                stress_and_tangent((f + s * step)[:, None], law, parameters)[0][0]
                for s in (-1, 0, 1)
            ]
            least = min(least, (e[0] - 2 * e[1] + e[2]) / h**2)
    assert ellipticity(moduli)[0] == pytest.approx(least, rel=0.02)


def test_ellipticity_keeps_the_shape():
    f = np.ones((5, 2, 3)) * np.array([1.0, 0.0, 0.0, 1.0, 1.0])[:, None, None]
    _, _, moduli, _ = stress_and_tangent(f, get_law(LAW), skin(0.03, 1.0, 0.32))
    assert ellipticity(moduli).shape == (2, 3)
