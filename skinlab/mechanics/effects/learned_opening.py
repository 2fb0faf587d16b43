"""Something that scales with the opening in a way that nobody knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinlab.mechanics.effects.base import Array, Parameter, Values
from skinlab.mechanics.effects.learned import LearnedEffect, Seen
from skinlab.mechanics.fem.skin import SkinProblem

_STATED_MM = 4.0  # the opening that all others are compared with
_SOURCE = "edges, tape and depth of the skin that is sucked; its size is learned from the data"


class LearnedOpening(LearnedEffect):
    """See the module."""

    name = "learned_opening"
    family = "opening"
    meaning = "the skin is stiffer under one opening than under another, as found from the data"
    formula = "W × exp(c1 x + c2 x² + c3 x³), x = log2(aperture / 4 mm)"
    source = "published stiffness depends on the probe's opening: Diridollou et al. 2000"
    physical = True
    needs_history = False
    parameters = tuple(
        Parameter(
            f"c{k}", "", f"of power {k} of the opening's logarithm", -2.0, 2.0, 0.0,
            0.1 / k**1.5, _SOURCE,
        )
        for k in (1, 2, 3)
    )  # fmt: skip
    x_name = "aperture_mm"
    y_name = "stiffness_over_smallest_opening"

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Change the stiffness by the opening."""
        aperture = np.array([problem.geometry.aperture_mm])
        factor = float(self.function(aperture, values)[0])
        return replace(problem, stiffness=problem.stiffness * factor)

    def abscissa(self, seen: Seen) -> Array:
        """Return the openings, from the smallest to the largest."""
        return np.array(sorted(seen.apertures_mm))

    def function(self, at: Array, values: Values) -> Array:
        """Return the stiffness (m,) over that under 4 mm."""
        x = np.log2(at / _STATED_MM)
        return np.asarray(np.exp(sum(values[n] * x**k for k, n in enumerate(self.names, start=1))))

    def shown(self, x: Array, y: Array) -> Array:
        """Compare with the first opening."""
        return y / y[..., :1]

    def sentence(self, x: Array, y: Array) -> str:
        """Say under which opening the skin is another one."""
        i = int(np.abs(np.log(y)).argmax())
        return (
            "depends on the opening, alike at every suction and time: under "
            f"{x[i]:.0f} mm the skin is {100 * abs(y[i] - 1):.0f} % "
            f"{'stiffer' if y[i] > 1 else 'softer'} than under {x[0]:.0f} mm"
        )


EFFECT = LearnedOpening()
