"""The two channels are not simultaneous."""

from __future__ import annotations

from skinlab.mechanics.effects.base import Array, Effect, Parameter, Values


class PressureLag(Effect):
    """See the module."""

    name = "pressure_lag"
    meaning = "the pressure and deflection channels are not simultaneous"
    formula = "the deflection recorded at t is that of t − lag"
    source = "filters and multiplexing of two channels"
    physical = False
    parameters = (
        Parameter(
            "lag_s", "s", "how much later the deflection is recorded", -1.0, 1.0, 0.0, 0.05,
            "no published size: a range to look in",
        ),
    )  # fmt: skip

    def when(self, time_s: Array, values: Values) -> Array:
        """Look back."""
        return time_s - values["lag_s"]


EFFECT = PressureLag()
