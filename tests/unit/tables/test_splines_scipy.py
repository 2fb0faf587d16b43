"""Our B-splines are scipy's, which is not used because it is slow to import."""

import pickle

import numpy as np
import pytest
from scipy.interpolate import BSpline, NdBSpline, make_interp_spline

from skinlab.mechanics.fem import kernel
from skinlab.tables.splines import (
    TensorBSpline,
    design,
    inverse_of,
    knots_through,
    local_basis,
)

UNEVEN = np.array([0.0, 0.3, 1.0, 1.4, 2.5, 3.0, 4.1])


@pytest.mark.parametrize(("count", "degree"), [(7, 3), (7, 1), (7, 5), (7, 6), (4, 3), (3, 2)])
def test_interpolation_is_scipys(count, degree):
    nodes = UNEVEN[:count]
    expected = make_interp_spline(nodes, np.eye(count), k=degree)
    np.testing.assert_array_equal(knots_through(nodes, degree), expected.t)
    np.testing.assert_allclose(inverse_of(nodes, degree), expected.c, atol=1e-11)
    at = np.linspace(nodes[0], nodes[-1], 33)
    knots = knots_through(nodes, degree)
    basis = BSpline.design_matrix(at, knots, degree).toarray()
    np.testing.assert_allclose(design(knots, degree, at), basis, atol=1e-14)
    first, slopes = local_basis(knots, degree, at, slope=True)
    coefficients = np.arange(count) ** 1.5
    found = np.take_along_axis(
        np.tile(coefficients, (len(at), 1)), first[:, None] + np.arange(degree + 1), axis=1
    )
    expected = BSpline(knots, coefficients, degree).derivative()(at)
    np.testing.assert_allclose((found * slopes).sum(axis=1), expected, atol=1e-12)


@pytest.mark.parametrize("compiled", [True, False])
def test_tensor_splines_are_scipys(compiled, monkeypatch):
    if compiled and kernel.library() is None:
        pytest.skip("there is no compiled kernel in this installation")
    if not compiled:
        monkeypatch.setattr(kernel, "library", lambda: None)
    rng = np.random.default_rng(3)
    nodes, degrees = (UNEVEN, UNEVEN[:5], UNEVEN[:4]), (3, 1, 3)
    knots = [knots_through(x, k) for x, k in zip(nodes, degrees, strict=True)]
    values = rng.normal(size=(7, 5, 4, 3))
    ours, theirs = TensorBSpline(knots, degrees, values), NdBSpline(tuple(knots), values, degrees)
    points = rng.random((700, 3)) * [4.1, 2.5, 1.4]
    points[:2] = [[0.0, 0.0, 0.0], [4.1, 2.5, 1.4]]
    np.testing.assert_allclose(ours(points), theirs(points), atol=1e-13)
    for d in range(3):
        expected = theirs(points, nu=np.eye(3, dtype=int)[d])
        np.testing.assert_allclose(ours.slopes(points)[:, d], expected, atol=1e-12)
    assert ours(points[:0]).shape == (0, 3)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(ours))(points), ours(points))
