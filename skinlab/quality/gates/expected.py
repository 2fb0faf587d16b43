"""What a sound measurement may look like: tolerances, and the least that skin moves."""

from __future__ import annotations

import numpy as np

from skinlab.curves.curve import Setup
from skinlab.quality.gates.base import Array, CurveSoFar

# 15 standard deviations of a pressure sensor (0.2 mbar); tighter than what makes the driver vent
# (10 mbar or 5 %).
TOLERANCE_MBAR = 3.0
TOLERANCE_PART = 0.03
SHORTEST_S = 0.3  # a shorter deviation is a hiccup ...
FEWEST_SAMPLES = 3  # ... and fewer samples are noise

LEAST_ASKED_MBAR = 10.0  # below, a leak cannot be told from the pump's start
SOME_SUCTION = 0.2  # of what is asked; with less the probe is in the air, with more it leaks

# Three times the stiffest skin of the paper's database (X1 of 0.1 MPa).
_STIFFEST_X1_MPA = 0.3
_SMALL = 0.1  # w/R; higher domes rise more slowly
_MPA = 1e-4  # of a mbar


def tolerance_mbar(asked_mbar: Array) -> Array:
    """Return how far (n,) a pressure may be from what was asked for (n,)."""
    return np.maximum(TOLERANCE_MBAR, TOLERANCE_PART * asked_mbar)


def least_deflection_mm(setup: Setup, change_mbar: float) -> float:
    """Return what even a very stiff skin moves when the pressure changes so much.

    w/R = c(h/R) p/X1 for small loads, with c fitted to finite elements (docs/files.md).
    """
    radius = setup.aperture_mm / 2
    t = setup.thickness_mm / radius
    compliance = 0.0246 / t**3 + 0.0803 / t**2 - 0.0072 / t + 0.182
    return radius * min(compliance * max(change_mbar, 0.0) * _MPA / _STIFFEST_X1_MPA, _SMALL)


def open_chamber(view: CurveSoFar) -> bool:
    """Whether there is hardly any suction where some is asked for: the probe is in the air."""
    band = view.asked_mbar
    if band is None:
        return False
    some = band[0] >= LEAST_ASKED_MBAR
    return (
        bool(some.any())
        and float(np.median(view.pressure_mbar[some] / band[0][some])) <= SOME_SUCTION
    )
