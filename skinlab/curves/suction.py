"""Whether a curve's suction is counted as positive, as it is everywhere in this package."""

from __future__ import annotations

import numpy as np

from skinlab.curves.curve import Curve
from skinlab.curves.settings import SUCTION
from skinlab.errors import InputError


def check_suction(curve: Curve) -> None:
    """Refuse a curve whose suction is recorded as a pressure below zero.

    Raises:
        InputError: nearly all readings that are not about zero are below it; names the curve.
    """
    pressure = curve.pressure_mbar
    far = pressure[np.abs(pressure) > SUCTION.about_zero_mbar]
    below = int((far < 0).sum())
    if below < SUCTION.fewest_below or below < SUCTION.nearly_all * len(far):
        return
    raise InputError(
        f"{curve.name}: pressure_mbar goes down to {pressure.min():g}; expected a suction, which "
        "is positive: change its sign, or let `skinlab import` do so"
    )
