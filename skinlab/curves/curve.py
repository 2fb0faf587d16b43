"""One suction curve: read-only arrays of time, pressure and deflection, and what they belong to."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.apertures import check_aperture
from skinlab.curves.lone_readings import white_noise, without_lone_readings
from skinlab.curves.program import Phase, Program
from skinlab.curves.settings import SAMPLES
from skinlab.errors import InputError

if TYPE_CHECKING:
    from skinlab.curves.probe_file import ProbeErrors
    from skinlab.curves.stated_skin import StatedSkin

Array = NDArray[np.float64]


_NO_NUMBERS = {"m": "durations", "M": "dates", "c": "complex numbers", "b": "truth values"}


def check_thickness(thickness_mm: float) -> float:
    """Return the thickness where it can be a skin's (epidermis and dermis together).

    Raises:
        InputError: it is not within 0.1–10 mm.
    """
    if not 0.1 <= thickness_mm <= 10.0:
        raise InputError(f"thickness_mm {thickness_mm:g}: expected 0.1–10 mm")
    return float(thickness_mm)


MOST_LOADINGS = 10_000  # of one site: a learned function of their number has a point for each
_OF_A_SETUP: tuple[tuple[str, Any, str], ...] = (
    ("aperture_mm", Real, "a number"),
    ("thickness_mm", Real, "a number"),
    ("program", Program | None, "a Program or None"),
    ("cycle", Integral, "a whole number"),
    ("repeat", Integral, "a whole number"),
    ("thickness_sd_mm", Real | None, "a number or None"),
    ("placement", str | None, "a text or None"),
)


@dataclass(frozen=True)
class Setup:
    """What a curve was measured with."""

    aperture_mm: float  # diameter of the probe's opening
    thickness_mm: float  # of the skin, as measured
    program: Program | None = None
    cycle: int = 1  # 1 = first loading of this site, or one after full rest
    repeat: int = 1
    thickness_sd_mm: float | None = None
    placement: str | None = None  # one putting-on of the probe; None: by the cycles

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        for name, expected, words in _OF_A_SETUP:
            value: Any = getattr(self, name)
            if isinstance(value, np.generic):  # json writes Python's numbers only
                value = value.item()
                object.__setattr__(self, name, value)
            if not isinstance(value, expected) or isinstance(value, bool):
                raise InputError(f"{name} {value!r}: expected {words}")
        check_aperture(self.aperture_mm)
        check_thickness(self.thickness_mm)
        if self.thickness_sd_mm is not None and not 0 <= self.thickness_sd_mm < self.thickness_mm:
            raise InputError(
                f"thickness_sd_mm {self.thickness_sd_mm:g}: expected 0 to the thickness itself"
            )
        for name in ("cycle", "repeat"):
            if not 1 <= getattr(self, name) <= MOST_LOADINGS:
                raise InputError(f"{name} {getattr(self, name)}: expected 1 to {MOST_LOADINGS}")


def named_placement(text: str | None) -> str | None:
    """Return the name of a placement; None of blanks, which all curves without one would share."""
    return None if text is None or not text.strip() else text


@dataclass(frozen=True, eq=False)
class Curve:
    """A measured or simulated curve. Arrays (n,) in time order; read-only.

    `segment` (n,) is the index of the program's segment where it is known. `probe` is the
    calibration whose errors are in the readings; `corrected_by` the one whose errors were taken
    off them, and who leaves open what it does not know. `campaign` is the folder of the campaign,
    or the file of the session, that it is from: a label of a placement means nothing beyond.
    `noise_um` and `pressure_noise_mbar`, standard deviations of one sample, are what that states,
    and `skin` is whose it is, and where.

    Raises:
        InputError: lengths differ, a value is not finite, or time does not increase.
    """

    name: str
    setup: Setup
    time_s: Array
    pressure_mbar: Array
    deflection_mm: Array
    segment: NDArray[np.intp] | None = None
    partial: bool = False  # cut short: by a vent, a fault, a lost link
    source: str | None = None  # `sha256:…` of the file that it was read from
    probe: ProbeErrors | None = None
    corrected_by: ProbeErrors | None = None
    campaign: str | None = None
    noise_um: float | None = None
    pressure_noise_mbar: float | None = None
    skin: StatedSkin | None = None
    _phase: NDArray[np.str_] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check once, then freeze."""
        if not isinstance(self.setup, Setup):
            raise InputError(f"{self.name}: setup {self.setup!r}: expected a Setup")
        n = -1
        for column in ("time_s", "pressure_mbar", "deflection_mm"):
            array = self._readings(column)
            n = array.size if n < 0 else n
            if array.shape != (n,):
                raise InputError(f"{self.name}: {column} has {array.shape} values, expected ({n},)")
            bad = np.flatnonzero(~np.isfinite(array))
            if bad.size:
                raise InputError(f"{self.name}: {column} is not finite at sample {bad[0] + 1}")
            array.flags.writeable = False
            object.__setattr__(self, column, array)
        late = np.flatnonzero(np.diff(self.time_s) <= 0)
        if late.size:
            raise InputError(f"{self.name}: time_s does not increase at sample {late[0] + 2}")
        if self.segment is not None:
            segment = np.array(self.segment, dtype=np.intp)
            segment.flags.writeable = False
            object.__setattr__(self, "segment", segment)
        phase = np.array(self._phases(), dtype="U6")
        phase.flags.writeable = False
        object.__setattr__(self, "_phase", phase)

    def _readings(self, column: str) -> Array:
        """Return a copy of a column as plain numbers.

        Raises:
            InputError: they are none, as durations and what is masked.
        """
        values = getattr(self, column)
        if np.ma.is_masked(values):
            first = int(np.argmax(np.ma.getmaskarray(values)))
            raise InputError(
                f"{self.name}: {column} is masked at sample {first + 1}; expected numbers alone: "
                "leave such samples out of all three columns"
            )
        kind = np.asarray(values).dtype.kind
        if kind in _NO_NUMBERS:
            raise InputError(
                f"{self.name}: {column} has {_NO_NUMBERS[kind]}, expected numbers in "
                f"{column.rpartition('_')[2]}"
            )
        try:
            return np.array(values, dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.name}: {column}: {error}; expected numbers") from None

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def phase(self) -> NDArray[np.str_]:
        """What the skin sees at each sample (n,): load, hold, unload or rest."""
        return self._phase

    @property
    def program_as_run(self) -> Program | None:
        """The program, with what was reached in the place of heights; None: nobody knows it."""
        program = self.setup.program
        if program is None or not program.stops_at_heights:
            return program
        if self.segment is None:
            return None
        return program.as_run(self.segment, self.pressure_mbar, whole=not self.partial)

    @property
    def segments(self) -> NDArray[np.intp] | None:
        """Which segment of its program each sample (n,) is of, as recorded or by its time."""
        program = self.program_as_run
        if self.segment is not None or program is None:
            return self.segment
        return program.segment_at(self.time_s - self.time_s[:1])

    def only(self, kept: NDArray[np.bool_]) -> Curve:
        """Return some of the samples (n,): each is of the segment that it was of."""
        segments = self.segments
        return replace(
            self,
            time_s=self.time_s[kept],
            pressure_mbar=self.pressure_mbar[kept],
            deflection_mm=self.deflection_mm[kept],
            segment=None if segments is None else segments[kept],
        )

    def _phases(self) -> list[Phase] | NDArray[np.str_]:
        program, index = self.program_as_run, self.segments
        if program is not None and index is not None and len(self):
            names = [*program.phases, "rest"]
            return [names[min(int(i), len(program.segments))] for i in index]
        return phases_from_pressure(self.pressure_mbar)

    def first_load(self) -> NDArray[np.bool_]:
        """Return which samples (n,) belong to the first loading: what the elastic law describes.

        A short hold inside a stepped loading is not part of it.
        """
        load = self.phase == "load"
        after = np.flatnonzero((self.phase == "unload") | (self.phase == "rest"))
        starts = np.flatnonzero(load)
        if starts.size:
            over = after[after > starts[0]]
            if over.size:
                load[over[0] :] = False
        return np.asarray(load)

    def in_phases(self, phases: tuple[str, ...]) -> NDArray[np.bool_]:
        """Return which samples (n,) to fit.

        `load` alone means the first loading; with others, every loading.
        """
        chosen = np.isin(self.phase, [p for p in phases if p != "load"])
        if "load" in phases:
            chosen |= self.first_load() if phases == ("load",) else self.phase == "load"
        return chosen


