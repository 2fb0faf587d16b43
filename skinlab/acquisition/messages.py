"""What a probe session says to the screen: plain frozen data, posted from worker threads."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.dose import Dose
from drivers.events import Hello
from skinlab.acquisition.measurement_messages import Phase, Plan
from skinlab.recording.stream import Message

if TYPE_CHECKING:
    from skinlab.discrepancy.outcome import Outcome
    from skinlab.inference.result import Identification


@dataclass(frozen=True, slots=True)
class Connected:
    """A probe answered."""

    port: str
    hello: Hello
    goes_on: bool = False  # the session that was open before
    visit: tuple[str, str] | None = None  # subject and site, where a record says so
    probe: tuple[bool, str] | None = None  # whether it agrees, and a sentence
    for_effect: frozenset[str] = frozenset()  # names of curves that a record says so of


@dataclass(frozen=True, slots=True)
class Recording:
    """The session of this connection has a file from here on."""

    path: Path
    before: Dose = field(default_factory=Dose)  # of the site, by sessions on disk too


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """Messages of the pipeline, in order; several at once, so that a fast probe costs no more."""

    messages: tuple[Message, ...]
    at: datetime | None = None  # when, in local time; None: unknown


@dataclass(frozen=True, slots=True, eq=False)
class Estimated:
    """What a curve that still grows looks like so far; not final, and without intervals."""

    index: int
    result: Identification


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """Several curves of the session, fitted together."""

    result: Identification


@dataclass(frozen=True, slots=True)
class Compared:
    """The session held against another one, in sentences."""

    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Explaining:
    """A stage of the search for what the model misses has begun."""

    stage: str


@dataclass(frozen=True, slots=True, eq=False)
class Explained:
    """What the model misses."""

    outcome: Outcome


@dataclass(frozen=True, slots=True)
class Adopted:
    """A model with the missing effect was written, and is what curves are identified with.

    `path` is None where that was undone, `name` where it is the base law again.
    """

    path: Path | None
    name: str | None
    anew: bool = True  # the session that is open was identified with another model


@dataclass(frozen=True, slots=True)
class Played:
    """How far a replay is, in s of the record."""

    at_s: float
    length_s: float
    ended: bool


@dataclass(frozen=True, slots=True)
class Saved:
    """The session file holds everything up to now."""

    path: Path


@dataclass(frozen=True, slots=True)
class Went:
    """The measurement is in another phase."""

    phase: Phase
    left: Plan | None  # what is still to be measured, the present repeat included
    rest_s: float | None = None  # until the next repeat, where that is waited for


@dataclass(frozen=True, slots=True)
class Over:
    """The measurement that was asked for last is over; `failed` says why it was cut short."""

    failed: str | None
    left: int  # repeats that are given up


@dataclass(frozen=True, slots=True)
class Disconnected:
    """The connection is over: vented, and what was measured is saved."""

    port: str


@dataclass(frozen=True, slots=True)
class Failed:
    """Something that was asked for did not work; `text` is a sentence for the operator."""

    doing: str
    text: str


@dataclass(frozen=True, slots=True)
class Done:
    """Something that was asked for is done."""

    doing: str


News = (
    Connected
    | Recording
    | Heard
    | Estimated
    | Fitted
    | Compared
    | Explaining
    | Explained
    | Adopted
    | Played
    | Saved
    | Went
    | Over
    | Disconnected
    | Failed
    | Done
)
