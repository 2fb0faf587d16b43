"""What is said on the wire: commands (to the instrument) and events (from it, or from the driver).

All are frozen: they cross threads and are recorded. Every quantity carries its unit in its name.
Pressure is suction: +100 mbar pulls the skin up.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

PROGRAM_END = "program end"  # reason of the State with which a run that was not cut short ends
PROGRAM_DONE = "done"  # and of the one after it, once the pressure has fallen
NO_NUMBERS = "the readings are no numbers"  # reason of Damaged, and of the vent that follows


class SegmentKind(StrEnum):
    """What the pump does during one segment of a program."""

    RAMP = "ramp"  # go to target_mbar at rate_mbar_per_s
    HOLD = "hold"  # stay at the present target for duration_s
    UNTIL = "until"  # rise at rate_mbar_per_s until height_mm is read, to target_mbar at most
    RELEASE = "release"  # vent as fast as the instrument can
    REST = "rest"  # stay at zero for duration_s


@dataclass(frozen=True, slots=True)
class Segment:
    """One segment of a pressure program, as it goes over the wire; unused fields are zero."""

    kind: SegmentKind
    target_mbar: float = 0.0
    rate_mbar_per_s: float = 0.0
    duration_s: float = 0.0
    height_mm: float = 0.0


class InstrumentState(StrEnum):
    """The instrument's own state, as it reports it."""

    IDLE = "idle"  # vented, no program loaded
    LOADED = "loaded"  # a program was accepted and read back
    ARMED = "armed"  # waits for start; keep-alive required from here on
    RUNNING = "running"  # follows the program and sends samples
    VENTING = "venting"  # valve open, pressure falling
    FAULT = "fault"  # vented and latched until Reset


# ---- commands -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Identify:
    """Ask who is there; answered by Hello and State."""


@dataclass(frozen=True, slots=True)
class Load:
    """Load a program, bounded in pressure and time by the command itself.

    The instrument refuses it (Refused) where it exceeds its own limits, and reads it back (Loaded).
    """

    segments: tuple[Segment, ...]
    rate_hz: float
    max_pressure_mbar: float  # the instrument vents if it measures more than this plus its margin
    max_suction_s: float  # the instrument vents after this long under suction without a pause


@dataclass(frozen=True, slots=True)
class Arm:
    """Make ready: only an armed instrument starts."""


@dataclass(frozen=True, slots=True)
class Start:
    """Run the loaded program once."""


@dataclass(frozen=True, slots=True)
class Vent:
    """Open the valve now. Legal in every state."""


@dataclass(frozen=True, slots=True)
class KeepAlive:
    """Sent every 100 ms from Arm on; without it for 500 ms the instrument vents by itself."""


@dataclass(frozen=True, slots=True)
class Reset:
    """Acknowledge a fault: FAULT becomes IDLE once the cause is gone."""


Command = Identify | Load | Arm | Start | Vent | KeepAlive | Reset


# ---- events that an instrument sends -----------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Hello:
    """Who the instrument is and what it allows."""

    dialect: str
    protocol_version: int
    model: str
    firmware: str
    serial_number: str
    aperture_mm: float | None  # diameter of the probe opening; None: it does not say
    max_pressure_mbar: float
    max_suction_s: float
    min_rate_hz: float
    max_rate_hz: float
    simulated: bool
    default_rate_hz: float = 20.0  # what to use where the operator names no rate
    read_only: bool = False  # it only streams: nothing here can start it, or end its suction


@dataclass(frozen=True, slots=True)
class Loaded:
    """Read-back of Load: what the instrument will do."""

    segments: tuple[Segment, ...]
    rate_hz: float
    max_pressure_mbar: float
    max_suction_s: float


@dataclass(frozen=True, slots=True)
class State:
    """The instrument's state, why it changed, and the pressure that it measures right now."""

    state: InstrumentState
    reason: str
    pressure_mbar: float | None = None  # None: this instrument does not say


@dataclass(frozen=True, slots=True)
class Sample:
    """One reading of both channels.

    `segment` is the index of the program's segment; len(segments) while the final vent runs.
    """

    sequence: int  # counts samples of one run from 0, without gaps
    device_time_s: float  # since Start, by the instrument's clock
    pressure_mbar: float
    deflection_mm: float
    segment: int
    # The host's, when its bytes came; told where nobody holds the instrument's clock to it
    host_time_s: float | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading of both channels of an instrument that only streams, and knows of no runs."""

    pressure_mbar: float
    deflection_mm: float
    time_s: float | None = None  # by the instrument's clock; None: it sends none
    sequence: int | None = None  # counts the readings; None: it does not count


@dataclass(frozen=True, slots=True)
class InstrumentFault:
    """The instrument found something wrong and vented."""

    code: str
    text: str


@dataclass(frozen=True, slots=True)
class Refused:
    """The instrument did not take a command."""

    command: str
    reason: str

    @property
    def of_vent(self) -> bool:
        """Whether it was the vent, which no instrument may refuse."""
        return self.command.casefold() == "vent"


@dataclass(frozen=True, slots=True)
class Pace:
    """A simulated instrument's time runs `speed` times as fast as the host's; said after Hello.

    No real instrument says it, and from one that does not call itself simulated it means nothing.
    """

    speed: float


@dataclass(frozen=True, slots=True)
class Abilities:
    """What the instrument can do besides; said after Hello. What it does not say, it cannot."""

    until: bool = False  # end a segment where the deflection reaches a height


# ---- events that the driver adds -------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Damaged:
    """Bytes that made no valid frame; reading goes on behind them."""

    reason: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Gap:
    """Samples are missing: `expected` was due, `received` came."""

    expected: int
    received: int


@dataclass(frozen=True, slots=True)
class HostVented:
    """The driver ordered a vent, and why (operator, stale link, overshoot, ...)."""

    reason: str


@dataclass(frozen=True, slots=True)
class VentConfirmed:
    """The pressure fell below 5 mbar after a vent, whoever ordered it (program's end included)."""

    pressure_mbar: float


@dataclass(frozen=True, slots=True)
class Alarm:
    """Latched until acknowledged: tell the operator to lift the probe."""

    text: str


@dataclass(frozen=True, slots=True)
class LinkLost:
    """The link is gone; the instrument vents by its own keep-alive limit."""

    reason: str


@dataclass(frozen=True, slots=True)
class LinkRestored:
    """The link is back, with the same instrument behind it; its program is gone."""

    outage_s: float  # since LinkLost


InstrumentEvent = (
    Hello | Loaded | State | Sample | Reading | InstrumentFault | Refused | Pace | Abilities
)
DriverEvent = Damaged | Gap | HostVented | VentConfirmed | Alarm | LinkLost | LinkRestored
Event = InstrumentEvent | DriverEvent


@dataclass(frozen=True, slots=True)
class TimedEvent:
    """An event and the host's monotonic time at which its bytes arrived."""

    host_time_s: float
    event: Event
