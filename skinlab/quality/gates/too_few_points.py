"""The loading has too few samples for three parameters."""

from __future__ import annotations

import numpy as np

from skinlab.quality.gates.base import CurveSoFar, Finding, Gate
from skinlab.quality.settings import TIMES


def _check(view: CurveSoFar) -> Finding | None:
    points = _points(view)
    if points is None or points >= TIMES.fewest:
        return None
    says = "has" if view.complete else "will have"
    samples = "1 sample" if points == 1 else f"{points} samples"
    return Finding(
        GATE.name,
        f"the first loading {says} {samples}; {TIMES.fewest} are the fewest for three parameters",
        "use a slower ramp or a higher sample rate, unless `discrepancy` advised this program",
    )


def _points(view: CurveSoFar) -> int | None:
    """Return the samples of the first loading; None where they cannot be known yet."""
    program = view.setup.program
    if view.complete:
        if program is None or view.segment is None:
            return len(view.time_s)
        return int(np.isin(view.segment, program.first_load).sum())
    if program is None or not view.rate_hz:
        return None
    bounds = program.boundaries_s()
    loading_s = sum(float(bounds[k + 1] - bounds[k]) for k in program.first_load)
    return int(loading_s * view.rate_hz + 1e-6) + 1


GATE = Gate(
    "too_few_points",
    _check,
    meaning="the first loading has few samples",
    threshold=f"{TIMES.fewest}; the paper has 51, and intervals widen as the square root. "
    "Known before the first sample, from program and rate",
)
