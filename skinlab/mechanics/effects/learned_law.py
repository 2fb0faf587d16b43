"""An increment of the law that nobody knows: energy that the law lacks or has too much of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from skinlab.mechanics.effects.base import Array, Parameter, Values
from skinlab.mechanics.effects.learned import LearnedEffect, Seen, less_gain
from skinlab.mechanics.fem.skin import SkinProblem, Term
from skinlab.mechanics.materials import get_law
from skinlab.mechanics.materials.base import Energy, Potential, potential_of_j1

_BENDS = (0.003, 0.01, 0.03, 0.1)  # of J1 − 3, about which each shape bends
_LARGEST = 0.06  # J1 − 3 that a function is drawn to
_SOURCE = "a smooth function of unknown form; its size is learned from the data"


class Increment(Energy):
    """ΔW(J1) whose slopes by J1 are Σ c_k x²/√(1 + x²), x = (J1 − 3)/a_k."""

    name = "increment"
    linear = True
    parameter_names = tuple(f"c{k}" for k in range(1, len(_BENDS) + 1))
    source = _SOURCE

    def isochoric(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        """Return energy and derivatives; the coefficients in MPa."""

        def energy(e: Array) -> tuple[Array, Array, Array]:
            value = first = second = 0.0 * e
            for name, bend in zip(self.parameter_names, _BENDS, strict=True):
                c, x = parameters[name], e / bend
                root = np.sqrt(1.0 + x * x)
                # The slope is x²/√(1 + x²) of the sign of x: none at rest, straight beyond the bend
                value = value + c * bend * (0.5 * x * root - 0.5 * np.arcsinh(x))
                first = first + c * x * x / root
                second = second + c / bend * (2.0 * x + x**3) / root**3
            return value, first, second

        return potential_of_j1(i1, j, energy)


INCREMENT = Increment()


class LearnedLaw(LearnedEffect):
    """See the module."""

    name = "learned_law"
    family = "law"
    meaning = "the skin stiffens with stretch in another way than the law says, found from the data"
    formula = "dW/dJ1 + (μ/2) Σ c_k x²/√(1 + x²), x = (J1 − 3)/a_k, a of 0.003, 0.01, 0.03, 0.1"
    source = "laws of soft tissue differ in how stiffness grows with stretch"
    physical = True
    needs_history = False
    parameters = tuple(
        Parameter(
            f"c{k}", "", f"of the shape that bends at {a:g}, in the stiffness at rest", -20.0, 20.0,
            0.0, 0.3, _SOURCE,
        )
        for k, a in enumerate(_BENDS, start=1)
    )  # fmt: skip
    x_name = "J1_less_3"
    y_name = "slope_over_that_at_rest"

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Add the increment to the skin's own energy."""
        if not any(values[n] for n in self.names):
            return problem
        law = get_law(problem.skin.law)
        half_shear = float(law.checked_modulus(problem.skin.named))
        own = tuple((n, half_shear * values[n]) for n in self.names)
        return replace(problem, terms=(*problem.terms, Term(INCREMENT, own)))

    def abscissa(self, seen: Seen) -> Array:
        """Return J1 − 3 up to that of strong domes."""
        return np.linspace(0.0, _LARGEST, 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return the increment of dW/dJ1 (m,), in μ/2."""
        x = at[:, None] / np.array(_BENDS)
        return np.asarray(x**2 / np.sqrt(1.0 + x**2) @ np.array([values[n] for n in self.names]))

    def shown(self, x: Array, y: Array) -> Array:
        """Leave out what is in proportion: laws have that."""
        return less_gain(x, y)

    def sentence(self, x: Array, y: Array) -> str:
        """Say where it is stiffer or softer than the law."""
        i = int(np.abs(y).argmax())
        return (
            "depends on the stretch, not on time or opening: the skin's law is another one, and "
            f"{'stiffer' if y[i] > 0 else 'softer'} than this law about J1 − 3 = {x[i]:.2g}"
        )


EFFECT = LearnedLaw()
