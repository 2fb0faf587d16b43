"""The goal of a visit: how far it is, what to measure next, and when more will not help."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skinlab.mechanics.names import plain
from skinlab.report.rounding import half_width_percent

if TYPE_CHECKING:
    from skinlab.curves.curve import Curve
    from skinlab.inference.identify import Identifier
    from skinlab.inference.result import Advice, Identification

_NO_HELP = 0.97  # expected ratio of widths from which on another measurement is no use
_SEED = 0  # of the draws that advice looks at: the same question has the same answer


@dataclass(frozen=True)
class Goal:
    """A parameter whose 90 % interval is to be no wider than ± this many per cent."""

    parameter: str
    percent: float

    @property
    def words(self) -> str:
        """X1 to ± 5 %."""
        return f"{plain(self.parameter)[0]} to ± {self.percent:g} %"


GOALS = tuple(
    Goal(name, percent)
    for name, percents in (("X1_MPa", (3, 5, 10, 20)), ("X2_MPa", (10, 20, 40)), ("nu", (10, 20)))
    for percent in percents
)


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


def distance(goal: Goal, curves: Sequence[Curve], identifier: Identifier) -> Distance:
    """Return how far these curves, together, are from the goal; takes about a second.

    Raises:
        InputError: they cannot be fitted together.
    """
    import numpy as np

    from skinlab.inference.advice import advise

    answer: Identification = identifier(curves[0]) if len(curves) == 1 else identifier.joint(curves)
    value = (answer.parameters or {}).get(goal.parameter)
    percent = None if value is None else half_width_percent(value)
    found = Distance(goal, percent, None)
    if percent is None or found.reached or answer.uncertainty is None:
        return found
    advice = advise(
        answer.uncertainty,
        identifier.database,
        identifier.kappa,
        curves[0].setup.thickness_mm,
        rng=np.random.default_rng(_SEED),
    )
    helpful = [a for a in advice if a.narrows.get(goal.parameter, 1.0) < _NO_HELP]
    best = min(helpful, key=lambda a: a.narrows[goal.parameter], default=None)
    return Distance(goal, percent, best)
