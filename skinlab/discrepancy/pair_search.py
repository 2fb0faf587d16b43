"""Pairs of effects: which are worth a fit, where they are begun, and what else might be as good."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.campaign_errors import Linearised
from skinlab.discrepancy.candidates import Candidate, best_fitting, best_of_each, outdone
from skinlab.discrepancy.fit import NO_LIMIT, Fit, Fitter, Limit
from skinlab.discrepancy.race import Race
from skinlab.discrepancy.screen import NOT_HELD, Signature, linear_pairs
from skinlab.discrepancy.search_workers import (
    fit_elsewhere,
    fit_from,
    fit_on,
    unscreened_start,
)
from skinlab.discrepancy.settings import ERRORS, FITS, NAMES, SEARCH
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.inference.error_choice import ErrorChoice

Array = NDArray[np.float64]


_Promises = dict[str, tuple[Fit, Signature] | None]


class Singles(Protocol):
    """What pairs ask of the search whose single effects they are beside."""

    fitter: Fitter
    unknowns: Unknowns
    own: tuple[str, ...]
    library: list[str]
    looks: list[tuple[Fit, ErrorChoice]]
    progress: Callable[[str], None]

    def linear(self, fit: Fit) -> Linearised:
        """Return an explanation about its fit."""

    def look_of(self, fit: Fit) -> ErrorChoice:
        """Return the errors as an explanation sees them; those that are known are kept."""

    def gains_by_its_own_errors(self, fit: Fit, others: Sequence[Linearised]) -> list[float]:
        """Return twice the log evidence of others over a fit, each by errors like that one's."""


