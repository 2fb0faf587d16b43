"""What a sound measurement may look like: tolerances, and the least that skin moves."""

from __future__ import annotations

import numpy as np

from skinlab.curves.compliance import small_load_compliance
from skinlab.curves.curve import Setup
from skinlab.quality.gates.base import Array, CurveSoFar
from skinlab.quality.settings import ASKED, SKIN

_MPA = 1e-4  # of a mbar


def tolerance_mbar(asked_mbar: Array) -> Array:
    """Return how far (n,) a pressure may be from what was asked for (n,)."""
    return np.maximum(ASKED.off_mbar, ASKED.off_part * asked_mbar)


def least_deflection_mm(setup: Setup, change_mbar: float) -> float:
    """Return what even a very stiff skin moves when the pressure changes so much.

    w/R = c(h/R) p/X1 for small loads.
    """
    radius = setup.aperture_mm / 2
    compliance = float(small_load_compliance(setup.thickness_mm / radius))
    rise = compliance * max(change_mbar, 0.0) * _MPA / SKIN.stiffest_X1_MPa
    return radius * min(rise, SKIN.small)


def open_chamber(view: CurveSoFar) -> bool:
    """Whether there is hardly any suction where some is asked for: the probe is in the air."""
    band = view.asked_mbar
    if band is None:
        return False
    some = band[0] >= ASKED.least_asked_mbar
    return (
        bool(some.any())
        and float(np.median(view.pressure_mbar[some] / band[0][some])) <= ASKED.some_suction
    )
