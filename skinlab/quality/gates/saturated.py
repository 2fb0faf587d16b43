"""The deflection is at the end of the sensor's range: it stays at its highest reading."""

from __future__ import annotations

from skinlab.quality.gates.base import CurveSoFar, Finding, Gate
from skinlab.quality.gates.standstill import deflection_standstills


def _check(view: CurveSoFar) -> Finding | None:
    highest = float(view.deflection_mm.max(initial=0.0))
    for still in deflection_standstills(view.tail):
        if not still.at_top or still.clipped is False or still.reading < highest:
            continue
        return Finding(
            GATE.name,
            f"the deflection stays at its highest reading, {still.reading:.3f} mm, while the "
            f"pressure goes on to {still.high_mbar:.0f} mbar: the end of the sensor's range"
            + ("" if still.clipped else ", or a stuck sensor"),
            "measure to a lower pressure, or through a smaller opening",
        )
    return None


GATE = Gate(
    "saturated",
    _check,
    meaning="the deflection stays at its highest reading while the pressure rises",
    threshold="as for `frozen`; a sensor that comes back where it stopped is saturated, not "
    "frozen. Until then both flags are raised",
)
