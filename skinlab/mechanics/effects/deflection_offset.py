"""The zero of the deflection channel is off."""

from __future__ import annotations

from skinlab.mechanics.effects.base import Array, Effect, Parameter, Values


class DeflectionOffset(Effect):
    """See the module."""

    name = "deflection_offset"
    meaning = "the zero of the deflection channel is off"
    formula = "w + offset, at all samples"
    source = "zero of the optical deflection channel"
    physical = False
    needs_history = False
    order = 2
    parameters = (
        Parameter(
            "offset_um", "µm", "what is read where nothing moves", -500.0, 500.0, 0.0, 20.0,
            "no published size: a range to look in",
        ),
    )  # fmt: skip

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Shift."""
        return deflection_mm + 1e-3 * values["offset_um"]


EFFECT = DeflectionOffset()
