"""A difference between loading and unloading that no rate changes: dry friction."""

from __future__ import annotations

from dataclasses import replace

from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.effects.base import Effect, Parameter, Values

_PIECES = 12  # of a way back, where the suction that is felt turns


class FrictionLoop(Effect):
    """See the module."""

    name = "friction_loop"
    meaning = "dry friction: unloading lags behind loading, at any rate alike"
    formula = (
        "the suction felt stays between p (1 − share) and p (1 + share), and moves "
        "only where it has to, over its value on the way up"
    )
    source = "play operator: Visintin 1994, Differential Models of Hysteresis, III.2"
    physical = True
    order = 2
    needs_history = True
    parameters = (
        Parameter(
            "share", "", "half the width of the loop, a share of the suction", 0.0, 0.5, 0.0,
            0.05, "no published size: a range to look in",
        ),
    )  # fmt: skip

    def felt(self, path: PressurePath, values: Values) -> PressurePath:
        """Let the suction follow with a play in proportion to it."""
        share = values["share"]
        if share <= 0.0:
            return path
        times, pressures = path.time_s, path.pressure_mbar
        at, found = (1.0 - share) * pressures[0], []
        previous = (times[0], pressures[0])
        for t, p in zip(times, pressures, strict=True):
            t0, p0 = previous
            for k in range(1, _PIECES + 1) if t > t0 else (_PIECES,):
                here = p0 + (p - p0) * k / _PIECES
                low, high = sorted(((1.0 - share) * here, (1.0 + share) * here))
                at = min(max(at, low), high)
                # On the way up it feels the suction itself: the law's stiffness is that of loading.
                found.append((t0 + (t - t0) * k / _PIECES, at / (1.0 - share)))
            previous = (t, p)
        return replace(
            path, time_s=tuple(t for t, _ in found), pressure_mbar=tuple(v for _, v in found)
        )


EFFECT = FrictionLoop()
