"""Samples were sent and did not arrive: their counter has gaps."""

from __future__ import annotations

from skinlab.quality.gates.base import CurveSoFar, Finding, Gate


def _check(view: CurveSoFar) -> Finding | None:
    if view.lost_samples <= 0:
        return None
    total = len(view.time_s) + view.lost_samples
    so_far = "" if view.complete else " so far"
    return Finding(
        GATE.name,
        f"{view.lost_samples} of {total} samples{so_far} did not arrive",
        "look at plug, cable and other devices nearby; a few lost samples do no harm to a fit",
    )


GATE = Gate(
    "lost_frames",
    _check,
    meaning="the counter of samples has gaps",
    threshold="any",
)
