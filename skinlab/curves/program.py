"""What is asked of the pump: ramps, holds, releases and rests, as text and as objects.

Grammar: segments separated by commas. `ramp:P@RATE` goes to P mbar at RATE mbar/s, up or down;
`until:Hmm@RATE[,MAX]` rises at RATE until the deflection reads H mm, to MAX mbar (500) at most;
`hold:S` stays for S seconds; `release` vents as fast as the instrument can; `rest:S` waits at zero.
The classic modes are short names: `mode1:P,ON,OFF[,N]`, `mode2:P@RATE[,N]`, `mode3:P,ON@RATE[,N]`,
`mode4:P@RATE,OFF[,N]`. Every program ends with a vent, whether it says so or not.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.numbers import number_in
from skinlab.errors import InputError
from skinlab.text import did_you_mean

MOST_PRESSURE_MBAR = 500.0
MOST_SUCTION_S = 60.0
MOST_CYCLES = 100
STEEPEST_MBAR_PER_S = 1e5
SLOWEST_MBAR_PER_S = 0.01  # slower than any pump; finer than that, a wire may round to nothing
LEAST_PRESSURE_MBAR = 0.1
HIGHEST_MM = 8.0  # of the largest opening
STEP_RATE_MBAR_PER_S = 2000.0  # "at once" in modes 1 and 3: faster than the pump can follow

Phase = Literal["load", "hold", "unload", "rest"]


@dataclass(frozen=True, slots=True)
class Ramp:
    """Go to `target_mbar` at `rate_mbar_per_s`, up or down."""

    target_mbar: float
    rate_mbar_per_s: float

    def __str__(self) -> str:
        return f"ramp:{_text(self.target_mbar)}@{_text(self.rate_mbar_per_s)}"


@dataclass(frozen=True, slots=True)
class Until:
    """Rise at `rate_mbar_per_s` until the deflection reads `height_mm`, to `most_mbar` at most.

    What a program says of its pressures and times holds as if the height were never reached.
    """

    height_mm: float
    rate_mbar_per_s: float
    most_mbar: float = MOST_PRESSURE_MBAR

    def __str__(self) -> str:
        most = "" if self.most_mbar == MOST_PRESSURE_MBAR else f",{_text(self.most_mbar)}"
        return f"until:{_text(self.height_mm)}mm@{_text(self.rate_mbar_per_s)}{most}"


@dataclass(frozen=True, slots=True)
class Hold:
    """Stay at the present pressure."""

    duration_s: float

    def __str__(self) -> str:
        return f"hold:{_text(self.duration_s)}"


@dataclass(frozen=True, slots=True)
class Release:
    """Vent as fast as the instrument can."""

    def __str__(self) -> str:
        return "release"


@dataclass(frozen=True, slots=True)
class Rest:
    """Wait at zero."""

    duration_s: float

    def __str__(self) -> str:
        return f"rest:{_text(self.duration_s)}"


Segment = Ramp | Until | Hold | Release | Rest


@dataclass(frozen=True)
class Program:
    """A checked sequence of segments, bounded in pressure and time.

    Raises:
        InputError: empty, a pressure beyond 0–500 mbar, a rate or duration that is not positive,
            or more than 60 s of suction before it goes back to zero. What a probe may be asked for
            is less: `check_measurable`.
    """

    segments: tuple[Segment, ...]

    def __post_init__(self) -> None:
        """Refuse what no probe should do."""
        if not self.segments:
            raise InputError("program is empty; expected for example ramp:100@20")
        for segment in self.segments:
            _check(segment)
        if self._pulled_s() > MOST_SUCTION_S:
            raise InputError(
                f"program {self}: {self.longest_suction_s:g} s of suction without a pause; "
                f"expected at most {MOST_SUCTION_S:g} s"
            )
        if self.max_pressure_mbar <= 0:
            raise InputError(f"program {self}: never leaves zero; expected a ramp to a pressure")

    def __str__(self) -> str:
        return ",".join(str(s) for s in self.segments)

    def _ends(self) -> list[float]:
        """Pressure that each segment ends at, mbar."""
        ends, present = [], 0.0
        for segment in self.segments:
            if isinstance(segment, Ramp):
                present = segment.target_mbar
            elif isinstance(segment, Until):
                present = segment.most_mbar
            elif isinstance(segment, Release | Rest):
                present = 0.0
            ends.append(present)
        return ends

    def _starts(self) -> list[float]:
        return [0.0, *self._ends()[:-1]]

    @property
    def max_pressure_mbar(self) -> float:
        """Highest pressure asked for."""
        return max(self._ends())

    def _pulled_s(self) -> float:
        """Longest time from zero to the way back to it, which a curve may take its time for."""
        longest = suction_s = 0.0
        for segment, phase, start, end in zip(
            self.segments, self.phases, self._starts(), self._ends(), strict=True
        ):
            if end > 0 or start > 0:
                suction_s += _duration(segment, start)
            if phase == "rest" or end == 0:
                suction_s = 0.0
            longest = max(longest, suction_s)
        return longest

    @property
    def longest_suction_s(self) -> float:
        """Longest time under suction without a pause; a moment at zero is none for a driver."""
        longest = suction_s = lowest = 0.0
        for segment, start, end in zip(self.segments, self._starts(), self._ends(), strict=True):
            duration_s = _duration(segment, start)
            if isinstance(segment, Ramp) and segment.target_mbar > start:
                # Behind an until it may begin anywhere below
                duration_s = (segment.target_mbar - lowest) / segment.rate_mbar_per_s
            elif isinstance(segment, Until):
                duration_s = (segment.most_mbar - lowest) / segment.rate_mbar_per_s
            if not isinstance(segment, Until | Hold):
                lowest = end
            if isinstance(segment, Release) or (
                isinstance(segment, Rest) and duration_s >= _least_pause_s()
            ):
                suction_s = 0.0
            elif not isinstance(segment, Hold) or end > 0:
                suction_s += duration_s
            longest = max(longest, suction_s)
        return longest

    @property
    def stops_at_heights(self) -> bool:
        """Whether a height ends one of its segments."""
        return any(isinstance(s, Until) for s in self.segments)

    def as_run(
        self, segment: NDArray[np.intp], pressure_mbar: ArrayLike, *, whole: bool = False
    ) -> Program:
        """Return what was done: a rise that is over as the ramp to where it ended.

        segment, pressure_mbar: (n,) of the samples; whole: they go on to the program's end.
        """
        pressure = np.asarray(pressure_mbar, dtype=float)
        done = list(self.segments)
        for k, one in enumerate(self.segments):
            after = np.flatnonzero(segment > k)
            inside = np.flatnonzero(segment == k)
            over = after.size or (whole and inside.size and k + 1 == len(done))
            if not isinstance(one, Until) or not over:
                continue
            near = [float(pressure[i]) for i in (*inside[-1:], *after[:1])]
            held = isinstance(self.segments[min(k + 1, len(done) - 1)], Hold)
            # It ended between its last reading and the next one, which a hold keeps
            reached = max(near) if held else near[0]
            target = min(max(reached, LEAST_PRESSURE_MBAR), one.most_mbar)
            done[k] = Ramp(target, one.rate_mbar_per_s)
        return Program(tuple(done)) if tuple(done) != self.segments else self

    @property
    def phases(self) -> tuple[Phase, ...]:
        """What the skin sees in each segment."""
        return tuple(
            _phase(s, a, b)
            for s, a, b in zip(self.segments, self._starts(), self._ends(), strict=True)
        )

    @property
    def first_load(self) -> tuple[int, ...]:
        """Indices of the segments that load the skin for the first time."""
        indices = []
        for i, phase in enumerate(self.phases):
            if phase == "load":
                indices.append(i)
            elif indices and phase != "hold":
                break
        return tuple(indices)

    def boundaries_s(self) -> NDArray[np.float64]:
        """Return the ideal times (segments + 1,) between which each segment runs."""
        durations = [_duration(s, a) for s, a in zip(self.segments, self._starts(), strict=True)]
        return np.concatenate([[0.0], np.cumsum(durations)])

    @property
    def duration_s(self) -> float:
        """Ideal duration, without the final vent."""
        return float(self.boundaries_s()[-1])

    def knots(self) -> tuple[list[float], list[float]]:
        """Return times (s) and pressures (mbar) between which the pressure runs straight.

        Two at the same time are a jump.
        """
        t, p = [0.0], [0.0]
        for segment, begin, end, (t0, t1) in zip(
            self.segments, self._starts(), self._ends(), pairwise(self.boundaries_s()), strict=True
        ):
            jump = isinstance(segment, Release | Rest)
            t += [float(t0), float(t1)]
            p += [end if jump else begin, end]
        return t, p

    def pressure_mbar(self, time_s: ArrayLike) -> NDArray[np.float64]:
        """Return the pressure asked for at these times since the start."""
        return np.asarray(np.interp(np.asarray(time_s, dtype=float), *self.knots()))

    def segment_at(self, time_s: ArrayLike) -> NDArray[np.intp]:
        """Return the index of the segment that runs at these times; a boundary belongs to both.

        It is given to the earlier one, so that the peak of a ramp is part of the loading.
        """
        edges = self.boundaries_s()
        found = np.searchsorted(edges, np.asarray(time_s, dtype=float) - 1e-9, side="right") - 1
        return np.asarray(np.clip(found, 0, len(self.segments) - 1))


def _phase(segment: Segment, start: float, end: float) -> Phase:
    if isinstance(segment, Until):
        return "load"
    if isinstance(segment, Ramp):
        if end == start:
            return "hold" if end > 0 else "rest"
        return "load" if end > start else "unload"
    if isinstance(segment, Hold):
        return "hold" if end > 0 else "rest"
    return "unload" if isinstance(segment, Release) and start > 0 else "rest"


def _duration(segment: Segment, start: float) -> float:
    if isinstance(segment, Ramp):
        return abs(segment.target_mbar - start) / segment.rate_mbar_per_s
    if isinstance(segment, Until):
        return max(0.0, segment.most_mbar - start) / segment.rate_mbar_per_s
    return 0.0 if isinstance(segment, Release) else segment.duration_s


def _least_pause_s() -> float:
    """Return how short a rest can be that a driver counts as a pause."""
    from drivers.limits import MIN_PAUSE_S  # slow to import, and an identification needs none of it

    return MIN_PAUSE_S


def _text(number: float) -> str:
    """Return the shortest text that reads back as the same number."""
    return str(int(number)) if number == int(number) else repr(number)


def _check(segment: Segment) -> None:
    if isinstance(segment, Until) and not 0 < segment.height_mm <= HIGHEST_MM:
        raise InputError(f"segment {segment}: height must lie over 0 to {HIGHEST_MM:g} mm")
    if isinstance(segment, Ramp | Until):
        most = segment.most_mbar if isinstance(segment, Until) else segment.target_mbar
        if not 0 <= most <= MOST_PRESSURE_MBAR:
            raise InputError(
                f"segment {segment}: pressure must lie in 0–{MOST_PRESSURE_MBAR:g} mbar"
            )
        if not 0 < segment.rate_mbar_per_s <= STEEPEST_MBAR_PER_S:
            raise InputError(
                f"segment {segment}: rate must be positive, at most {STEEPEST_MBAR_PER_S:g} mbar/s"
            )
    elif not isinstance(segment, Release) and not segment.duration_s > 0:
        raise InputError(f"segment {segment}: duration must be positive, in s")


def check_measurable(program: Program) -> Program:
    """Return a program that a probe can be asked for; a curve may well be of another one.

    Raises:
        InputError: it is too fine for a probe, or pulls for too long without a pause.
    """
    if program.max_pressure_mbar < LEAST_PRESSURE_MBAR:
        raise InputError(
            f"program {program}: goes to {program.max_pressure_mbar:g} mbar; expected at least "
            f"{LEAST_PRESSURE_MBAR:g} mbar"
        )
    for segment in program.segments:
        if isinstance(segment, Ramp | Until) and segment.rate_mbar_per_s < SLOWEST_MBAR_PER_S:
            raise InputError(
                f"segment {segment}: expected a rate of at least {SLOWEST_MBAR_PER_S:g} mbar/s"
            )
    if program.longest_suction_s > MOST_SUCTION_S + 1e-6:
        raise InputError(
            f"program {program}: {program.longest_suction_s:g} s of suction without a pause (a "
            f"release, or a rest of {_least_pause_s():g} s); expected at most {MOST_SUCTION_S:g} s"
        )
    return program


# ---- text ------------------------------------------------------------------------------------


def parse_program(text: str) -> Program:
    """Return the program that `text` describes.

    Raises:
        InputError: the text does not follow the grammar, or the program is beyond the limits.
    """
    segments: list[Segment] = []
    for part in re.split(r",(?=\s*[a-z])", text.strip().lower()):
        segments += _parse_part(part.strip(), text)
    return Program(tuple(segments))


def _parse_part(part: str, text: str) -> list[Segment]:
    name, _, arguments = part.partition(":")
    parser = _PARSERS.get(name)
    if parser is None:
        raise InputError(
            f"program {text!r}: {part!r} is not a segment; expected one of: "
            f"{', '.join(_PARSERS)}{did_you_mean(name, _PARSERS)}"
        )
    form, parse = parser
    in_mm = re.fullmatch(r"([^@]*?)\s*mm\s*(@.*)", arguments)
    if name == "until":  # without the unit it is not understood
        numbers = _numbers(in_mm[1] + in_mm[2], form.replace("mm", "")) if in_mm else None
    else:
        numbers = _numbers(arguments, form)
    if numbers is None:
        raise InputError(f"program {text!r}: {part!r} was not understood; expected {form}")
    return parse(numbers)


def _numbers(arguments: str, form: str) -> list[float] | None:
    """Return the numbers of a part where its separators are those of its form."""
    required, _, optional = form.partition(":")[2].partition("[")
    signs = re.sub(r"[^,@]", "", arguments)
    expected = re.sub(r"[^,@]", "", required)
    if signs != expected and not (optional and signs == expected + ","):
        return None
    if not required:
        return None if arguments else []
    try:
        numbers = [number_in(x) for x in re.split(r"[,@]", arguments)]
    except ValueError:
        return None
    return numbers if all(math.isfinite(x) for x in numbers) else None


def _cycles(numbers: list[float], position: int) -> int:
    if len(numbers) <= position:
        return 1
    n = numbers[position]
    if n != int(n) or not 1 <= n <= MOST_CYCLES:
        raise InputError(f"number of cycles must be a whole number of 1–{MOST_CYCLES}, got {n:g}")
    return int(n)


def _mode1(n: list[float]) -> list[Segment]:
    pulse: list[Segment] = [Ramp(n[0], STEP_RATE_MBAR_PER_S), Hold(n[1]), Release(), Rest(n[2])]
    return pulse * _cycles(n, 3)


def _mode2(n: list[float]) -> list[Segment]:
    pulse: list[Segment] = [Ramp(n[0], n[1]), Ramp(0.0, n[1])]
    return pulse * _cycles(n, 2)


def _mode3(n: list[float]) -> list[Segment]:
    pulse: list[Segment] = [Ramp(n[0], STEP_RATE_MBAR_PER_S), Hold(n[1]), Ramp(0.0, n[2])]
    return pulse * _cycles(n, 3)


def _mode4(n: list[float]) -> list[Segment]:
    pulse: list[Segment] = [Ramp(n[0], n[1]), Release(), Rest(n[2])]
    return pulse * _cycles(n, 3)


_PARSERS: dict[str, tuple[str, Callable[[list[float]], list[Segment]]]] = {
    "ramp": ("ramp:P@RATE", lambda n: [Ramp(n[0], n[1])]),
    "until": ("until:Hmm@RATE[,MAX]", lambda n: [Until(*n)]),
    "hold": ("hold:S", lambda n: [Hold(n[0])]),
    "release": ("release", lambda _: [Release()]),
    "rest": ("rest:S", lambda n: [Rest(n[0])]),
    "mode1": ("mode1:P,ON,OFF[,N]", _mode1),
    "mode2": ("mode2:P@RATE[,N]", _mode2),
    "mode3": ("mode3:P,ON@RATE[,N]", _mode3),
    "mode4": ("mode4:P@RATE,OFF[,N]", _mode4),
}
