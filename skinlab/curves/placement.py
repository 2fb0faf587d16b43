"""Which curves are of one placement: between two of them the probe was taken off."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

from skinlab.curves.curve import Curve, Setup


def placements_of(curves: Sequence[Curve]) -> list[int]:
    """Return the number of the placement that each curve belongs to.

    A curve says so, within its campaign; else each begins one, unless it is a later cycle of the
    one before, through the same opening.
    """
    placements: dict[Hashable, int] = {}
    found: list[int] = []
    begun: Hashable = None
    for number, curve in enumerate(curves):
        label = curve.setup.placement
        if label is not None:
            begun = (curve.campaign, label)
        elif number == 0 or begins_placement(curve.setup, curves[number - 1].setup):
            begun = number
        found.append(placements.setdefault(begun, len(placements)))
    return found


def begins_placement(here: Setup, before: Setup) -> bool:
    """Return whether a curve without a label is of another placement than the one before.

    Within one the cycles go up: of preconditioned skin all curves may be of a later cycle.
    """
    return here.cycle <= before.cycle or here.aperture_mm != before.aperture_mm
