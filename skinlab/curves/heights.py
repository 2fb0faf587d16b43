"""The pressure that a height needed, of programs that are steered by it (`until:0.4mm@20`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinlab.curves.curve import Curve
from skinlab.curves.program import Until
from skinlab.curves.settings import HEIGHTS


@dataclass(frozen=True)
class Height:
    """What became of one rise: pressure (mbar) at the height, with its standard deviation.

    None where the height was not reached, or there are too few samples to say.
    """

    height_mm: float
    reached: bool
    pressure_mbar: float | None
    pressure_sd_mbar: float | None

    def to_json(self) -> dict[str, float | bool | None]:
        """Return it as plain data."""
        return {
            "height_mm": self.height_mm,
            "reached": self.reached,
            "pressure_mbar": self.pressure_mbar,
            "pressure_sd_mbar": self.pressure_sd_mbar,
        }


def heights_of(curve: Curve) -> tuple[Height, ...]:
    """Return what became of each rise until a height that the curve shows the end of."""
    program = curve.setup.program
    if program is None or curve.segment is None or not program.stops_at_heights:
        return ()
    found = []
    for k, one in enumerate(program.segments):
        last_of_all = k + 1 == len(program.segments) and not curve.partial  # the vent is no curve
        if not isinstance(one, Until) or not (last_of_all or (curve.segment > k).any()):
            continue
        last = np.flatnonzero(curve.segment == k)[-HEIGHTS.near :]
        reached, pressure, sd = True, None, None
        if len(last) >= 4:
            p, w = curve.pressure_mbar[last], curve.deflection_mm[last]
            middle = p.mean()
            slope, at = np.polyfit(p - middle, w, 1)
            left = w - at - slope * (p - middle)
            noise = float(np.sqrt(left @ left / (len(last) - 2)))
            ended = float(at + slope * (p[-1] - middle))
            near = p[-1] < one.most_mbar - max(HEIGHTS.at_most_mbar, 2 * float(np.diff(p).max()))
            reached = bool(near or ended >= one.height_mm - 3 * noise)
            if reached and slope > 0:
                pressure = float(middle + (one.height_mm - at) / slope)
                off = (pressure - middle) / np.sqrt(((p - middle) ** 2).sum())
                sd = float(noise / slope * np.sqrt(1 / len(last) + off**2))
        found.append(Height(one.height_mm, reached, pressure, sd))
    return tuple(found)
