"""The deflection sensor is not linear."""

from __future__ import annotations

from skinlab.mechanics.effects.base import Array, Effect, Parameter, Values

_USUAL_MM = 1.0


class SensorCurve(Effect):
    """See the module."""

    name = "sensor_curve"
    meaning = "the deflection sensor is not linear"
    formula = "w + curvature × w (w − exact), w in mm"
    source = "characteristic curve of optical distance sensors, calibrated at 0 and one height"
    physical = False
    form_of = "sensor_curve"
    needs_history = False
    parameters = (
        Parameter(
            "curvature_um", "µm", "curvature of its characteristic, over 1 mm²", -500.0, 500.0,
            0.0, 20.0, "no published size: a range to look in",
        ),
        Parameter(
            "exact_mm", "mm", "height at which it was calibrated (1 where it is not given)",
            0.05, 10.0, None, _USUAL_MM, "height of a dome: 0.1–2 mm", "log",
        ),
    )  # fmt: skip

    def full(self, values: Values) -> dict[str, float]:
        """Return the values; the sensor was calibrated at 1 mm where nobody says it.

        No default of the parameter, which would not be looked for.

        Raises:
            InputError: a parameter is not known, missing or out of bounds.
        """
        return super().full({"exact_mm": _USUAL_MM} | dict(values))

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Bend."""
        curvature = 1e-3 * values["curvature_um"]
        return deflection_mm + curvature * deflection_mm * (deflection_mm - values["exact_mm"])


EFFECT = SensorCurve()