def phases_from_pressure(pressure_mbar: Array) -> NDArray[np.str_]:
    """Return the phases (n,) read from the pressure channel alone, noise and all.

    The channel is cut into visits to the top (within 3 % of the highest pressure, or 4 standard
    deviations of its noise), visits to zero, and ways between them. A visit to the top is a hold
    where it lasts longer than passing through that band would; else it is split at its peak.
    Readings that stand alone do not count.
    """
    p = np.asarray(pressure_mbar, dtype=float)
    n = len(p)
    phase = np.full(n, "load", dtype="U6")
    noise = white_noise(p)
    p = without_lone_readings(np.arange(n, dtype=float), p)
    top = float(p.max(initial=0.0))
    if n < SAMPLES.fewest or top <= 0:
        return phase
    band = min(max(0.03 * top, 4.0 * noise), 0.25 * top)
    level = np.where(p >= top - band, 2, np.where(p <= band, 0, 1))
    edges = np.flatnonzero(np.diff(level)) + 1
    runs = [(int(r[0]), int(r[-1]) + 1) for r in np.split(np.arange(n), edges)]
    # Samples that a ramp spends in a band as wide as this one, from the ways between.
    crossing = 2.0 * band / (top - 2.0 * band) * max(1, int((level == 1).sum()))
    been_up = False
    for begin, end in runs:
        here = level[begin]
        if here == 2:
            been_up = True
            falls = bool((level[end:] < 2).any())
            peak = begin + int(np.argmax(p[begin:end]))
            held = (end - begin) > 1.5 * crossing + 2
            if not falls and not held:
                continue
            if held:
                first = begin + int(np.argmax(p[begin:end] >= np.median(p[begin:end]) - band / 3))
                phase[first:end] = "hold"
            else:
                phase[peak + 1 : end] = "unload"
        elif here == 0:
            if not been_up:
                continue  # before the first loading: its foot
            later = bool((level[end:] == 2).any())
            phase[begin:end] = "rest" if later or (end - begin) > crossing else "unload"
            been_up = not later
        else:
            phase[begin:end] = "unload" if been_up else "load"
    return phase
