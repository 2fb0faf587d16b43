"""The optimiser inside the cube, held against another program's bounded least squares."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from skinlab.inference.optimise import polish
from skinlab.parameters import Space


class Linear:
    """Residuals A x − b."""

    rest = 0.0

    def __init__(self, matrix, goal):
        self.matrix, self.goal = matrix, goal

    def __call__(self, parameters):
        return np.square(self.differences(parameters)).sum(axis=1)

    def differences(self, parameters):
        return parameters @ self.matrix.T - self.goal

    def slopes(self, parameters):
        return np.broadcast_to(self.matrix, (len(parameters), *self.matrix.shape))


@pytest.mark.parametrize("seed", range(12))
def test_a_step_that_meets_walls_goes_on_along_them(seed):
    """Unknowns that trade for each other, optima outside: what is merely cut at a wall leads up."""
    rng = np.random.default_rng(seed)
    k = 5
    matrix = rng.normal(size=(40, k)) @ (np.eye(k) + 3.0 * np.ones((k, k)))
    matrix += 0.3 * rng.normal(size=(40, k))
    problem = Linear(matrix, matrix @ rng.uniform(-1.5, 2.5, k))
    space = Space.box([f"x{i}" for i in range(k)], [0.0] * k, [1.0] * k)
    starts = rng.uniform(0.1, 0.9, (6, k))
    found = polish(space, problem, starts, least_gain=1e-12)
    known = lsq_linear(matrix, problem.goal, (0.0, 1.0), tol=1e-14)
    assert found.converged.all()
    np.testing.assert_allclose(found.cost, 2.0 * known.cost, rtol=1e-9, atol=1e-9)
    assert found.iterations <= 3 * k
