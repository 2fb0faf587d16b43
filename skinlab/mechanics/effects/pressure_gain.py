"""The pressure channel reads too little or too much: exactly a stiffer or softer skin."""

from __future__ import annotations

from dataclasses import replace

from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import SkinProblem


class PressureGain(Effect):
    """See the module."""

    name = "pressure_gain"
    meaning = "the skin feels more or less suction than the pressure channel says"
    formula = "w(gain × p)"
    source = "calibration of the pressure channel; leaks between sensor and opening"
    physical = True
    needs_history = False
    bends = True
    order = 1
    same_as = "a stiffer or softer skin: curves depend on p/X1 and X2/X1 only"
    parameters = (
        Parameter(
            "gain", "", "suction felt over suction read; 1 is right", 0.5, 2.0, 1.0, 1.03,
            "no published size: a range to look in",
        ),
    )  # fmt: skip

    def felt(self, path: PressurePath, values: Values) -> PressurePath:
        """Multiply."""
        gain = values["gain"]
        return replace(path, pressure_mbar=tuple(gain * p for p in path.pressure_mbar))

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Leave the skin alone: what it feels is another path."""
        return problem


EFFECT = PressureGain()
