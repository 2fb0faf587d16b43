"""Whether curves that count as independent are: each of them once, by a name of its own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import count

from skinlab.curves.curve import Curve
from skinlab.errors import InputError


def check_distinct(curves: Sequence[Curve]) -> None:
    """Refuse curves that have the same readings as another one.

    Raises:
        InputError: one of them is there twice; names it.
    """
    seen: dict[tuple[object, ...], str] = {}
    for curve in curves:
        columns = (curve.time_s, curve.pressure_mbar, curve.deflection_mm)
        bits = tuple(column.tobytes() for column in columns)
        # Repeats of a simulated probe without noise are alike, and none the less two.
        repeat = None if curve.segment is None else (curve.setup.cycle, curve.setup.repeat)
        keys: list[tuple[object, ...]] = [(*bits, repeat)]
        if curve.source is not None:  # but not of one file
            keys.append((*bits, curve.source, curve.name))
        known = next((seen[key] for key in keys if key in seen), None)
        if known is not None:
            other = "twice" if known == curve.name else f"also as {known}"
            raise InputError(
                f"{curve.name}: the same readings are given {other}; expected each curve once, "
                "as each counts as data of its own"
            )
        seen |= dict.fromkeys(keys, curve.name)


def named_apart(curves: Sequence[Curve]) -> tuple[Curve, ...]:
    """Return the curves, each with a name of its own: what is said of one goes by it.

    Of several sessions they are called by their file as well; else a number follows.
    """
    given = Counter(curve.name for curve in curves)
    names = [
        f"{c.campaign}:{c.name}" if given[c.name] > 1 and c.campaign is not None else c.name
        for c in curves
    ]
    found: list[Curve] = []
    taken: set[str] = set()
    for curve, name in zip(curves, names, strict=True):
        numbered = (f"{name} ({k})" for k in count(2))
        own = name if name not in taken else next(n for n in numbered if n not in {*taken, *names})
        taken.add(own)
        found.append(curve if own == curve.name else replace(curve, name=own))
    return tuple(found)
