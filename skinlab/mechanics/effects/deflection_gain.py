"""The deflection channel reads too much or too little."""

from __future__ import annotations

from skinlab.mechanics.effects.base import Array, Effect, Parameter, Values


class DeflectionGain(Effect):
    """See the module."""

    name = "deflection_gain"
    meaning = "the deflection channel reads too much or too little"
    formula = "gain × w"
    source = "calibration of the optical deflection channel"
    physical = False
    needs_history = False
    order = 1
    parameters = (
        Parameter(
            "gain", "", "factor; 1 is right", 0.5, 2.0, 1.0, 1.05,
            "no published size: a range to look in",
        ),
    )  # fmt: skip

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Multiply."""
        return values["gain"] * deflection_mm


EFFECT = DeflectionGain()
