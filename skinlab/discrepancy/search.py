"""Which explanation: the base model, every effect that the screen lets through, then pairs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.adequacy import ADEQUATE, Residual, look
from skinlab.discrepancy.fit import Fit, Fitter
from skinlab.discrepancy.records import Record
from skinlab.discrepancy.screen import Signature
from skinlab.discrepancy.search_workers import (
    fit_elsewhere,
    fit_from,
    fit_one,
    signature_of,
)
from skinlab.discrepancy.unknowns import BasePrior, Known, Unknowns
from skinlab.errors import NotTrustworthyError
from skinlab.mechanics.effects import effect_names
from skinlab.mechanics.model_file import BASE, Model, Normal
from skinlab.workers import Pool

Array = NDArray[np.float64]
Progress = Callable[[str], None]

LOG10 = math.log(10.0)
TIE = 1.3  # log10 evidence: 20 to 1
LONE_TIE = 4.0  # the same of one condition alone, where no other one bears an explanation out

# Before the data: no effect as likely as one of the library, two together a fifth of that.
_PAIRS_ODDS = 0.2
_SEEN = 8.0  # a gain of χ² by which an effect is worth a fit
_BEHIND = 18.0  # the same for a second one: 20 : 1, the odds of pairs, and what a prior costs
_SHARE = 0.04  # or of the largest gain, where the misfit is large
_RIVAL = 0.5
_FAR = 20.0  # a cost so much above that of an explanation, and a tenth of what that one gained,
_FAR_SHARE = 0.1  # is out of the race
_MOST_SINGLES = 8
_PARTNERS = 5  # of each of the best singles
_LEADERS = 4
_AGAIN = 2  # effects that explain nothing, but most, are fitted from elsewhere too
_MEMBERS = 4  # of pairs that explain, to be tried alone
# Shares of the law's ranges from which the base model is fitted: of the scale, of other logarithms,
# of what is none; and the middle, from which it is fitted with effects.
_SCALES = (0.375803649418, 0.563705474127, 0.783536516671)
_RATIOS, _VALUES = (0.538508052478, 0.749009372356), (0.275862068966, 0.758620689655)
_MIDDLE = (0.563705474127, 0.617446047432, 0.448275862069)


@dataclass(frozen=True, eq=False)
class Candidate:
    """An explanation with its fit, what it leaves, and its evidence against no effect."""

    fit: Fit
    left: Residual
    log10_evidence: float  # of the data and the prior odds, relative to the base model

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects of the explanation beyond the model's own."""
        return self.fit.effects

    @property
    def adequate(self) -> bool:
        """Whether what it leaves may well be noise."""
        return self.left.p_value >= ADEQUATE


@dataclass(eq=False)
class Partial:
    """What is known so far, for whoever interrupts."""

    base: Candidate | None = None
    candidates: list[Candidate] = field(default_factory=list)


def unknowns_of(model: Model) -> Unknowns:
    """Return the unknowns of a model, with what it says of its effects as their priors."""
    known, space = [], model.space
    for name, ranges in model.effects.items():
        for parameter, at in ranges.items():
            sd = at.prior.sd if isinstance(at.prior, Normal) else 0.0
            known.append(Known(name, parameter, at.value, sd))
    priors = tuple(
        BasePrior(i, prior.mean, prior.sd)
        for i, name in enumerate(space.names)
        if isinstance(prior := model.prior(name), Normal)
    )
    return Unknowns(
        tuple(sorted(model.effects)), model.model.kappa, tuple(known), model.model.law,
        space if model.parameters else None, priors,
    )  # fmt: skip


def _starts(unknowns: Unknowns) -> tuple[list[Array], Array]:
    """Return coordinates of the law's parameters to begin from, and their middle."""
    space = unknowns.space
    kinds = [
        0 if i == space.scale else 1 if transform != "linear" else 2
        for i, transform in enumerate(space.transforms)
    ]
    shares = [(_SCALES, _RATIOS, _VALUES)[kind] for kind in kinds]
    middle = unknowns.at_share(np.array([_MIDDLE[kind] for kind in kinds]))
    return [unknowns.at_share(np.array(share)) for share in product(*shares)], middle


@dataclass(frozen=True, eq=False)
class Found:
    """What the search came to."""

    base: Candidate
    signatures: dict[str, Signature]  # of single effects at the base fit
    candidates: list[Candidate] = field(default_factory=list)  # the best first
    records: Sequence[Record] = ()  # what was explained
    not_screened: dict[str, str] = field(default_factory=dict)  # effect -> why it was not

    @property
    def tie(self) -> float:
        """By how much log10 evidence an explanation has to lead."""
        conditions = {record.condition for record in self.records}
        return LONE_TIE if len(conditions) == 1 else TIE


