"""The openings that probes have."""

from __future__ import annotations

from skinlab.errors import InputError

APERTURES_MM = (2.0, 4.0, 6.0, 8.0)  # diameters


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
