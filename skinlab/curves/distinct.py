"""Whether curves that count as independent are: each of them once."""

from __future__ import annotations

from collections.abc import Sequence

from skinlab.curves.curve import Curve
from skinlab.errors import InputError


def check_distinct(curves: Sequence[Curve]) -> None:
    """Refuse curves that have the same readings as another one.

    Raises:
        InputError: one of them is there twice; names it.
    """
    seen: dict[tuple[object, ...], str] = {}
    for curve in curves:
        readings = (curve.time_s, curve.pressure_mbar, curve.deflection_mm)
        # Repeats of a simulated probe without noise are alike, and none the less two.
        repeat = None if curve.segment is None else (curve.setup.cycle, curve.setup.repeat)
        key = (*(column.tobytes() for column in readings), repeat)
        if key in seen:
            other = "twice" if seen[key] == curve.name else f"also as {seen[key]}"
            raise InputError(
                f"{curve.name}: the same readings are given {other}; expected each curve once, "
                "as each counts as data of its own"
            )
        seen[key] = curve.name
