"""Learned effects: a smooth unknown function in place of a formula, for what the library lacks.

A family says where such a function may act (on the sensor, the suction, in time, ...). Its function
is a sum of fixed shapes whose coefficients are the effect's parameters: independent before the
data, with standard deviations that fall off with the roughness of the shape, so that the function
is smooth beforehand (the Karhunen-Loeve form of a Gaussian process: Rasmussen and Williams 2006,
4.3). How large it may be is learned by whoever fits it (`skinlab.discrepancy.families`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.effects.base import Array, Effect, Parameter, Values

PRIOR_SIZES = 3.0  # a prior's standard deviation, in typical sizes: that of every effect
_SOURCE = "a smooth function of unknown form; its size is learned from the data"
_EVEN_MBAR = 20.0
_PIECES = 60  # of the highest suction: how finely a path is cut before it is bent


@dataclass(frozen=True, eq=False)
class Seen:
    """What the curves of a campaign reach: a function is learned, and drawn, no further.

    `left` is what the model leaves of each curve: times (n,) and deflections (n,), mm; `model_mm`
    its own deflections (n,) there.
    """

    height_mm: float
    pressure_mbar: float
    time_s: float
    cycle: int
    apertures_mm: tuple[float, ...]
    left: tuple[tuple[Array, Array], ...] = ()
    model_mm: tuple[Array, ...] = ()


def coefficients(count: int, unit: str, most: float, typical: float) -> tuple[Parameter, ...]:
    """Return the coefficients of `sines`; `most` bounds them, `typical` is that of the first."""
    stem = {"µm": "_um"}.get(unit, f"_{unit}" if unit else "")
    return tuple(
        Parameter(
            f"c{k}{stem}", unit, f"of its shape number {k}", -most, most, 0.0,
            typical * roughness(k), _SOURCE,
        )
        for k in range(1, count + 1)
    )  # fmt: skip


def nearly_line(
    unit: str, most: float, typical: float, bent: float, count: int = 4
) -> tuple[Parameter, ...]:
    """Return the coefficients of `line_and_sines`; `bent` is how large the others are beside it."""
    first, *others = coefficients(count, unit, most, typical)
    return first, *(replace(p, typical=bent * p.typical) for p in others)


def roughness(k: int) -> float:
    """Return the standard deviation of coefficient k, in that of the first.

    As of a squared exponential: alike up to about the third shape, so that a bump needs no steep
    line below it.
    """
    return float(np.exp(-0.5 * ((k - 1.0) / 3.0) ** 2))


def span(name: str, unit: str, meaning: str, low: float, high: float, typical: float) -> Parameter:
    """Return the length of the function's range: fixed by who learns it, not an unknown."""
    return Parameter(name, unit, meaning, low, high, None, typical, _SOURCE, "log", default=typical)


def sines(at: Array, values: Values, names: tuple[str, ...]) -> Array:
    """Return the sum of the shapes (n,) at shares (n,) of the range: 0 at 0, level beyond 1.

    Those of a Wiener process on [0, 1] (Karhunen and Loeve): sin((k − 1/2) π x).
    """
    x = np.clip(at, -1.0, 1.0)
    return np.asarray(
        sum(values[n] * np.sin((k - 0.5) * np.pi * x) for k, n in enumerate(names, start=1))
    )


def line_and_sines(even: Array, at: Array, values: Values, names: tuple[str, ...]) -> Array:
    """Return a line along shares `even` (n,) of the range, and `sines` along shares `at` (n,)."""
    first, *others = names
    return np.asarray(values[first] * np.clip(even, -1.0, 1.0) + sines(at, values, tuple(others)))


def harmonics(angle: Array, values: Values, count: int) -> Array:
    """Return the sum (n,) of `count` sines and cosines of multiples of angles (n,), µm."""
    found = np.zeros_like(angle)
    for k in range(1, count + 1):
        found += values[f"s{k}_um"] * np.sin(k * angle) + values[f"c{k}_um"] * np.cos(k * angle)
    return found


def suction_share(pressure_mbar: Array, span_mbar: float) -> Array:
    """Return shares (n,) of a range of suctions, of which openings differ in theirs.

    Evenly up to 20 mbar, beyond in the logarithm.
    """
    return np.asarray(np.arcsinh(pressure_mbar / _EVEN_MBAR) / np.arcsinh(span_mbar / _EVEN_MBAR))


def bent(path: PressurePath, more: Callable[[Array], Array]) -> PressurePath:
    """Return the path with `more` added to its pressures, of which it is a smooth function."""
    step = max(path.top_mbar, 1.0) / _PIECES
    t, p = _cut(path, np.abs(np.diff(path.pressure_mbar)) / step)
    return replace(path, time_s=tuple(t.tolist()), pressure_mbar=tuple((p + more(p)).tolist()))


def drifted(path: PressurePath, more: Callable[[Array], Array]) -> PressurePath:
    """Return the path with `more` added, a smooth function of the time since it begins."""
    lasts = np.diff(path.time_s)
    t, p = _cut(path, lasts / max(lasts.sum() / _PIECES, 1e-9))
    more_mbar = more(t - t[0])
    return replace(path, time_s=tuple(t.tolist()), pressure_mbar=tuple((p + more_mbar).tolist()))


def _cut(path: PressurePath, steps: Array) -> tuple[Array, Array]:
    """Return knots (k,) of the path with each piece cut into so many `steps`; jumps stay whole."""
    t, p = np.array(path.time_s), np.array(path.pressure_mbar)
    lasts, rise = np.diff(t), np.diff(p)
    pieces = np.where(lasts == 0, 1, np.maximum(1, np.ceil(steps).astype(int)))
    at = np.repeat(np.arange(len(pieces)), pieces)
    share = (np.arange(1, len(at) + 1) - (np.cumsum(pieces) - pieces)[at]) / pieces[at]
    return (
        np.append(t[:1], t[at] + share * lasts[at]),
        np.append(p[:1], p[at] + share * rise[at]),
    )


def less_gain(x: Array, y: Array) -> Array:
    """Return functions (..., m) less a part in proportion to x: a stiffer skin does the same."""
    return np.asarray(y - (y @ x / (x @ x))[..., None] * x)


class LearnedEffect(Effect, ABC):
    """A family of smooth unknown functions; its coefficients are the parameters with a zero."""

    family: ClassVar[str]
    x_name: ClassVar[str]  # of the function, with its unit
    y_name: ClassVar[str]
    range_name: ClassVar[str] = ""  # the parameter that is the length of the function's range
    own_of_each: ClassVar[bool] = False  # of each curve anew: what it does, no other curve tells

    @property
    def names(self) -> tuple[str, ...]:
        """The coefficients."""
        return tuple(p.name for p in self.parameters if p.zero is not None)

    def range_of(self, seen: Seen) -> float:
        """Return the length of the function's range for these curves."""
        return 1.0

    @abstractmethod
    def abscissa(self, seen: Seen) -> Array:
        """Return where the function is drawn (m,)."""

    @abstractmethod
    def function(self, at: Array, values: Values) -> Array:
        """Return the function (m,)."""

    def shown(self, x: Array, y: Array) -> Array:
        """Return what is drawn of functions (..., m): less what no curve can tell."""
        return y

    @abstractmethod
    def sentence(self, x: Array, y: Array) -> str:
        """Return what the function (m,) says, after "something that"."""
