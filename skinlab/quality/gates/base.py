"""What a gate sees, and what it says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve, Setup
from skinlab.plugins import needs, texts
from skinlab.quality.gates.asked import asked_band_mbar
from skinlab.quality.settings import TIMES

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Finding:
    """A gate that a curve failed: in one sentence, and what to do about it."""

    gate: str
    sentence: str
    advice: str

    def __str__(self) -> str:
        return f"{self.gate}: {self.sentence}; {self.advice}"


@dataclass(frozen=True, eq=False)
class CurveSoFar:
    """What is known of a curve: all of it, or what was measured until now.

    Arrays (n,) in time order, read only by agreement. `began_s` is the time of the first sample of
    each segment that was reached. `earlier` are the completed curves of the same session.
    """

    setup: Setup
    time_s: Array
    pressure_mbar: Array
    deflection_mm: Array
    segment: NDArray[np.intp] | None = None
    began_s: tuple[tuple[int, float], ...] = ()
    complete: bool = True
    cut: bool = False  # ended before its program did
    rate_hz: float | None = None  # None: unknown
    lost_samples: int = 0
    steps_back: int = 0  # how often the instrument's clock went back
    earlier: tuple[Curve, ...] = ()

    @property
    def interval_s(self) -> float:
        """Time between two samples, as asked for or else as seen; 0 where nobody knows."""
        if self.rate_hz:
            return 1.0 / self.rate_hz
        return float(np.median(np.diff(self.time_s))) if len(self.time_s) > 1 else 0.0

    @cached_property
    def asked_mbar(self) -> tuple[Array, Array, Array] | None:
        """Least, most, and most within a vent's time, asked for at about each sample, (n,) each.

        None where the program is unknown.
        """
        program = self.setup.program
        if program is None or not len(self.time_s):
            return None
        return asked_band_mbar(program, self.time_s, self.segment, self.began_s, self.interval_s)

    @cached_property
    def tail(self) -> CurveSoFar:
        """The last seconds of a growing curve, so that its length costs nothing.

        A complete one is returned whole.
        """
        if self.complete or not len(self.time_s):
            return self
        first = int(np.searchsorted(self.time_s, self.time_s[-1] - TIMES.tail_s))
        if first == 0:
            return self
        return replace(
            self,
            time_s=self.time_s[first:],
            pressure_mbar=self.pressure_mbar[first:],
            deflection_mm=self.deflection_mm[first:],
            segment=None if self.segment is None else self.segment[first:],
        )


@dataclass(frozen=True)
class Gate:
    """A named check, which raises nothing; `meaning` ends the sentence "it fails where …"."""

    name: str
    check: Callable[[CurveSoFar], Finding | None]
    meaning: str
    threshold: str  # the numbers that decide, and why these


def check_gate(one: object) -> None:
    """Check that an extension is a gate.

    Raises:
        TypeError: it is not.
    """
    needs(one, "check", "meaning", "threshold")
    if not isinstance(one, Gate):
        raise TypeError(f"it is a {type(one).__name__}; expected a skinlab.quality.gates.base.Gate")
    texts(one, "meaning", "threshold")
    if not callable(one.check):
        raise TypeError(f"its check is a {type(one.check).__name__}; expected a function")


def whole(curve: Curve, earlier: tuple[Curve, ...] = ()) -> CurveSoFar:
    """Return a completed curve as gates see it, where nothing but the curve is known."""
    return CurveSoFar(
        as_run(curve.setup, curve.segment, curve.pressure_mbar, whole=not curve.partial),
        curve.time_s,
        curve.pressure_mbar,
        curve.deflection_mm,
        curve.segment,
        beginnings(curve),
        cut=curve.partial,
        earlier=earlier,
    )


def as_run(
    setup: Setup, segment: NDArray[np.intp] | None, pressure_mbar: Array, *, whole: bool = False
) -> Setup:
    """Return the setup with what was reached so far in the place of heights."""
    program = setup.program
    if program is None or segment is None or not program.stops_at_heights:
        return setup
    return replace(setup, program=program.as_run(segment, pressure_mbar, whole=whole))


def beginnings(curve: Curve) -> tuple[tuple[int, float], ...]:
    """Return (segment, time of its first sample in s) for all that were reached."""
    if curve.segment is None or not len(curve):
        return ()
    first = np.flatnonzero(np.diff(curve.segment, prepend=-1))
    return tuple((int(curve.segment[i]), float(curve.time_s[i])) for i in first)


def longest_run(mask: NDArray[np.bool_], time_s: Array) -> tuple[int, int] | None:
    """Return (first, behind last) of the run of true values that lasts longest; None: none."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0))
    if not len(edges):
        return None
    begins, ends = edges[0::2], edges[1::2]
    k = int(np.argmax(time_s[ends - 1] - time_s[begins]))
    return int(begins[k]), int(ends[k])
