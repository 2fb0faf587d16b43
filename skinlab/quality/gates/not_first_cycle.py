"""A later loading of the same site: softer than its first, which is what the elastic law means."""

from __future__ import annotations

from skinlab.quality.gates.base import CurveSoFar, Finding, Gate


def _check(view: CurveSoFar) -> Finding | None:
    if view.setup.cycle == 1:
        return None
    return Finding(
        GATE.name,
        f"this is loading {view.setup.cycle} of the site; skin is softer from the second on "
        "(Abbas 2021), and the law describes the first",
        "let the site rest, or measure another one, and state cycle 1",
    )


GATE = Gate(
    "not_first_cycle",
    _check,
    meaning="the site was loaded before",
    threshold="the elastic law describes first loadings",
)
