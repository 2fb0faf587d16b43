"""What changes from loading to loading of a site, in a way that nobody knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.learned import LearnedEffect, Seen, coefficients, sines
from skinlab.mechanics.fem.skin import SkinProblem

_LAST = 10  # cycles, beyond which nothing changes


class LearnedHistory(LearnedEffect):
    """See the module."""

    name = "learned_history"
    family = "history"
    meaning = "the skin's stiffness changes from loading to loading, as found from the data"
    formula = "W × exp(Σ c_k sin((k − ½) π x)), x = log(cycle) / log(10)"
    source = "Abbas et al. 2021: cycles differ; Gaussian process"
    physical = True
    parameters = coefficients(4, "", 1.5, 0.1)
    x_name = "cycle"
    y_name = "stiffness_over_first"

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Change the stiffness by the loading's number."""
        factor = float(self.function(np.array([float(cycle)]), values)[0])
        return replace(problem, stiffness=problem.stiffness * factor)

    def abscissa(self, seen: Seen) -> Array:
        """Return the loadings' numbers."""
        return np.arange(1.0, max(seen.cycle, 2) + 1.0)

    def function(self, at: Array, values: Values) -> Array:
        """Return the stiffness (m,) over that of the first loading."""
        return np.exp(sines(np.log(at) / np.log(_LAST), values, self.names))

    def sentence(self, x: Array, y: Array) -> str:
        """Say how the stiffness goes on."""
        i = int(np.abs(y - 1.0).argmax())
        what = "stiffer" if y[i] > 1 else "softer"
        return (
            "changes from loading to loading of a site: at number "
            f"{x[i]:.0f} the skin is {100 * abs(y[i] - 1):.0f} % {what} than at its first"
        )


EFFECT = LearnedHistory()
