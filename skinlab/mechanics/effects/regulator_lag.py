"""The suction under the probe follows that at the pressure sensor, late."""

from __future__ import annotations

import math
from dataclasses import replace

from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.effects.base import Effect, Parameter, Values

# Times after each corner, of the lag: between them a chord of exp(−t) is off by 0.35 % at most,
# by as much in each but the last.
_PIECES = (*(-2.0 * math.log(1.0 - k / 12.0) for k in range(1, 12)), 7.5)


class RegulatorLag(Effect):
    """See the module."""

    name = "regulator_lag"
    meaning = "the suction that the skin feels follows the measured one late"
    formula = "tau dp_felt/dt = p − p_felt"
    source = "flow through tube and regulator: a first-order volume; 0.1–0.3 s"
    physical = True
    needs_history = True
    parameters = (
        Parameter(
            "tau_s", "s", "time constant with which it follows", 0.0, 2.0, 0.0, 0.15,
            "regulators of suction probes: 0.1–0.3 s",
        ),
    )  # fmt: skip

    def felt(self, path: PressurePath, values: Values) -> PressurePath:
        """Follow in closed form, piece by piece: p_felt = p − lag s + (…) exp(−t/lag)."""
        lag = values["tau_s"]
        if lag <= 0.0:
            return path
        times, pressures = list(path.time_s), list(path.pressure_mbar)
        at, found = pressures[0], [(times[0], pressures[0])]
        ends = [*zip(times[1:], pressures[1:], strict=True)]
        ends.append((times[-1] + _PIECES[-1] * lag, pressures[-1]))
        begin, p = times[0], pressures[0]
        for end, q in ends:
            length = end - begin
            if length > 0:
                slope = (q - p) / length
                settled = p - slope * lag
                for since in (*(s * lag for s in _PIECES if s * lag < length), length):
                    value = settled + slope * since + (at - settled) * math.exp(-since / lag)
                    found.append((begin + since, value))
                at = found[-1][1]
            begin, p = end, q
        return replace(
            path, time_s=tuple(t for t, _ in found), pressure_mbar=tuple(v for _, v in found)
        )


EFFECT = RegulatorLag()
