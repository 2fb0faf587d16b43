"""Pump, valve and chamber of the simulated probe: what the pressure does."""

from __future__ import annotations

import math

PUMP_LAG_S = 0.020  # first-order lag behind the set point
PUMP_RATE_MBAR_PER_S = 3000.0  # the pump cannot pull faster
VALVE_TIME_S = 0.050  # time constant of the open valve
LIFTED_PART = 0.05  # of the suction is all that the pump holds with no skin under the probe
_EMPTY_MBAR = 1e-6  # below this the chamber counts as vented exactly


class Plant:
    """Pressure of the chamber above the skin, in mbar of suction.

    step_s: length of one step; all constants are exact for it. What is wrong with it can be set
    before each step: `opening` of the valve (1: whole), `lost` part of the suction, `excess_mbar`
    of the pump, and `lifted` off the skin.
    """

    def __init__(self, step_s: float) -> None:
        self.pressure_mbar = 0.0
        self.opening = 1.0
        self.lost = 0.0
        self.excess_mbar = 0.0
        self.lifted = False
        self._follow = 1.0 - math.exp(-step_s / PUMP_LAG_S)
        self._release = 1.0 - math.exp(-step_s / VALVE_TIME_S)
        self._most_up = PUMP_RATE_MBAR_PER_S * step_s

    def step(self, set_point_mbar: float, valve_open: bool) -> None:
        """Advance one step: follow the set point, or fall through the open valve."""
        pressure = self.pressure_mbar
        # With no skin under it the chamber is open, whatever the valve does
        most_down = pressure * self._release * (1.0 if self.lifted else self.opening)
        if valve_open:
            pressure -= most_down
        else:
            wanted = set_point_mbar + self.excess_mbar if set_point_mbar > 0 else 0.0
            wanted *= LIFTED_PART if self.lifted else 1.0 - self.lost
            # Down is the valve's work too: no faster than an open one
            change = (wanted - pressure) * self._follow
            pressure += min(max(change, -most_down), self._most_up)
        self.pressure_mbar = 0.0 if pressure < _EMPTY_MBAR else pressure
