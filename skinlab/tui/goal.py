"""The goal of a visit: how far it is, what to measure next, and when more will not help.

A goal is a parameter to so many per cent, or whether the skin has changed since the visit before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from skinlab.mechanics.names import plain
from skinlab.report.rounding import half_width_percent

if TYPE_CHECKING:
    from skinlab.curves.curve import Curve
    from skinlab.inference.identify import Identifier
    from skinlab.inference.result import Advice
    from skinlab.mechanics.materials import Law
    from skinlab.studies.change import Changed, Changes

_NO_HELP = 0.97  # expected ratio of widths from which on another measurement is no use
_FIRST, _OTHERS = (3.0, 5.0, 10.0, 20.0), (10.0, 20.0, 40.0)  # per cent: the first is fixed best


@dataclass(frozen=True)
class Goal:
    """A parameter whose 90 % interval is to be no wider than ± this many per cent."""

    parameter: str
    percent: float

    @property
    def words(self) -> str:
        """X1 to ± 5 %."""
        return f"{plain(self.parameter)[0]} to ± {self.percent:g} %"


@dataclass(frozen=True)
class Distance:
    """How far a visit is from its goal."""

    goal: Goal
    percent: float | None  # None: there is no interval yet
    following: Advice | None  # what narrows it most, where something does

    @property
    def reached(self) -> bool:
        """Whether nothing more has to be measured."""
        return self.percent is not None and self.percent <= self.goal.percent

    @property
    def words(self) -> str:
        """The same as a clause for the screen, with the key for what comes next."""
        if self.percent is None:
            return f"goal {self.goal.words}: no interval yet; F8 measures again"
        now = f"goal {self.goal.words}: ± {self.percent:.2g} % now"
        if self.reached:
            return f"{now}, reached; nothing more has to be measured"
        if self.following is None:
            return f"{now}; more of these measurements will not help"
        expected = self.percent * self.following.narrows[self.goal.parameter]
        what = f"{self.following.aperture_mm:g} mm, {self.following.program}"
        return f"{now}; F7 loads {what} (expected ± {expected:.2g} %)"


@dataclass(frozen=True)
class ChangeGoal:
    """Whether the skin has changed since the visit before, of the same subject and site."""

    words: str = "has it changed since the visit before?"


@dataclass(frozen=True)
class Following:
    """What to measure next."""

    aperture_mm: float
    program: str


@dataclass(frozen=True)
class ChangeDistance:
    """How far a visit is from saying whether the skin has changed."""

    goal: ChangeGoal
    since: str = ""  # the file of the visit before
    found: Changed | None = None  # None: nothing can be compared yet
    following: Following | None = None
    expected: float | None = None  # smallest change that one more placement could show, per cent
    why: str = ""  # there is nothing to compare

    @property
    def reached(self) -> bool:
        """Whether the question is answered."""
        return self.found is not None and self.found.verdict != "cannot_say"

    @property
    def words(self) -> str:
        """The same as a clause for the screen, with the key for what comes next."""
        if self.found is None:
            then = "" if self.following is None else f"; F7 loads {_measured(self.following)}"
            return f"changed? {self.why}{then}"
        said = self.found.to_json()
        unit = " %" if said["unit"] == "%" else ""
        name = plain(self.found.name)[0]
        smallest = f"{said['smallest_shown']:.2g}{unit}"
        match self.found.verdict:
            case "changed":
                ends = f"{said['low']:+.2g} to {said['high']:+.2g}{unit}"
                return f"changed since {self.since}: {name} {said['change']:+.2g}{unit} ({ends})"
            case "not_shown":
                return f"no change of {name} is shown since {self.since}; {smallest} would be"
        now = f"changed? not before {smallest} of {name}"
        if self.following is None:
            return f"{now}; more of these measurements will not help"
        expected = "" if self.expected is None else f" (then {self.expected:.2g}{unit})"
        return f"{now}; place anew (Ins), F7: {_measured(self.following)}{expected}"


def _measured(following: Following) -> str:
    return f"{following.aperture_mm:g} mm, {following.program}"


AnyGoal = Goal | ChangeGoal
AnyDistance = Distance | ChangeDistance


def choices(law: Law) -> list[AnyGoal]:
    """Return what a visit can aim at where curves are identified with this law."""
    first, *others = law.names
    goals = [Goal(first, percent) for percent in _FIRST]
    goals += [Goal(name, percent) for name in others for percent in _OTHERS]
    return [*goals, ChangeGoal()]


def change_distance(
    goal: ChangeGoal,
    before: Path | None,
    curves: Sequence[Curve],
    identifier: Identifier,
    serial_number: str,
    study: Path | None = None,
) -> ChangeDistance:
    """Return how far these curves are from saying whether the skin changed; takes some seconds.

    Only what both visits measured alike is compared. What placing the probe anew scatters counts,
    and of a `study`, a folder of `skinlab study`, visits and operators too.

    Raises:
        SkinlabError: the visit before cannot be read, or one of the two cannot be fitted.
    """
    from skinlab.recording.session import read_session
    from skinlab.recording.session_fit import comparable, excluded_of
    from skinlab.studies import change
    from skinlab.studies.change import condition
    from skinlab.tui.comparing import sides

    if before is None:
        return ChangeDistance(goal, why="there is no earlier visit of this subject and site here")
    session = read_session(before)
    earlier = comparable(session.curves, excluded_of(session))
    if not earlier:
        return ChangeDistance(goal, before.name, why=f"{before.name} holds no whole first loading")
    then, now = {condition(c) for c in earlier}, {condition(c) for c in curves}
    lacking = [Following(*one) for one in sorted(then - now)]
    if not then & now:
        why = f"{before.name} was measured otherwise"
        return ChangeDistance(goal, before.name, following=lacking[0], why=why)
    first, last = sides(before, session, curves, identifier, serial_number)
    found = _stiffness(change.changes(first, last, study=study))
    if found.verdict != "cannot_say":
        return ChangeDistance(goal, before.name, found)
    again = replace(last, placements=last.placements + 1)
    more = _stiffness(change.changes(first, again, study=study))
    if lacking:
        return ChangeDistance(goal, before.name, found, lacking[0])
    if more.smallest > _NO_HELP * found.smallest:
        return ChangeDistance(goal, before.name, found)
    next_one = Following(*[c for c in map(condition, curves) if c in then][-1])
    return ChangeDistance(goal, before.name, found, next_one, more.to_json()["smallest_shown"])


def _stiffness(found: Changes) -> Changed:
    """Return what answers best: the factor common to all stiffnesses, or the first parameter."""
    return found.stiffness or found.parameters[0]


def distance(goal: Goal, curves: Sequence[Curve], identifier: Identifier) -> Distance:
    """Return how far these curves, together, are from the goal; takes about a second.

    Raises:
        InputError: they cannot be fitted together.
    """
    answer = identifier.together(curves)
    value = (answer.parameters or {}).get(goal.parameter)
    percent = None if value is None else half_width_percent(value)
    found = Distance(goal, percent, None)
    if percent is None or found.reached:
        return found
    advice = identifier.advise(answer, curves[0].setup.thickness_mm)
    helpful = [a for a in advice if a.narrows.get(goal.parameter, 1.0) < _NO_HELP]
    best = min(helpful, key=lambda a: a.narrows[goal.parameter], default=None)
    return Distance(goal, percent, best)
