"""The pressure that a skin has felt over time: straight pieces between knots."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinlab.curves.program import Program
from skinlab.errors import InputError

Array = NDArray[np.float64]

# Times after each corner, of a lag: between them a chord of exp(−t) is off by 0.35 % at most, by as
# much in each but the last.
_PIECES = (*(-2.0 * math.log(1.0 - k / 12.0) for k in range(1, 12)), 7.5)
# A rise "at once" takes tens of ms. What is behind it by more than that bends within it, by a share
# of what it would rise in a time constant, and is cut evenly.
_EVENLY = tuple(k / 12.0 for k in range(1, 13))
_RISE_MBAR = 20.0


@dataclass(frozen=True)
class PressurePath:
    """Knots (k,) in order of time; two at the same time are a jump. Hashable: a key of caches.

    Raises:
        InputError: fewer than two knots, or time runs backwards, or a value is not finite.
    """

    time_s: tuple[float, ...]
    pressure_mbar: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check once."""
        if len(self.time_s) < 2 or len(self.time_s) != len(self.pressure_mbar):
            raise InputError("a pressure path needs two knots or more, each a time and a pressure")
        time_s, pressure_mbar = self._knots
        if not (np.isfinite(time_s).all() and np.isfinite(pressure_mbar).all()):
            raise InputError("a pressure path needs finite times and pressures")
        if np.any(np.diff(time_s) < 0):
            raise InputError("a pressure path needs knots in order of time")

    @cached_property
    def _knots(self) -> tuple[Array, Array]:
        return np.array(self.time_s, dtype=float), np.array(self.pressure_mbar, dtype=float)

    @cached_property
    def pieces(self) -> tuple[Array, Array, Array, Array]:
        """Times of the knots (k,), s; lengths, slopes (mbar/s) and jumps (mbar) after them."""
        t, p = self._knots
        length, rise = np.diff(t), np.diff(p)
        slope = np.divide(rise, length, out=np.zeros_like(rise), where=length > 0)
        return t, length, slope, np.where(length > 0, 0.0, rise)

    @cached_property
    def rise_s(self) -> float:
        """Time from the beginning to the highest pressure, a millisecond at least."""
        t, p = self._knots
        return float(max(t[np.argmax(p)] - t[0], 1e-3))

    @cached_property
    def top_mbar(self) -> float:
        """Highest pressure, or zero."""
        return max(0.0, *self.pressure_mbar)

    def __call__(self, time_s: ArrayLike) -> Array:
        """Return the pressure (mbar) at these times; before and after, that of the ends."""
        t = np.asarray(time_s, dtype=float)
        return np.asarray(np.interp(t, *self._knots))

    def late_by(self, lag_s: float) -> PressurePath:
        """Return what follows this pressure by a lag of the first order.

        In closed form, piece by piece: p_felt = p − lag s + (…) exp(−t/lag).
        """
        if lag_s <= 0.0:
            return self
        t, length, slope, _ = self.pieces
        length, slope = np.append(length, _PIECES[-1] * lag_s), np.append(slope, 0.0)
        settled = self._knots[1] - lag_s * slope
        left = np.exp(-length / lag_s)
        rows = zip(settled.tolist(), (slope * length).tolist(), left.tolist(), strict=True)
        at = [self.pressure_mbar[0]]
        for whole, more, share in rows:
            at.append(whole + more + (at[-1] - whole) * share)
        begin = np.array(at[:-1])
        # Of each piece its corners, and its end; a jump has neither.
        each = np.outer(np.ones(len(length)), lag_s * np.array(_PIECES))
        short = (length < lag_s) & (np.abs(slope * length) > _RISE_MBAR)
        each[short] = np.outer(length[short], _EVENLY)
        since = np.minimum(np.column_stack([each, np.full(len(length), math.inf)]), length[:, None])
        kept = since < length[:, None]
        kept[:, -1] = length > 0.0
        whole, off = settled[:, None], (begin - settled)[:, None]
        value = whole + slope[:, None] * since + off * np.exp(-since / lag_s)
        times = np.append(t[0], (t[:, None] + since)[kept])
        return PressurePath(tuple(times.tolist()), (at[0], *value[kept].tolist()))

    @classmethod
    def of_program(cls, program: Program) -> PressurePath:
        """Return the path that a program asks for, from time 0."""
        return cls(*_without_repeats(*(np.array(x) for x in program.knots())))

    @classmethod
    def of_samples(cls, time_s: Array, pressure_mbar: Array, tolerance_mbar: float) -> PressurePath:
        """Return a path with few knots that stays within the tolerance of samples (n,).

        Ramer, Douglas and Peucker: the straight line is cut where it is furthest off, until it is
        nowhere off by more. A path with few corners is quick to step along, and a tolerance of four
        standard deviations of the noise keeps noise from becoming corners.

        Raises:
            InputError: fewer than two samples, or time runs backwards, or a value is not finite.
        """
        whole = cls(tuple(map(float, time_s)), tuple(map(float, pressure_mbar)))
        if not tolerance_mbar > 0:
            raise InputError(f"tolerance_mbar {tolerance_mbar:g}: expected a positive number")
        t, p = np.array(whole.time_s), np.array(whole.pressure_mbar)
        kept, open_ = {0, len(t) - 1}, [(0, len(t) - 1)]
        while open_:
            a, b = open_.pop()
            if b - a < 2:
                continue
            line = np.interp(t[a + 1 : b], t[[a, b]], p[[a, b]])
            off = np.abs(p[a + 1 : b] - line)
            k = a + 1 + int(off.argmax())
            if off.max() > tolerance_mbar:
                kept.add(k)
                open_ += [(a, k), (k, b)]
        chosen = sorted(kept)
        return cls(tuple(t[chosen].tolist()), tuple(p[chosen].tolist()))


def _without_repeats(t: Array, p: Array) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Drop knots that say nothing: the same twice."""
    new = np.concatenate([[True], (np.diff(t) != 0) | (np.diff(p) != 0)])
    return tuple(t[new].tolist()), tuple(p[new].tolist())