class PairSearch:
    """Pairs of effects beside a search's single ones."""

    def __init__(self, search: Singles, race: Race) -> None:
        """Take the search whose single effects these are beside, and its race."""
        self._search, self._race, self._own = search, race, search.own
        # What was promised beside fits and their looks, by their addresses, and what these are of.
        self._promised: dict[tuple[int, int], tuple[Fit, ErrorChoice | None, _Promises]] = {}
        self._alone: set[str] = set()  # single effects that were begun where a pair ended

    def beside(
        self,
        singles: list[Candidate],
        most: int,
        least: float,
        signatures: Mapping[str, Signature] | None = None,
        known: Sequence[Candidate] = (),
        partners: int = SEARCH.partners,
    ) -> list[Candidate]:
        """Return pairs of those singles that are `leading`, so many of them by their evidence.

        Each gets partners that gain `least`, so many `partners` at most. With the signatures of
        single effects all their pairs are screened as well. What is `known` is not fitted again.
        """
        fitted_already = {frozenset(c.effects[len(self._own) :]) for c in known}
        leaders = leading(singles, most)
        tasks: dict[frozenset[str], tuple[Fit, Signature]] = {}
        for leader in leaders:
            mine = leader.effects[-1]
            self._search.progress(f"looking for a partner of {mine}")
            promised = self._partners([n for n in self._search.library if n != mine], leader)
            new = [
                (fit, s) for fit, s in promised
                if leader.fit.cost - (fit.cost - s.gain) > least
                and frozenset((mine, s.effect)) not in fitted_already
            ]  # fmt: skip
            for fit, s in new[:partners]:
                expected = fit.cost - s.gain
                names = frozenset((mine, s.effect))
                if names not in tasks or expected < tasks[names][0].cost - tasks[names][1].gain:
                    tasks[names] = fit, s
        ranked = sorted(tasks.values(), key=lambda t: t[0].cost - t[1].gain)[: SEARCH.most_pairs]
        costs = {frozenset((f.effects[-1], s.effect)): f.cost - s.gain for f, s in ranked}
        linear: list[tuple[Unknowns, Array]] = []
        if signatures:
            screened = linear_pairs(self._search.fitter, self._race.base.fit, signatures)
            others = [
                pair
                for pair in screened
                if frozenset(pair.names) not in fitted_already | costs.keys()
            ]
            # Beside a leader that ended in a wrong valley the right partner promises little: of a
            # tension and a thickness 107, where from the base both promised all.
            for pair in screened:
                names, expected = frozenset(pair.names), self._race.base.fit.cost - pair.gain
                if names not in fitted_already:
                    costs[names] = min(costs.get(names, expected), expected)
            chosen = sorted(costs, key=lambda names: costs[names])[: SEARCH.most_pairs]
            ranked = [t for t in ranked if frozenset((t[0].effects[-1], t[1].effect)) in chosen]
            linear = [pair.task for pair in others if frozenset(pair.names) in chosen]
        if not ranked and not linear:
            return []
        told = [f"{f.effects[-1]} and {s.effect}" for f, s in ranked]
        told += [" and ".join(u.effects[len(self._own) :]) for u, _ in linear]
        self._search.progress("fitting pairs: " + ", ".join(told))
        served = [*singles, *known]
        fitted = self._race.run(ranked, served)
        for i in range(0, len(linear), SEARCH.abreast):
            limit = self._race.limit([*served, *fitted])
            here = linear[i : i + SEARCH.abreast]
            fitted += self._race.fitted(fit_from, [(*task, limit) for task in here])
        return fitted

    def among(
        self,
        singles: list[Candidate],
        signatures: Mapping[str, Signature],
        candidates: Sequence[Candidate],
    ) -> list[Candidate]:
        """Return all pairs that are worth a fit.

        What comes nearest alone need not be one of the two.
        """
        pairs = self.beside(singles, SEARCH.leaders, SEARCH.seen, signatures, candidates)
        pairs += self._nested(singles, pairs)
        pairs += self._gone_on([*candidates, *pairs])
        return pairs + self._further(singles, [*candidates, *pairs])

    def _partners(self, library: list[str], leader: Candidate) -> list[tuple[Fit, Signature]]:
        """Return a leader's fits and what effects promise beside them, the most promising first."""
        look = next((e for fit, e in self._search.looks if fit is leader.fit), None)
        at = (id(leader.fit), id(look))
        known = self._promised.setdefault(at, (leader.fit, look, {}))[2]
        new = [n for n in library if n not in known]
        if new:
            known |= {**dict.fromkeys(new), **self._promises(new, leader, look)}
        found = [promise for n in library if (promise := known[n]) is not None]
        return sorted(found, key=lambda t: t[0].cost - t[1].gain)

    def _promises(
        self, library: list[str], leader: Candidate, look: ErrorChoice | None
    ) -> dict[str, tuple[Fit, Signature]]:
        """Return for effects a leader's fit and what they promise beside it; of several the best.

        Of those that cannot be screened there is none.
        """
        found, _ = self._race.screen(leader.fit, library, None if look is None else look.mode)
        if look is not None:
            # These may have taken up what the partner does; what repeats say has not.
            found = self._by_errors_of_both(leader.fit, look, found)
            by_repeats, _ = self._race.screen(leader.fit, library)
            found = {
                n: max(s, found.get(n, s), key=attrgetter("gain")) for n, s in by_repeats.items()
            }
        promised = {n: (leader.fit, s) for n, s in found.items()}
        for held in self._race.held(leader.fit):
            for n, s in self._race.screen(held, library)[0].items():
                fit, seen = promised.get(n, (held, s))
                if held.cost - s.gain <= fit.cost - seen.gain:
                    promised[n] = held, s
        return promised

    def _by_errors_of_both(
        self, leader: Fit, look: ErrorChoice, found: Mapping[str, Signature]
    ) -> dict[str, Signature]:
        """Return partners' signatures with what they gain by the errors that both need, if more.

        Errors that one effect alone needs are wider than those of both: a slip of 41 µm gained 6
        beside a thickness, and 33 by those of both.
        """
        alone = self._search.linear(leader)
        seen = {n: s for n, s in found.items() if s.gain > SEARCH.partly}
        n = look.mode.count
        columns = [
            s.axes[s.which].prior[1] * look.mode.colour(s.direction[:n]) for s in seen.values()
        ]
        gains = self._search.gains_by_its_own_errors(
            leader, [alone.beside(c[:, None]) for c in columns]
        )
        told = {
            n: replace(s, gain=max(s.gain, gain))
            for (n, s), gain in zip(seen.items(), gains, strict=True)
        }
        return {**found, **told}

    def _nested(
        self,
        singles: Sequence[Candidate],
        pairs: Sequence[Candidate],
    ) -> list[Candidate]:
        """Return those pairs again that fit worse than one of their members alone, begun at that.

        With a second effect nothing fits worse: such a fit has not found its optimum. It ends early
        where something else explains.
        """
        limit = self._race.limit([*singles, *pairs])
        found = []
        for pair in pairs:
            names = pair.effects[len(self._own) :]
            alone = [c for c in singles if c.effects[-1] in names]
            member = min(alone, key=lambda c: c.fit.cost, default=pair)
            if member.fit.cost >= pair.fit.cost - FITS.gain:
                continue
            partner = [n for n in names if n != member.effects[-1]]
            self._search.progress(
                f"fitting {' and '.join(names)} again, from {member.effects[-1]} alone"
            )
            seen, _ = self._race.screen(member.fit, partner)
            found += self._race.fits([(member.fit, s) for s in seen.values()], limit)
        return found

    def _gone_on(self, known: Sequence[Candidate]) -> list[Candidate]:
        """Return the pairs that come nearest, fitted further, where none explains without doubt.

        A narrow valley takes more anchors than a fit has while others are in the race; and the law
        may have ended in another valley with one of the two alone.
        """
        pairs = [c for c in known if len(c.effects) - len(self._own) > 1]
        if not pairs or _without_doubt(known):
            return []
        self._search.progress("going on with the pairs that come nearest")
        near = best_fitting(pairs)
        return self._race.fitted(fit_on, [c.fit for c in near])

    def _further(
        self,
        singles: Sequence[Candidate],
        known: Sequence[Candidate],
    ) -> list[Candidate]:
        """Return more pairs where none explains without doubt: of the halves of the best one.

        What the screen expects of a strong partner may be far off; of these halves the next best
        partners are fitted. One that takes away much less than the other is not asked.
        """
        pairs = [c for c in known if len(c.effects) - len(self._own) > 1]
        if not pairs or _without_doubt(known):
            return []
        best = min(pairs, key=lambda c: c.fit.cost)
        halves = [c for c in singles if c.effects[-1] in best.effects]
        gained = {c.effects: self._race.base.fit.cost - c.fit.cost for c in halves}
        least = SEARCH.half * max(gained.values(), default=0.0)
        halves = [c for c in halves if gained[c.effects] >= least]
        found = self.beside(halves, 2, SEARCH.seen, known=known, partners=SEARCH.most_pairs)
        return found if _without_doubt(found) else found + self._unseen(halves, [*known, *found])

    def _unseen(self, halves: Sequence[Candidate], known: Sequence[Candidate]) -> list[Candidate]:
        """Return pairs with what could not be screened beside a half, begun with another law.

        The half alone may have ended where the partner has no model: a creep without its stiffening
        did at a skin so soft that none held, and all that led was 190 decades behind both.
        """
        fitted = {frozenset(c.effects) for c in known}
        tasks = []
        for half in halves:
            library = [
                n for n in self._search.library
                if n not in half.effects and frozenset((*half.effects, n)) not in fitted
            ]  # fmt: skip
            seen = {s.effect for _, s in self._partners(library, half)}
            # A plugin that broke down is not asked again.
            _, why = self._race.screen(half.fit, [n for n in library if n not in seen])
            unheld = [n for n in why if why[n] == NOT_HELD]
            tasks += [(*unscreened_start(half.fit, n), NO_LIMIT) for n in unheld]
        if not tasks:
            return []
        told = ", ".join(" and ".join(u.effects[len(self._own) :]) for u, *_ in tasks)
        self._search.progress(f"fitting what could not be screened: {told}")
        return self._race.fitted(fit_from, tasks)

    def members(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Return fits of the single effects of pairs that explain, begun where the pair ended.

        Where a pair leads. A strong effect changes the skin as well: from the base model's optimum
        its fit may not find there, and then needs a partner that it has not; one that the screen
        passed over was not fitted at all. An effect is asked once, and again only what leads then:
        a stiffening that was given up, since a gain explained, led beside a preload among `rivals`.
        """
        best = self._leading_pair(candidates)
        if best is None or self._alone.issuperset(best.effects[len(self._own) :]):
            return []
        tasks: dict[tuple[str, ...], tuple[Unknowns, Array]] = {}
        for pair in sorted(candidates, key=lambda c: c.fit.cost):
            if pair.adequate and len(pair.effects) - len(self._own) > 1:
                for name in pair.effects[len(self._own) :]:
                    if name in self._alone:
                        continue
                    alone = self._search.unknowns.with_effect(name)
                    start = alone.among(pair.fit.unknowns, pair.fit.u)
                    tasks.setdefault(alone.effects, (alone, start))
        found = list(tasks.values())[: SEARCH.members]
        if found:
            self._search.progress("fitting the members of pairs alone")
            self._alone |= {unknowns.effects[-1] for unknowns, _ in found}
        fitted = self._race.fitted(fit_from, [(*task, NO_LIMIT) for task in found])
        return [c for c in fitted if c.adequate]

    def rivals(self, candidates: list[Candidate]) -> list[Candidate]:
        """Return the candidates; where a pair leads, with pairs of other single effects.

        Beside one member's fit the right partner may seem to gain nothing: what both change of the
        skin lies around a bend. So the most promising partners of other single effects are tried,
        the members among them: a layer that explained alone stood in for a tension and a preload.
        And where a member alone explains, others are put in the place of its partner.
        """
        best = self._leading_pair(candidates)
        if best is None:
            return candidates
        members = best.effects[len(self._own) :]
        alone = [
            c for c in candidates
            if len(c.effects) - len(self._own) == 1 and c.effects[-1] not in members
        ]  # fmt: skip
        known = {frozenset(c.effects) for c in candidates}
        tasks = []
        for other in sorted(alone, key=lambda c: -c.log10_evidence)[: SEARCH.rivals]:
            library = [
                n for n in self._search.library
                if n in members or frozenset((*other.effects, n)) not in known
            ]  # fmt: skip
            tasks += self._partners(library, other)
        tasks.sort(key=lambda t: t[0].cost - t[1].gain)
        tasks = [
            *tasks[: SEARCH.rival_pairs],
            *self._of_its_half(best, candidates),
            *self._in_place_of(best, candidates),
        ]
        if not tasks:
            return candidates
        told = ", ".join(f"{f.effects[-1]} and {s.effect}" for f, s in tasks)
        self._search.progress(f"fitting its rivals: {told}")
        found = self._race.fits(tasks, Limit.at(best.fit.cost + SEARCH.far))
        return best_of_each([*candidates, *found])

    def _of_its_half(
        self, best: Candidate, candidates: Sequence[Candidate]
    ) -> list[tuple[Fit, Signature]]:
        """Return the next partners of that member of a pair which alone comes nearest.

        Where it takes nearly all of the gap its fit has gone far for the rest: of a fat layer that
        took 99 % five partners promised more than the tension that was right by 7 decades.
        """
        members = best.effects[len(self._own) :]
        alone = [c for c in candidates if c.effects[len(self._own) :] in [(n,) for n in members]]
        half = min(alone, key=lambda c: c.fit.cost, default=None)
        if half is None:
            return []
        known = {frozenset(c.effects) for c in candidates}
        library = [n for n in self._search.library if frozenset((*half.effects, n)) not in known]
        promised = self._partners([n for n in library if n not in members], half)
        return [
            (fit, s) for fit, s in promised if half.fit.cost - (fit.cost - s.gain) > SEARCH.seen
        ][: SEARCH.rival_pairs]

    def _in_place_of(
        self, best: Candidate, candidates: Sequence[Candidate]
    ) -> list[tuple[Fit, Signature]]:
        """Return what may stand in for either member of a pair, beside the other one alone.

        By the errors that the pair needs. Little has to be promised: of a slip beside a creep 4 was
        seen, and it was as likely as a number for each opening, which had led by 57.
        """
        members = best.effects[len(self._own) :]
        known = {frozenset(c.effects) for c in candidates}
        errors = self._search.look_of(best.fit).mode
        found: list[tuple[Fit, Signature]] = []
        for one in candidates:
            if not one.adequate or not set(one.effects) < set(best.effects):
                continue
            library = [
                n for n in self._search.library
                if n not in members and frozenset((*one.effects, n)) not in known
            ]  # fmt: skip
            seen, _ = self._race.screen(one.fit, library, errors)
            found += [(one.fit, s) for s in seen.values() if s.gain > SEARCH.seen_curved]
        return sorted(found, key=lambda t: -t[1].gain)[: SEARCH.rival_pairs]

    def every_single(
        self,
        chosen: Sequence[Signature],
        singles: Sequence[Candidate],
        candidates: Sequence[Candidate],
    ) -> list[Candidate]:
        """Return single effects that explain, begun elsewhere, where a pair leads alone.

        Two effects with many ways to bend fill in for a strong one whose fit ended at a wall. The
        `singles` that came nearest were begun elsewhere before.
        """
        if self._leading_pair(candidates) is None or any(
            c.adequate and len(c.effects) - len(self._own) == 1 for c in candidates
        ):
            return []
        self._search.progress("fitting every single effect from elsewhere")
        begun = (
            set() if self._race.base.adequate else {c.effects[-1] for c in best_fitting(singles)}
        )
        tasks = [(self._race.base.fit, s, None) for s in chosen if s.effect not in begun]
        return [c for c in self._race.fitted(fit_elsewhere, tasks) if c.adequate]

    def one_is_enough(self, candidates: Sequence[Candidate]) -> bool:
        """Return whether a single effect explains the curves, and no pair does far better.

        One with a number for each opening is no simpler than a pair, and may stand for any: it has
        to lead by no more than a tie. One that is less likely than what leaves more than noise
        stands for something else; one that leaves what chance hardly does may lack a partner.
        """
        good = [c for c in candidates if c.adequate]

        def numbers(one: Candidate) -> int:
            return sum(a.effect == one.effects[-1] for a in one.fit.unknowns.axes)

        alone = [c for c in good if len(c.effects) - len(self._own) == 1]
        single = [
            c.log10_evidence
            for c in alone
            if numbers(c) < SEARCH.as_a_pair and c.left.p_value >= ERRORS.no_doubt
        ]
        as_pairs = [c.log10_evidence for c in alone if numbers(c) >= SEARCH.as_a_pair]
        pairs = [c.log10_evidence for c in good if len(c.effects) - len(self._own) > 1]
        simplest = max(single, default=0.0)
        return (
            bool(single)
            and max(pairs, default=0.0) - simplest < SEARCH.not_enough
            and max(as_pairs, default=0.0) - simplest < NAMES.tie
            and not outdone(candidates)
        )

    def _leading_pair(self, candidates: Sequence[Candidate]) -> Candidate | None:
        """Return the candidate that explains best, if it is a pair."""
        good = (c for c in candidates if c.adequate)
        best = max(good, key=lambda c: c.log10_evidence, default=None)
        return best if best is not None and len(best.effects) - len(self._own) > 1 else None


def _without_doubt(candidates: Sequence[Candidate]) -> bool:
    """Return whether something leaves what chance does often.

    A tension and a layer left what it does in one of 700, and stood in for a layer with one below.
    """
    return any(c.left.p_value >= ERRORS.no_doubt for c in candidates)


def leading(singles: Sequence[Candidate], most: int) -> list[Candidate]:
    """Return the likeliest single effects, that which fits best, and one more that explains.

    What explains lacks little, however unlikely it is: a slip in the right valley, beside a
    stiffening, was ten decades behind what bent a sensor.
    """
    ranked = sorted(singles, key=lambda c: -c.log10_evidence)
    found = ranked[:most]
    found += [c for c in best_fitting(singles)[:1] if c not in found]
    return found + [c for c in ranked if c.adequate and c not in found][:1]


def beside_which(singles: Sequence[Candidate], best: float) -> list[Candidate]:
    """Return the single effects that get partners where one explains, with this log10 evidence.

    The likeliest, and of those that explain the one that fits best. What leaves more than noise and
    is as likely may be one half of the truth: a layer on top stood in for a layer below in a skin
    that is thicker than stated.
    """
    near = [c for c in singles if c.log10_evidence > best - SEARCH.not_enough]
    near.sort(key=lambda c: -c.log10_evidence)
    explaining = [c for c in near if c.adequate]
    leaving = [c for c in near if not c.adequate]
    found = explaining[: SEARCH.beside]
    found += [c for c in best_fitting(explaining)[:1] if c not in found]
    return found + leaving[: SEARCH.halves]
