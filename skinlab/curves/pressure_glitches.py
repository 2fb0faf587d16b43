"""Readings of the pressure that the suction cannot have come to: a glitch of the channel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.curves.lone_readings import least_alone_mbar, lone_readings
from skinlab.curves.pressure_path import PressurePath

Mask = NDArray[np.bool_]


def pressure_glitches(curve: Curve, noise_mbar: float) -> Mask:
    """Return which samples (n,) have a pressure that is none: one alone, or two in a row.

    What a program asks for is none. `noise_mbar` is the standard deviation of the channel. As a
    deflection such a sample is off by dw/dp times as much, which may pass for a placement.
    """
    time, p = curve.time_s, curve.pressure_mbar
    found = lone_readings(time, p, noise_mbar)
    program = curve.program_as_run
    if found.any() and program is not None:
        asked = PressurePath.of_program(program)(time - time[0])
        found &= np.abs(p - asked) > least_alone_mbar(p, noise_mbar)
    return found
