"""Find the quality gates: every module of this folder that defines GATE."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import skinlab.quality.gates as package
from skinlab.curves.curve import Curve
from skinlab.plugins import find
from skinlab.quality.gates.base import Finding, Gate, whole


@cache
def all_gates() -> tuple[Gate, ...]:
    """Return all gates, sorted by name."""
    return tuple(sorted(find(package, "GATE"), key=lambda gate: gate.name))


def check_curve(curve: Curve, earlier: Sequence[Curve] = ()) -> tuple[Finding, ...]:
    """Return what the gates find about a whole curve, however it was come by."""
    view = whole(curve, tuple(earlier))
    return tuple(f for gate in all_gates() if (f := gate.check(view)) is not None)
