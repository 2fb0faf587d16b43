"""Whether a curve is one of suction: counted as positive, and with a dome that follows it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.curves.program import MOST_PRESSURE_MBAR
from skinlab.curves.settings import SUCTION
from skinlab.errors import InputError


def check_suction(curve: Curve) -> None:
    """Refuse a curve whose suction is recorded as a pressure below zero, or in another unit.

    Raises:
        InputError: of the readings that are not about zero nearly all are below it, or most are
            beyond any program; names the curve.
    """
    pressure = curve.pressure_mbar
    far = pressure[np.abs(pressure) > SUCTION.about_zero_mbar]
    if 2 * int(beyond_any_program(far).sum()) > len(far):
        raise InputError(
            f"{curve.name}: pressure_mbar goes to {far[np.argmax(np.abs(far))]:g}; expected a "
            f"suction of at most {MOST_PRESSURE_MBAR:g} mbar, below that of the room (is its unit "
            "right?)"
        )
    below = int((far < 0).sum())
    if below < SUCTION.fewest_below or below < SUCTION.nearly_all * len(far):
        return
    raise InputError(
        f"{curve.name}: pressure_mbar goes down to {pressure.min():g}; expected a suction, which "
        "is positive: change its sign, or let `skinlab import` do so"
    )


def beyond_any_program(pressure_mbar: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which readings (n,) no program asks for, nor comes near: their unit is another."""
    return np.asarray(np.abs(pressure_mbar) > SUCTION.beyond * MOST_PRESSURE_MBAR)


def check_height(curve: Curve) -> None:
    """Refuse a curve whose dome is higher than its opening is wide; a glitch may be.

    Raises:
        InputError: so it is, as of a deflection in µm; names the curve.
    """
    aperture = curve.setup.aperture_mm
    if len(curve) and np.quantile(np.abs(curve.deflection_mm), SUCTION.high) > aperture:
        raise InputError(
            f"{curve.name}: deflection_mm goes to {np.abs(curve.deflection_mm).max():g} under an "
            f"opening of {aperture:g} mm; expected less (is its unit right?)"
        )


def check_outward(curve: Curve) -> None:
    """Refuse a curve whose dome is recorded as going down; a zero may be off, and drift.

    Raises:
        InputError: under much suction the deflections are below those under little; names it.
    """
    top = np.quantile(curve.pressure_mbar, SUCTION.high) if len(curve) else 0.0
    if top <= SUCTION.about_zero_mbar:
        return
    much = curve.deflection_mm[curve.pressure_mbar >= (1.0 - SUCTION.little) * top]
    little = curve.deflection_mm[curve.pressure_mbar <= SUCTION.little * top]
    if min(len(much), len(little)) < SUCTION.fewest_below:
        return
    falls_mm = float(np.median(little) - np.median(much))
    if falls_mm > SUCTION.inward_mm:
        raise InputError(
            f"{curve.name}: deflection_mm falls by {falls_mm:.2g} under suction; expected a dome, "
            "which is positive: change its sign, or let `skinlab import --deflection-sign -` do so"
        )


def check_dome(curve: Curve) -> None:
    """Refuse a curve whose deflection is the same all the time, however the suction changes.

    Raises:
        InputError: so it is, as of a sensor that is dead; names the curve.
    """
    if not len(curve) or np.ptp(curve.deflection_mm) > 0.0:
        return
    if np.ptp(curve.pressure_mbar) <= 2.0 * SUCTION.about_zero_mbar:
        return
    raise InputError(
        f"{curve.name}: the deflection is {curve.deflection_mm[0]:g} mm at every suction; expected "
        "a dome"
    )
