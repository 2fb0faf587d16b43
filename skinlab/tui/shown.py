"""What there is to be shown: a curve, growing or complete, what comes next, a replay, a search."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.events import Sample
from skinlab.acquisition.measurement_request import Order
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.growing import GrowingCurve
from skinlab.quality.gates.base import Finding
from skinlab.report.verdict import Verdict, judge

if TYPE_CHECKING:
    from skinlab.discrepancy.outcome import Outcome
    from skinlab.inference.result import Identification
    from skinlab.tui.goal import AnyDistance


_RATE_SAMPLES = 41


@dataclass(slots=True)
class Live:
    """The curve that is being measured; it grows while it is drawn."""

    index: int
    curve: GrowingCurve
    last: Sample | None = None
    findings: list[Finding] = field(default_factory=list)
    estimate: Identification | None = None  # of what there is so far
    began_s: float | None = None  # by the clock of `tick`
    for_effect: bool = False  # measured as the search for what is missing advised

    @property
    def setup(self) -> Setup:
        """What it is measured with."""
        return self.curve.setup

    @property
    def rate_hz(self) -> float | None:
        """Samples a second by the instrument's clock, over the last second or so; None: unknown."""
        late = self.curve.time_s[-_RATE_SAMPLES:]
        return float((len(late) - 1) / (late[-1] - late[0])) if len(late) > 1 else None


@dataclass(slots=True)
class Entry:
    """A completed curve of this session."""

    index: int
    curve: Curve
    cut: str | None
    lost: int
    result: Identification | None = None
    findings: list[Finding] = field(default_factory=list)
    visit: tuple[str, str] | None = None  # subject and site
    at: datetime | None = None  # when it was complete, in local time
    began_s: float | None = None  # by the clock of `tick`
    ended_s: float | None = None
    for_effect: bool = False  # measured as the search for what is missing advised

    @property
    def setup(self) -> Setup:
        """What it was measured with."""
        return self.curve.setup

    @property
    def verdict(self) -> Verdict | None:
        """Whether it can be used; None: not known yet."""
        return judge(
            self.result,
            self.findings,
            self.cut,
            partial=self.curve.partial,
            for_effect=self.for_effect,
        )


@dataclass(frozen=True, slots=True)
class Review:
    """What will happen, as it is shown before it is confirmed."""

    order: Order
    texts: Mapping[str, str]  # of the fields
    goes_on: bool = False  # with what a lost link has cut
    assumed_thickness: bool = False  # nobody typed it for this subject and site
    counted: int | None = None  # which loading of the site it is, by what was seen
    protocol: tuple[str, ...] = ()  # which of its steps this is
    otherwise: tuple[str, ...] = ()  # than the protocol says, in clauses
    asked: Order | None = None  # as the fields have it
    unanswered: str | None = None  # why there will be no whole answer
    placed: str = ""  # whether the probe was put on anew since the curve before
    before: str = ""  # that the site had suction before this program was started


@dataclass(frozen=True, slots=True)
class Aimed:
    """News: how far the visit is from its goal."""

    distance: AnyDistance


@dataclass(slots=True)
class Playing:
    """A replay, in the place of a probe."""

    at_s: float = 0.0
    length_s: float = 0.0
    speed: float | None = 1.0  # None: as fast as can be
    paused: bool = False
    ended: bool = False


@dataclass(slots=True)
class Missing:
    """The search for what the model misses, and its answer."""

    curves: tuple[str, ...]
    stages: list[str] = field(default_factory=list)  # the last one is under way
    running: bool = True
    outcome: Outcome | None = None
    failed: str = ""
    adopted: Path | None = None
