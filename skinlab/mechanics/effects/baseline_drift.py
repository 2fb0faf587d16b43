"""The deflection channel drifts with time."""

from __future__ import annotations

from skinlab.mechanics.effects.base import Array, Effect, Parameter, Values


class BaselineDrift(Effect):
    """See the module."""

    name = "baseline_drift"
    meaning = "the deflection channel drifts with time"
    formula = "w + drift × (t − t of the first sample)"
    source = "temperature and creep of the holder"
    physical = False
    order = 3
    form_of = "time"
    parameters = (
        Parameter(
            "drift_um_per_s", "µm/s", "speed of the zero", -50.0, 50.0, 0.0, 1.0,
            "no published size: a range to look in",
        ),
    )  # fmt: skip

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Add what has drifted since the curve's first sample."""
        return deflection_mm + 1e-3 * values["drift_um_per_s"] * since_s


EFFECT = BaselineDrift()
