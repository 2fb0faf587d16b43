"""A repeat that is not like the others: the probe has moved, or the skin has changed."""

from __future__ import annotations

import numpy as np

from skinlab.curves.curve import Curve
from skinlab.curves.lone_readings import white_noise
from skinlab.quality.gates.base import CurveSoFar, Finding, Gate
from skinlab.quality.settings import REPEATS


def _check(view: CurveSoFar) -> Finding | None:
    others = [c for c in view.earlier if _comparable(c, view)]
    program = view.setup.program
    if not others or program is None:
        return None
    t, w = view.time_s, view.deflection_mm
    if not view.complete:
        first = max(0, len(t) - 5 * REPEATS.fewest)
        t, w = t[first:], w[first:]
    # Where all of them were measured, and there is a dome to compare.
    end_s = min(float(c.time_s[-1]) for c in others)
    reference = np.median([np.interp(t, c.time_s, c.deflection_mm) for c in others], axis=0)
    pressure = np.interp(t, others[0].time_s, others[0].pressure_mbar)
    use = (t <= end_s) & (pressure >= REPEATS.least_part * program.max_pressure_mbar)
    if int(use.sum()) < REPEATS.fewest:
        return None
    difference = w[use] - reference[use]
    part = float(np.sqrt(np.mean(difference**2) / np.mean(reference[use] ** 2)))
    noise = white_noise(w[use]) / float(np.sqrt(np.mean(reference[use] ** 2)))
    if part <= REPEATS.part + REPEATS.sigmas * noise:
        return None
    names = ", ".join(c.name for c in others)
    way = "more" if difference.mean() > 0 else "less"
    return Finding(
        GATE.name,
        f"the skin moves {100 * part:.0f} % {way} than in {names}",
        "see whether the probe or the tape has moved, let the site rest, and repeat",
    )


def _comparable(other: Curve, view: CurveSoFar) -> bool:
    """Whether it should be alike: the same setup; first and later loadings are apart."""
    a, b = other.setup, view.setup
    same = (a.aperture_mm, a.thickness_mm, a.program) == (b.aperture_mm, b.thickness_mm, b.program)
    return same and (a.cycle == 1) == (b.cycle == 1) and not other.partial and len(other) > 1


GATE = Gate(
    "repeat_differs",
    _check,
    meaning="the dome is another one than in the repeats before it",
    threshold=f"{100 * REPEATS.part:g} % of the deflection (and {REPEATS.sigmas:g} standard "
    "deviations of its noise), where the pressure is above a fifth of its highest. First and "
    "later loadings are compared apart",
)
