"""A homogeneous deformation must come out exactly, on any mesh."""

from dataclasses import replace

import numpy as np
import pytest
from known_answers import distorted

from skinlab.mechanics.fem.assembly import Assembly, stress_and_tangent
from skinlab.mechanics.fem.element import ELEMENTS
from skinlab.mechanics.fem.mesh import grid_mesh
from skinlab.mechanics.materials import get_law

PARAMETERS = {
    "extended_neo_hookean": {"X1_MPa": 0.03, "X2_MPa": 1.0, "kappa_MPa": 0.18},
    "mooney_rivlin": {"C10_MPa": 0.5, "C01_MPa": 0.1, "kappa_MPa": 40.0},
}
NOTHING = np.array([], dtype=np.intp)


def patch(element, law):
    mesh = grid_mesh(np.array([0.0, 0.5, 1.1, 2.0]), np.array([0.0, 0.4, 1.0]), 9, 9, element.nodes)
    mesh = distorted(mesh, 0.3, np.random.default_rng(3))
    assert np.abs(mesh.nodes - mesh.nodes.round(1)).max() > 0.01  # it is distorted
    mesh = replace(mesh, loaded_edges=mesh.loaded_edges[:0])
    return Assembly(mesh, element, get_law(law), NOTHING)


def dense(state):
    n, width = state.tangent.shape
    matrix = np.zeros((n, n))
    for k in range(width):
        i = np.arange(n - k)
        matrix[i + k, i] = matrix[i, i + k] = state.tangent[: n - k, k]
    return matrix


@pytest.mark.parametrize("law", PARAMETERS)
@pytest.mark.parametrize("element", ELEMENTS.values(), ids=ELEMENTS)
@pytest.mark.parametrize(("across", "up"), [(0.3, -0.2), (-0.15, 0.4), (0.05, 0.05)])
def test_homogeneous_deformation_to_round_off(element, law, across, up):
    assembly = patch(element, law)
    parameters = PARAMETERS[law]
    r, z = assembly.mesh.nodes.T
    exact = np.column_stack([across * r, up * z]).ravel()
    f = np.array([1 + across, 0.0, 0.0, 1 + up, 1 + across])
    energy, stress, _, _ = stress_and_tangent(f[:, None], assembly.law, parameters)
    size = np.abs(stress).max()

    state = assembly.evaluate(exact, 0.0, parameters)
    np.testing.assert_allclose(
        state.deformation, np.broadcast_to(f[:, None, None], state.deformation.shape), atol=1e-14
    )
    assert state.energy == pytest.approx(float(energy[0]) * np.pi * 2.0**2 * 1.0, rel=1e-13)
    inside = (r > 0) & (r < 2) & (z > 0) & (z < 1)
    inner = np.repeat(inside, 2)
    assert np.abs(state.residual[inner]).max() < 1e-13 * size

    # With the outline moved and the inner nodes disturbed, Newton finds the way back.
    rng = np.random.default_rng(5)
    u = exact.copy()
    u[inner] += 0.02 * rng.uniform(-1, 1, int(inner.sum()))
    for _ in range(8):
        state = assembly.evaluate(u, 0.0, parameters)
        u[inner] -= np.linalg.solve(dense(state)[np.ix_(inner, inner)], state.residual[inner])
    np.testing.assert_allclose(u, exact, atol=1e-13)


@pytest.mark.parametrize("element", ELEMENTS.values(), ids=ELEMENTS)
def test_force_on_the_outline_is_stress_times_area(element):
    assembly = patch(element, "extended_neo_hookean")
    parameters = PARAMETERS["extended_neo_hookean"]
    r, z = assembly.mesh.nodes.T
    f = np.array([1.1, 0.0, 0.0, 1.2, 1.1])
    _, stress, _, _ = stress_and_tangent(f[:, None], assembly.law, parameters)
    state = assembly.evaluate(np.column_stack([0.1 * r, 0.2 * z]).ravel(), 0.0, parameters)
    on_top = z == z.max()
    axial = state.residual[1::2][on_top].sum()
    assert axial == pytest.approx(float(stress[3, 0]) * np.pi * 2.0**2, rel=1e-13)


@pytest.mark.parametrize("element", ELEMENTS.values(), ids=ELEMENTS)
def test_moving_along_the_axis_costs_nothing(element):
    assembly = patch(element, "extended_neo_hookean")
    u = np.zeros((len(assembly.mesh.nodes), 2))
    u[:, 1] = 0.7
    state = assembly.evaluate(u.ravel(), 0.0, PARAMETERS["extended_neo_hookean"])
    assert abs(state.energy) < 1e-15
    assert np.abs(state.residual).max() < 1e-14


def test_an_element_turned_inside_out_is_no_state():
    assembly = patch(ELEMENTS["quad8-full"], "extended_neo_hookean")
    r, z = assembly.mesh.nodes.T
    flipped = np.column_stack([0.0 * r, -2.0 * z]).ravel()
    assert assembly.evaluate(flipped, 0.0, PARAMETERS["extended_neo_hookean"]) is None


def test_a_mean_dilatation_that_is_not_positive_is_no_state():
    """det F grows like z³ and is positive everywhere; its linear projection is not."""
    mesh = grid_mesh(np.array([1.0, 2.0]), np.array([0.0, 1.0]), 9, 9, 9)
    mesh = replace(mesh, loaded_edges=mesh.loaded_edges[:0])
    r, z = mesh.nodes.T
    cubic = np.column_stack([r * (z + 0.02) - r, 0.5 * z**2 + 0.02 * z - z]).ravel()
    for name, there in (("quad9-full", True), ("quad9-linear-dilatation", False)):
        law = get_law("extended_neo_hookean")
        assembly = Assembly(mesh, ELEMENTS[name], law, NOTHING)
        state = assembly.evaluate(cubic, 0.0, PARAMETERS["extended_neo_hookean"])
        assert (state is not None) == there
