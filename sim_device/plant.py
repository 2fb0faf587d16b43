"""Pump, valve and chamber of the simulated probe: what the pressure does."""

from __future__ import annotations

import math

PUMP_LAG_S = 0.020  # first-order lag behind the set point
PUMP_RATE_MBAR_PER_S = 3000.0  # the pump cannot pull faster
VALVE_TIME_S = 0.050  # time constant of the open valve
_EMPTY_MBAR = 1e-6  # below this the chamber counts as vented exactly


class Plant:
    """Pressure of the chamber above the skin, in mbar of suction.

    step_s: length of one step; all constants are exact for it.
    """

    def __init__(self, step_s: float) -> None:
        self.pressure_mbar = 0.0
        self._follow = 1.0 - math.exp(-step_s / PUMP_LAG_S)
        self._release = 1.0 - math.exp(-step_s / VALVE_TIME_S)
        self._most_up = PUMP_RATE_MBAR_PER_S * step_s

    def step(self, set_point_mbar: float, valve_open: bool) -> None:
        """Advance one step: follow the set point, or fall through the open valve."""
        pressure = self.pressure_mbar
        most_down = pressure * self._release
        if valve_open:
            pressure -= most_down
        else:
            # Down is the valve's work too: no faster than an open one
            change = (set_point_mbar - pressure) * self._follow
            pressure += min(max(change, -most_down), self._most_up)
        self.pressure_mbar = 0.0 if pressure < _EMPTY_MBAR else pressure
