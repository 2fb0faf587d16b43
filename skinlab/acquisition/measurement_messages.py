"""What a measurement is asked for, the commands that it gives, and what it reports."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from skinlab.curves.curve import Setup
from skinlab.curves.program import check_measurable


@dataclass(frozen=True, slots=True)
class Plan:
    """What to measure: the same setup, several times.

    Raises:
        InputError: no probe can be asked for its program.
    """

    setup: Setup  # of the first repeat
    repeats: int = 1
    rest_s: float = 5.0  # between repeats, from when the pressure is gone
    rate_hz: float | None = None  # None: the instrument's usual one

    def __post_init__(self) -> None:
        """Refuse before anything is connected."""
        if self.setup.program is not None:
            check_measurable(self.setup.program)


class Phase(StrEnum):
    """Where a measurement is."""

    READY = "ready"  # nothing is asked for
    ARMING = "arming"
    ARMED = "armed"  # waits for Start
    STARTING = "starting"
    RUNNING = "running"
    SETTLING = "settling"  # the program is over, the pressure falls
    RESTING = "resting"  # before the next repeat
    VENTING = "venting"  # no repeat follows
    SEARCHING = "searching"  # the link is lost
    CHECKING = "checking"  # it is back; the vent is to be seen
    INTERRUPTED = "interrupted"  # the vent was seen; Continue takes the cut repeat again
    CLOSING = "closing"
    CLOSED = "closed"


# ---- requests -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Arm:
    """Make the probe ready for this plan."""

    plan: Plan


@dataclass(frozen=True, slots=True)
class Start:
    """Begin the suction of the plan; its later repeats follow by themselves."""


@dataclass(frozen=True, slots=True)
class Vent:
    """Vent now; no repeat follows."""

    reason: str


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """Somebody has taken note of the alarm."""


@dataclass(frozen=True, slots=True)
class Continue:
    """Take the repeat again that a lost link has cut, and those that were left."""


@dataclass(frozen=True, slots=True)
class Abort:
    """Give up what is left of the plan; vents where the instrument may pull."""

    why: str


@dataclass(frozen=True, slots=True)
class Close:
    """Vent, and end."""


Request = Arm | Start | Vent | Acknowledge | Continue | Abort | Close


# ---- what became of a command ---------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Succeeded:
    """A command is done."""

    of: Awaited


@dataclass(frozen=True, slots=True, eq=False)
class Failed:
    """A command was not done; `link`: the link is gone; `final`: to try again is useless."""

    of: Awaited
    error: Exception
    link: bool = False
    final: bool = False


Outcome = Succeeded | Failed


# ---- commands and reports -------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class ArmProbe:
    """Load the program of this setup, and arm."""

    setup: Setup
    rate_hz: float | None


@dataclass(frozen=True, slots=True, eq=False)
class StartProbe:
    """Start the armed program."""


@dataclass(frozen=True, slots=True, eq=False)
class Reconnect:
    """Try to get the lost link back."""


Awaited = ArmProbe | StartProbe | Reconnect  # commands that take time, and have an outcome


@dataclass(frozen=True, slots=True)
class VentProbe:
    """Vent before anything else."""

    reason: str


@dataclass(frozen=True, slots=True)
class AcknowledgeAlarm:
    """Unlatch the alarm of the driver."""


Command = Awaited | VentProbe | AcknowledgeAlarm


@dataclass(frozen=True, slots=True)
class RepeatEnded:
    """What was armed last is over: once for each ArmProbe."""

    setup: Setup
    ran: bool  # the skin was loaded: the next loading is another cycle
    cut: str | None  # why it ended early, or never began


@dataclass(frozen=True, slots=True, eq=False)
class Over:
    """The plan is done, or failed; with the error where there was one."""

    failed: str | None = None
    error: Exception | None = None
    left: int = 0  # repeats that are given up


@dataclass(frozen=True, slots=True)
class Gone:
    """The link did not come back, or leads to another instrument: the measurement is closed."""

    why: str


@dataclass(frozen=True, slots=True)
class Refused:
    """A request makes no sense now."""

    why: str


Report = RepeatEnded | Over | Gone | Refused
Output = Command | Report