class Search:
    """Explains one campaign, starting from a model that may have effects already."""

    def __init__(
        self,
        fitter: Fitter,
        *,
        model: Model = BASE,
        workers: int = 1,
        progress: Progress = lambda _: None,
        partial: Partial | None = None,
    ) -> None:
        self._fitter = fitter
        self._unknowns = unknowns_of(model)
        self._own = self._unknowns.effects
        self._workers, self._progress, self._partial = workers, progress, partial
        self._library = [n for n in effect_names() if n not in self._own]

    def base(self) -> Candidate:
        """Return the fit of the model as it is.

        Raises:
            NotTrustworthyError: it has no answer at all for these curves.
        """
        unknowns = self._unknowns
        plain = unknowns.plain
        begin, middle = _starts(unknowns)
        fits = [f for f in (self._fitter.fit(plain, start) for start in begin) if f is not None]
        if self._own:
            # Finite elements cost more: from the best of the plain fits, and from the middle.
            fits.sort(key=lambda f: f.cost)
            starts = [*(f.u for f in fits[:1]), middle]
            found = (self._fitter.fit(unknowns, unknowns.start(start)) for start in starts)
            fits = [f for f in found if f is not None]
        if not fits:
            raise NotTrustworthyError("the model has no answer for these curves")
        return self._candidate(min(fits, key=lambda f: f.cost), None)

    def run(self) -> Found:
        """Return the base fit, the screen and the candidates."""
        # The processes start while the base model is fitted here
        with Pool(self._workers, self._fitter) as pool:
            self._progress("fitting the model as it is")
            base = self.base()
            if self._partial is not None:
                self._partial.base = base
            self._progress(f"screening {len(self._library)} effects")
            signatures, not_screened = self._screen(pool, base.fit, self._library)
            chosen = _worth(signatures.values())
            if not chosen and not base.adequate:  # how close the best comes is told all the same
                chosen = sorted(signatures.values(), key=lambda s: -s.gain)[:2]
            singles: list[Candidate] = []
            if chosen:
                self._progress(f"fitting {', '.join(s.effect for s in chosen)}")
                singles = self._singles(pool, base, chosen)
            if self._partial is not None:
                self._partial.candidates = singles
            candidates = singles
            explaining = [c for c in singles if c.adequate]
            if explaining:
                # Something weaker may hide behind what explains nearly all.
                candidates = singles + self._pairs(pool, base, explaining, 1, _BEHIND)
            elif not base.adequate:
                pairs = self._pairs(pool, base, singles, _LEADERS, _SEEN)
                candidates = self._members(pool, base, pairs) + pairs
                named = {c.effects for c in candidates}
                candidates += [c for c in singles if c.effects not in named]
        candidates.sort(key=lambda c: -c.log10_evidence)
        not_screened |= dict.fromkeys(self._own, "the model has it already")
        return Found(base, signatures, candidates, self._fitter.records, not_screened)

    def _singles(self, pool: Pool, base: Candidate, chosen: list[Signature]) -> list[Candidate]:
        """Return fits of single effects: of the lesser ones only where the likely explain nothing.

        An effect of which the screen expects less than half of what another one, that explains the
        curves, takes away is no rival.
        """
        likely = [s for s in chosen if s.gain >= _RIVAL * chosen[0].gain]
        found = self._race(pool, base, [(base.fit, s) for s in likely])
        if not any(c.adequate for c in found):
            found += self._race(pool, base, [(base.fit, s) for s in chosen[len(likely) :]])
        if base.adequate or any(c.adequate for c in found):
            return found
        return self._elsewhere(pool, base, chosen, found)

    def _elsewhere(
        self, pool: Pool, base: Candidate, chosen: list[Signature], found: list[Candidate]
    ) -> list[Candidate]:
        """Return the fits, those that came nearest begun elsewhere as well, if that is better.

        A strong effect changes the skin beyond what is linear: a fit from the base model's optimum
        may end at a wall of skins that crease.
        """
        seen = {s.effect: s for s in chosen}
        nearest = sorted(found, key=lambda c: c.fit.cost)[:_AGAIN]
        tasks = [(base.fit, seen[c.effects[-1]]) for c in nearest]
        better = {}
        for fit in pool.map(fit_elsewhere, tasks):
            if fit is not None:
                better[fit.effects] = self._candidate(fit, base)
        return [
            better[c.effects]
            if c.effects in better and better[c.effects].fit.cost < c.fit.cost
            else c
            for c in found
        ]

    def _race(
        self, pool: Pool, base: Candidate, tasks: Sequence[tuple[Fit, Signature]]
    ) -> list[Candidate]:
        """Return fits: the two likeliest, then the others, which end early where those explain."""
        found = self._fits(pool, base, tasks[:2])
        serving = [c.fit.cost for c in found if c.adequate]
        limit = math.inf
        if serving:
            limit = min(serving) + _FAR + _FAR_SHARE * max(0.0, base.fit.cost - min(serving))
        return found + self._fits(pool, base, tasks[2:], limit)

    def _pairs(
        self, pool: Pool, base: Candidate, singles: list[Candidate], most: int, least: float
    ) -> list[Candidate]:
        """Return pairs of the best singles, at most so many, with partners that gain so much."""
        leaders = sorted(singles, key=lambda c: -c.log10_evidence)[:most]
        tasks: dict[frozenset[str], tuple[Fit, Signature]] = {}
        for leader in leaders:
            mine = leader.effects[-1]
            self._progress(f"looking for a partner of {mine}")
            others = [n for n in self._library if n != mine]
            found, _ = self._screen(pool, leader.fit, others)
            for s in sorted(found.values(), key=lambda s: -s.gain)[:_PARTNERS]:
                expected = leader.fit.cost - s.gain
                names = frozenset((mine, s.effect))
                if s.gain > least and (
                    names not in tasks or expected < tasks[names][0].cost - tasks[names][1].gain
                ):
                    tasks[names] = leader.fit, s
        ranked = sorted(tasks.values(), key=lambda t: t[0].cost - t[1].gain)[:8]
        if not ranked:
            return []
        self._progress(
            "fitting pairs: " + ", ".join(f"{f.effects[-1]} and {s.effect}" for f, s in ranked)
        )
        return self._race(pool, base, ranked)

    def _members(self, pool: Pool, base: Candidate, pairs: Sequence[Candidate]) -> list[Candidate]:
        """Return fits of the single effects of pairs that explain, begun where the pair ended.

        A strong effect changes the skin as well: from the base model's optimum its fit may not find
        there, and then needs a partner that it has not.
        """
        tasks: dict[tuple[str, ...], tuple[Unknowns, Array]] = {}
        for pair in sorted(pairs, key=lambda c: c.fit.cost):
            if pair.adequate:
                for name in pair.effects[len(self._own) :]:
                    alone = self._unknowns.with_effect(name)
                    start = alone.among(pair.fit.unknowns, pair.fit.u)
                    tasks.setdefault(alone.effects, (alone, start))
        found = list(tasks.values())[:_MEMBERS]
        if found:
            self._progress("fitting the members of pairs alone")
        fits = [fit for fit in pool.map(fit_from, found) if fit is not None]
        return [c for c in (self._candidate(fit, base) for fit in fits) if c.adequate]

    def _screen(
        self, pool: Pool, fit: Fit, names: Sequence[str]
    ) -> tuple[dict[str, Signature], dict[str, str]]:
        """Return the effects' signatures, and why others have none."""
        found = list(
            zip(names, pool.map(signature_of, [(fit, name) for name in names]), strict=True)
        )
        return (
            {name: s for name, s in found if isinstance(s, Signature)},
            {name: why for name, why in found if isinstance(why, str)},
        )

    def _fits(
        self,
        pool: Pool,
        base: Candidate,
        tasks: Sequence[tuple[Fit, Signature]],
        limit: float = math.inf,
    ) -> list[Candidate]:
        found = []
        for fit in pool.map(fit_one, [(*task, limit) for task in tasks]):
            if fit is not None:
                found.append(self._candidate(fit, base))
        return found

    def _candidate(self, fit: Fit, base: Candidate | None) -> Candidate:
        left = look(
            self._fitter.records, self._fitter.errors, fit.deflections_mm, len(fit.unknowns)
        )
        if base is None:
            return Candidate(fit, left, 0.0)
        added = len(fit.effects) - len(self._own)
        n = len(self._library)
        odds = 1.0 / n if added == 1 else _PAIRS_ODDS / (0.5 * n * (n - 1))
        relative = (fit.log_evidence - base.fit.log_evidence) / LOG10 + math.log10(odds)
        return Candidate(fit, left, relative)


def _worth(signatures: Iterable[Signature]) -> list[Signature]:
    ranked = sorted(signatures, key=lambda s: -s.gain)
    largest = ranked[0].gain if ranked else 0.0
    return [s for s in ranked if s.gain > max(_SEEN, _SHARE * largest)][:_MOST_SINGLES]
