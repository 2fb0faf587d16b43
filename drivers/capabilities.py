"""What an instrument lets the host do, and how one that only streams is read."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

APERTURES_MM = (2.0, 4.0, 6.0, 8.0)  # diameters of the openings that probes have
READ_ONLY = "this instrument is not under our control: its own limits hold"
CANNOT_VENT = "it cannot be vented from here"


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What an instrument can be asked for. All false: it only streams.

    Suction is started only where all four are there. Anything less is measured read-only.
    """

    load: bool = False  # takes a program, bounded in pressure and time by the command itself
    read_back: bool = False  # says which program it has taken
    keep_alive: bool = False  # vents by itself where the host falls silent
    vent: bool = False  # opens its valve when it is told to

    @property
    def controllable(self) -> bool:
        """Whether the host may start suction with it."""
        return self.load and self.read_back and self.keep_alive and self.vent


CONTROLLABLE = Capabilities(load=True, read_back=True, keep_alive=True, vent=True)


@dataclass(frozen=True, slots=True)
class Stream:
    """How the readings of an instrument that only streams become runs.

    A run begins with the last reading at or below `zero_mbar` before one of `begin_mbar` or more.
    It ends with the first reading at or below `zero_mbar` after which the pressure stays there for
    `zero_s`; or at the end of the program, where one is known; or where nothing comes for
    `silent_s`.

    Raises ValueError for a value that makes no sense.
    """

    model: str = ""  # what the instrument is called; empty: as its dialect
    aperture_mm: float | None = None  # None: the operator says it
    rate_hz: float | None = None  # readings a second; needed where they carry no time
    begin_mbar: float = 4.0  # well above the noise and the drift of a pressure channel
    zero_mbar: float = 1.0  # the hysteresis: noise of 0.2 mbar stays below it
    zero_s: float = 0.5  # a dip between two pulses is shorter
    silent_s: float = 1.0  # longer than adapters keep bytes back
    keep_alive_s: float = 0.5  # between two keep-alives, of an instrument that needs them

    def __post_init__(self) -> None:
        """Refuse what makes no sense."""
        if self.aperture_mm is not None and self.aperture_mm not in APERTURES_MM:
            known = ", ".join(f"{a:g}" for a in APERTURES_MM)
            raise ValueError(
                f"aperture_mm is {self.aperture_mm:g}; expected one of {known} (the diameter)"
            )
        for field in fields(self)[1:]:
            value = getattr(self, field.name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"{field.name} must be positive and finite, not {value}")
        if self.zero_mbar >= self.begin_mbar:
            raise ValueError(
                f"zero_mbar {self.zero_mbar:g} must be below begin_mbar {self.begin_mbar:g}"
            )
