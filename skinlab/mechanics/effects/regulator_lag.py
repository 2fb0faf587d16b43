"""The suction under the probe follows that at the pressure sensor, late."""

from __future__ import annotations

from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.effects.base import Effect, Parameter, Values


class RegulatorLag(Effect):
    """See the module."""

    name = "regulator_lag"
    meaning = "the suction that the skin feels follows the measured one late"
    formula = "tau dp_felt/dt = p − p_felt"
    source = "flow through tube and regulator: a first-order volume; 0.1–0.3 s"
    physical = True
    parameters = (
        Parameter(
            "tau_s", "s", "time constant with which it follows", 0.0, 2.0, 0.0, 0.15,
            "regulators of suction probes: 0.1–0.3 s",
        ),
    )  # fmt: skip

    def felt(self, path: PressurePath, values: Values) -> PressurePath:
        """Follow by a lag of the first order."""
        return path.late_by(values["tau_s"])


EFFECT = RegulatorLag()
