"""The stored points of the sequence are those that scipy makes.

`python tests/unit/inference/test_sobol.py` makes the file.
"""

import numpy as np
import pytest

from skinlab.inference import error_quadrature

DIMENSIONS = range(1, 8)
COUNT = 128


def made():
    found = {}
    for d in DIMENSIONS:
        found[f"normal{d}"] = error_quadrature.normal_points.__wrapped__(COUNT, d)
        found[f"student{d}"] = error_quadrature.student_points.__wrapped__(COUNT, d)
    return found


def test_the_stored_points_are_the_sequences(monkeypatch):
    monkeypatch.setattr(error_quadrature, "_stored_points", dict)  # none: made anew
    with np.load(error_quadrature.POINTS) as stored:
        expected = made()
        assert sorted(stored) == sorted(expected)
        for name, points in expected.items():
            np.testing.assert_allclose(stored[name], points, rtol=1e-13)


@pytest.mark.parametrize(
    "points", [error_quadrature.normal_points, error_quadrature.student_points]
)
def test_fewer_points_are_the_first_ones_and_more_are_made(points):
    np.testing.assert_array_equal(points(19, 3), points(COUNT, 3)[:19])
    np.testing.assert_array_equal(points(2 * COUNT, 2)[:COUNT], points(COUNT, 2))


if __name__ == "__main__":
    error_quadrature.POINTS.unlink(missing_ok=True)
    np.savez(error_quadrature.POINTS, **made())
