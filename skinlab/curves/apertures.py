"""The openings that probes have."""

from __future__ import annotations

from drivers.capabilities import APERTURES_MM
from skinlab.errors import InputError


def check_aperture(aperture_mm: float) -> float:
    """Return the aperture where a probe has it.

    Raises:
        InputError: no probe has it.
    """
    if aperture_mm not in APERTURES_MM:
        known = ", ".join(f"{a:g}" for a in APERTURES_MM)
        raise InputError(
            f"aperture_mm {aperture_mm:g}: no probe has this opening; expected one of {known} "
            "(the diameter)"
        )
    return float(aperture_mm)


__all__ = ["APERTURES_MM", "check_aperture"]
