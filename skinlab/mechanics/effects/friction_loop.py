"""A difference between loading and unloading that no rate changes: dry friction."""

from __future__ import annotations

from dataclasses import replace

from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.effects.base import Effect, Parameter, Values

_ROUNDING = 1e-9  # of a piece: what is met so near its end is met at the end


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
    form_of = "history"
    order = 2
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
        less, more = 1.0 - share, 1.0 + share
        t0, p0 = path.time_s[0], path.pressure_mbar[0]
        at = less * p0
        knots = [(t0, at)]
        for t, p in zip(path.time_s[1:], path.pressure_mbar[1:], strict=True):
            if t > t0 and p != p0:
                # It stays until it meets a bound, and follows that; bounds bend at zero.
                meets = at / (less if (p > p0) == (at >= 0.0) else more)
                for way in sorted({(corner - p0) / (p - p0) for corner in (meets, 0.0)}):
                    if _ROUNDING < way < 1.0 - _ROUNDING:
                        at = _clipped(at, p0 + way * (p - p0), share)
                        knots.append((t0 + way * (t - t0), at))
            at = _clipped(at, p, share)
            knots.append((t, at))
            t0, p0 = t, p
        # On the way up it feels the suction itself: the law's stiffness is that of loading.
        return replace(
            path,
            time_s=tuple(t for t, _ in knots),
            pressure_mbar=tuple(v / less for _, v in knots),
        )


def _clipped(at_mbar: float, pressure_mbar: float, share: float) -> float:
    """Return a suction, moved as far as it has to be."""
    play = share * abs(pressure_mbar)
    return min(max(at_mbar, pressure_mbar - play), pressure_mbar + play)


EFFECT = FrictionLoop()
