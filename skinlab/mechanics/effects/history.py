"""Whether what an effect does depends on more than the suction: on time, rate, way or cycle."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.mechanics.effects.base import Effect, Values
from skinlab.mechanics.fem.skin import Skin, SkinProblem
from skinlab.mechanics.fem.suction import Geometry

Array = NDArray[np.float64]

# Up slowly, a hold, down fast, a rest, up faster; and another program to the same top.
_PROGRAMS = ("ramp:100@5,hold:3,ramp:0@40,hold:2,ramp:100@20", "ramp:100@2,ramp:0@7")
_MBAR = np.linspace(1.0, 99.0, 50)
_SAME = 1e-9  # of the largest; what is computed in another order differs by less
_CYCLES = (2, 3, 100)
_PROBLEM = SkinProblem(Geometry(6.0, 1.0), Skin((0.03, 1.5, 0.3)))


@lru_cache(maxsize=256)
def depends_on_history(effect: Effect) -> bool:
    """Return whether an effect depends on more than the suction, in what it says or when tried.

    One that says no is tried: the same suction at other times, rates, ways and cycles.
    """
    return effect.needs_history or shows_history(effect)


def shows_history(effect: Effect) -> bool:
    """Return whether a trial shows that it depends on more than the suction."""
    try:
        return any(_shows(effect, values) for values in _sizes(effect))
    except Exception:  # noqa: BLE001 -- what breaks here breaks at work, which names it
        return True


def _sizes(effect: Effect) -> list[Values]:
    typical = effect.typical
    more = {p.name: 0.5 * (p.typical + p.high) for p in effect.parameters}
    less = {p.name: 0.5 * (p.typical + p.low) for p in effect.parameters}
    return [typical, more, less]


def _shows(effect: Effect, values: Values) -> bool:
    first = effect.change(_PROBLEM, values, 1)
    if first.prony or any(effect.change(_PROBLEM, values, n) != first for n in _CYCLES):
        return True
    found = [row for text in _PROGRAMS for row in _by_pressure(effect, values, text)]
    seen = np.stack(found)  # (branches, 3, pressures)
    off = np.abs(seen - seen[0]).max(axis=(0, 2))
    return bool((off > _SAME * np.abs(seen).max(axis=(0, 2))).any())


def _by_pressure(effect: Effect, values: Values, text: str) -> list[Array]:
    """Return what it does (3, pressures) on each branch of a program, by the suction there.

    The suction that is felt, that of the time which is recorded, and what is read.
    """
    path = PressurePath.of_program(parse_program(text))
    pieces = zip(pairwise(path.time_s), pairwise(path.pressure_mbar), strict=True)
    moving = [(t, p) for t, p in pieces if p[0] != p[1]]
    time_s = np.array([np.sort(np.interp(_MBAR, *_rising(p, t))) for t, p in moving]).ravel()
    pressure = path(time_s)
    deflection = 0.02 * pressure / (1.0 + 0.01 * pressure)
    does = np.array(
        [
            effect.felt(path, values)(time_s),
            path(effect.when(time_s, values)),
            effect.read_along(time_s, pressure, deflection, values),
        ]
    ).reshape(3, len(moving), len(_MBAR))
    falls = [p[0] > p[1] for _, p in moving]
    return [does[:, k, ::-1] if fall else does[:, k] for k, fall in enumerate(falls)]


def _rising(pressures: Sequence[float], times: Sequence[float]) -> tuple[Array, Array]:
    order = np.argsort(pressures)
    return np.array(pressures)[order], np.array(times)[order]
