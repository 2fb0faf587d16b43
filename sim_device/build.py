"""A simulated probe from what a user can say about it; shared by `sim://` and `python -m`."""

from __future__ import annotations

import math
from pathlib import Path

from drivers.capabilities import APERTURES_MM
from sim_device.device import Device, Trace
from sim_device.faults import load_fault_file
from sim_device.files import SkinFile, load_skin_file

MAX_SPEED = 200.0  # beyond, the simulation could not keep up with itself


def build_device(
    skin_file: str | Path | None,
    *,
    seed: int,
    speed: float,
    aperture_mm: float,
    faults_file: str | Path | None = None,
    phantom: str | None = None,
    trace: Trace | None = None,
) -> Device:
    """Build a probe on the skin of `skin_file` (None: the default skin).

    phantom: of the kit, and not the skin, is under the probe.
    speed: seconds of the device in one of the host.
    trace: see Device.
    Raises ValueError, one sentence, for what is out of range or wrong in a file.
    """
    if not (math.isfinite(speed) and 1 <= speed <= MAX_SPEED):
        raise ValueError(f"speed must be 1 to {MAX_SPEED:g}, not {speed:g}")
    if aperture_mm not in APERTURES_MM:
        known = ", ".join(f"{aperture:g}" for aperture in APERTURES_MM)
        raise ValueError(f"aperture_mm must be one of {known}, not {aperture_mm:g}")
    if seed < 0:
        raise ValueError(f"seed must not be negative, not {seed}")
    faults = () if faults_file is None else load_fault_file(faults_file)
    description = SkinFile() if skin_file is None else load_skin_file(skin_file)
    # Not at the top: the finite elements behind it are slow to import
    from sim_device.skin import make_phantom, make_skin

    try:
        if phantom is None:
            skin = make_skin(description.skin, description.effects, description.probe)
        else:
            skin = make_phantom(phantom, seed, description.probe)
    except ValueError as error:
        raise ValueError(
            f"{skin_file or 'default skin' if phantom is None else 'phantom'}: {error}"
        ) from error
    return Device(
        skin,
        description.sensor,
        aperture_mm=aperture_mm,
        seed=seed,
        speed=speed,
        faults=faults,
        probe=description.probe,
        beside=True,
        trace=trace,
    )
