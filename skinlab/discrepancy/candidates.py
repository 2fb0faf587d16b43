"""Explanations that were fitted, and what they are to one another: the leader, its rivals."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.adequacy import Residual
from skinlab.discrepancy.fit import Fit
from skinlab.discrepancy.records import Record
from skinlab.discrepancy.screen import Signature
from skinlab.discrepancy.settings import ERRORS, NAMES, SEARCH
from skinlab.inference.covariance import Covariance, independent
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.effects.learned import LearnedEffect

LOG10 = math.log(10.0)


@dataclass(frozen=True, eq=False)
class Candidate:
    """An explanation with its fit, what it leaves, and its evidence against no effect."""

    fit: Fit
    left: Residual
    log10_evidence: float  # of the data and the prior odds, relative to the base model
    at_bound: tuple[str, ...] = ()  # unknowns that the fit has pushed to the end of their range

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects of the explanation beyond the model's own."""
        return self.fit.effects

    @property
    def kind(self) -> str:
        """The kind of function of a learned explanation; "" of others."""
        return get_effect(self.effects[-1]).family if self.effects else ""

    @property
    def adequate(self) -> bool:
        """Whether what it leaves may well be noise."""
        return self.left.p_value >= ERRORS.adequate


def are_several(explanation: Candidate, own: Collection[str]) -> bool:
    """Return whether it adds several effects to the model's own: a sentence says "they"."""
    return sum(effect not in own for effect in explanation.effects) > 1


@dataclass(eq=False)
class Partial:
    """What is known so far, for whoever interrupts."""

    base: Candidate | None = None
    candidates: list[Candidate] = field(default_factory=list)

    def add(self, one: Candidate, *, base: bool) -> None:
        """Take what has just been fitted; of one explanation the better fit."""
        if base:
            self.base = one
            return
        same = [c for c in self.candidates if c.effects == one.effects]
        if not same or one.fit.cost < same[0].fit.cost:
            self.candidates = [c for c in self.candidates if c.effects != one.effects] + [one]


@dataclass(frozen=True, eq=False)
class Found:
    """What the search came to."""

    base: Candidate
    signatures: dict[str, Signature]  # of single effects at the base fit
    candidates: list[Candidate] = field(default_factory=list)  # the best first
    records: Sequence[Record] = ()  # what was explained
    not_screened: dict[str, str] = field(default_factory=dict)  # effect -> why it was not
    # By which the explanations were fitted
    errors: Covariance = field(default_factory=lambda: independent(np.zeros(0)))
    kept: tuple[NDArray[np.bool_], ...] = ()  # of each record's samples; others are outliers
    implausible: str = ""  # errors that are too large to be errors

    @property
    def left_out(self) -> dict[str, int]:
        """How many samples of a curve were left out as glitches, by name, where there are any.

        Where samples were averaged, all those of a mean that was left out count.
        """
        counts: Counter[str] = Counter()
        for record, mask in zip(self.records, self.kept, strict=False):
            counts[record.name] += record.glitches + record.coarse * int((~mask).sum())
        return {name: count for name, count in counts.items() if count}

    @property
    def tie(self) -> float:
        """By how much log10 evidence an explanation has to lead."""
        return tie_of(self.records)


def tie_of(records: Sequence[Record]) -> float:
    """Return by how much log10 evidence an explanation of these has to lead."""
    conditions = {record.condition for record in records}
    return NAMES.lone_tie if len(conditions) == 1 else NAMES.tie


def behind_best(candidates: Sequence[Candidate], own: Collection[str]) -> list[float | None]:
    """Return by how much log10 evidence each is behind the best of them.

    None of a motion that each curve has for itself: it counts with the errors, and what is said of
    its evidence is that of the model as it is.
    """
    pairs = [(c, is_motion(c, own)) for c in candidates]
    best = max((c.log10_evidence for c, moves in pairs if not moves), default=0.0)
    return [None if moves else best - c.log10_evidence for c, moves in pairs]


def is_motion(one: Candidate, own: Collection[str]) -> bool:
    """Return whether what an explanation adds is a motion that each curve has for itself."""
    added = (get_effect(name) for name in one.effects if name not in own)
    return any(isinstance(e, LearnedEffect) and e.own_of_each for e in added)


def outdone(candidates: Sequence[Candidate]) -> bool:
    """Return whether what leaves more than noise is 20 times likelier than all that do not."""
    good = [c.log10_evidence for c in candidates if c.adequate]
    others = [c.log10_evidence for c in candidates if not c.adequate]
    return bool(good) and max(others, default=-math.inf) >= max(good) + NAMES.tie


def may_still_win(
    candidates: Sequence[Candidate],
    gains: Callable[[Candidate, Candidate], float] = lambda one, best: 0.0,
) -> list[Candidate]:
    """Return the explanations that may still win, the best first; none where nothing is seen.

    The best one with another effect is no other explanation, unless it `gains` enough over the
    best: the errors of that may then be what it does.
    """
    good = sorted((c for c in candidates if c.adequate), key=lambda c: -c.log10_evidence)
    if not good or good[0].log10_evidence < NAMES.tie:
        return []
    best, least = good[0], good[0].log10_evidence - SEARCH.doubt
    return [
        c
        for c in good
        if c.log10_evidence > least
        and (not set(best.effects) < set(c.effects) or gains(c, best) > SEARCH.behind)
    ]


def with_members(leading: Sequence[Candidate], candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return what leads, and what explains with a part of the effects of one of these.

    It may be far behind for where its fit ended by other errors, and leave nothing to add: a lag
    was so by 17 of log10 evidence behind itself with any second effect.
    """
    others = [c for c in candidates if c.adequate and c not in leading]
    members = [c for c in others if any(set(c.effects) < set(one.effects) for one in leading)]
    return [*leading, *members]


def best_fitting(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return what comes nearest, and is begun elsewhere as well."""
    return sorted(candidates, key=lambda c: c.fit.cost)[: SEARCH.again]


def best_of_each(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return of each explanation the best fit."""
    found: dict[frozenset[str], Candidate] = {}
    for one in candidates:
        names = frozenset(one.effects)
        if names not in found or one.fit.cost < found[names].fit.cost:
            found[names] = one
    return list(found.values())
