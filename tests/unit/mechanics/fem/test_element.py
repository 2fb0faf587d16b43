import numpy as np
import pytest

from skinlab.mechanics.fem.element import dilatation_basis, line_shape, quadrature, shape
from skinlab.mechanics.fem.mesh import Grading, graded_sizes, suction_mesh

rng = np.random.default_rng(1)


@pytest.mark.parametrize("nodes", [8, 9])
def test_shape_functions_reproduce_what_they_must(nodes):
    at = rng.uniform(-1, 1, (20, 2))
    values, slopes = shape(nodes, at)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0]])
    where = np.vstack([corners, [[0, 0]]])[:nodes].astype(float)
    own, _ = shape(nodes, where)
    np.testing.assert_allclose(own, np.eye(nodes), atol=1e-15)
    powers = [(i, j) for i in range(3) for j in range(3) if i + j <= 2]
    for i, j in powers:  # complete quadratics
        f = where[:, 0] ** i * where[:, 1] ** j
        x, y = at.T
        np.testing.assert_allclose(values @ f, x**i * y**j, atol=1e-14)
        np.testing.assert_allclose(slopes[..., 0] @ f, i * x ** max(i - 1, 0) * y**j, atol=1e-13)
        np.testing.assert_allclose(slopes[..., 1] @ f, j * x**i * y ** max(j - 1, 0), atol=1e-13)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_quadrature_is_exact_to_its_degree(n):
    at, weights = quadrature(n)
    for i in range(2 * n):
        for j in range(2 * n):
            exact = (1 + (-1) ** i) / (i + 1) * (1 + (-1) ** j) / (j + 1)
            assert weights @ (at[:, 0] ** i * at[:, 1] ** j) == pytest.approx(exact, abs=1e-14)


def test_line_and_dilatation_functions():
    at = rng.uniform(-1, 1, 7)
    values, slopes = line_shape(at)
    np.testing.assert_allclose(values @ [1.0, 1.0, 0.0], at**2, atol=1e-15)
    np.testing.assert_allclose(slopes @ [1.0, 1.0, 0.0], 2 * at, atol=1e-15)
    assert dilatation_basis(1, np.zeros((4, 2))).shape == (4, 1)
    np.testing.assert_array_equal(dilatation_basis(3, np.array([[0.5, 2.0]])), [[1, 0.5, 2.0]])


@pytest.mark.parametrize("length", [0.01, 0.3, 1.0, 6.0])
def test_graded_sizes_fill_the_length_and_keep_their_promises(length):
    sizes = graded_sizes(length, 0.05, 2.0, 0.4)
    assert sizes.sum() == pytest.approx(length, rel=1e-12)
    assert sizes.max() <= 0.4 + 1e-12
    if length > 0.4:
        assert sizes[0] == pytest.approx(0.05)
        assert (sizes[1:] / sizes[:-1]).max() <= 2.0 + 1e-9


@pytest.mark.parametrize("nodes", [8, 9])
def test_suction_mesh_has_its_lines_where_the_problem_needs_them(nodes):
    grading = Grading(0.05, 2.0, 0.4, 0.8, 0.25, quarter_point=True)
    mesh = suction_mesh(3.0, 1.0, 9.0, grading, nodes)
    r, z = mesh.nodes.T
    assert mesh.nodes[mesh.apex].tolist() == [0.0, 0.0]
    assert r[mesh.tape].min() == 3.0
    assert (z[mesh.tape] == 0).all()
    assert r[mesh.outer].tolist() == pytest.approx([9.0] * len(mesh.outer))
    assert r[mesh.loaded_edges[0, 0]] == 0.0
    assert r[mesh.loaded_edges[-1, 1]] == 3.0
    assert (mesh.loaded_edges[1:, 0] == mesh.loaded_edges[:-1, 1]).all()
    surface = mesh.free_surface
    assert surface[0] == mesh.apex
    assert surface[-1] == mesh.tape[0]
    assert (np.diff(r[surface]) > 0).all()
    # a quarter of the edge element away from the rim: the quarter points
    assert 3.0 - r[surface[-2]] == pytest.approx(0.05 / 4)


def test_tape_may_hold_from_further_out():
    mesh = suction_mesh(3.0, 1.0, 9.0, Grading(0.05, 2.0, 0.4, 0.8, 0.25), 8, held_from_mm=3.2)
    r = mesh.nodes[:, 0]
    assert r[mesh.tape].min() == pytest.approx(3.2)
    inner, outer = r[mesh.loaded_edges[-1, :2]]
    assert inner < mesh.loaded_to_mm == 3.0 < outer
    assert r[mesh.free_surface[-1]] == pytest.approx(3.2)
