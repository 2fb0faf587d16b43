"""Gauss-Newton with a line search (the paper's eq. (12.b)): `gn-linesearch`.

x ← x + α W, with W of eq. (13) and α the best of 2, 1, 1/2, 1/4, …: E never rises, and next to the
minimum α = 1 keeps Gauss-Newton's speed. Points x + α W are moved into the space; unknowns that are
on its boundary and would leave are held there, so that the rest of W still leads downhill
(Bertsekas 1982, "Projected Newton methods", SIAM J. Control Optim. 20:221).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.methods.base import Method
from skinlab.inference.methods.gauss_newton import Search
from skinlab.inference.problem import Estimate, Options, Problem

Array = NDArray[np.float64]

_ALPHA = 2.0 ** np.arange(1, -21, -1)


def identify(
    problem: Problem, options: Options, rng: np.random.Generator, *, start: Array | None = None
) -> Estimate:
    """Return where E falls by no more than C, from `start` (k,) or the space's minimal values.

    Where no α lowers E, that is a minimum, unless the model ends right there.
    """
    del rng  # nothing is drawn
    search = Search(problem)
    unit, error = search.begin(start)
    for iteration in range(1, options.most_iterations + 1):
        step = search.step(unit, inwards=True)
        if step is None:
            return search.end(unit, error, iteration, converged=False)
        trials = np.clip(unit + _ALPHA[:, None] * step, 0.0, 1.0)
        errors = search.error_um(trials)
        best = int(np.argmin(errors))
        if not errors[best] < error:
            return search.end(unit, error, iteration, converged=bool(np.isfinite(errors[-1])))
        fall = error - float(errors[best])
        unit, error = trials[best], float(errors[best])
        if fall <= options.tolerance_um:
            return search.end(unit, error, iteration, converged=True)
    return search.end(unit, error, options.most_iterations, converged=False)


METHOD = Method(
    "gn-linesearch",
    identify,
    "Gauss-Newton with a line search, from the lowest values",
    in_papers_box=True,
)
