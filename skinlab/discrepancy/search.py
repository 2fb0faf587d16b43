"""Which explanation: the base model, every effect that the screen lets through, then pairs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.adequacy import judge, look
from skinlab.discrepancy.campaign_errors import (
    CampaignErrors,
    Linearised,
    learn,
    likeliest,
    outliers,
    pure_error,
    size_um,
)
from skinlab.discrepancy.candidates import (
    LOG10,
    Candidate,
    Found,
    Partial,
    best_fitting,
    best_of_each,
    may_still_win,
    outdone,
)
from skinlab.discrepancy.fit import NO_LIMIT, Fit, Fitter, Limit
from skinlab.discrepancy.placement_curves import bends_mm, thickness_slopes
from skinlab.discrepancy.records import Record, by_condition, without
from skinlab.discrepancy.screen import Signature, linear_pairs, worth_fitting
from skinlab.discrepancy.search_workers import (
    fit_by,
    fit_elsewhere,
    fit_from,
    fit_one,
    off_the_wall,
    signature_by,
    signature_of,
)
from skinlab.discrepancy.settings import ERRORS, FITS, NAMES, SEARCH
from skinlab.discrepancy.starts import middle_of, starts, unknowns_of, with_thickness
from skinlab.discrepancy.table_domes import TableDomes
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.errors import NotTrustworthyError
from skinlab.inference.covariance import Covariance
from skinlab.inference.error_choice import ErrorChoice
from skinlab.mechanics.effects import get_effect, library_names
from skinlab.mechanics.fem.skin import SkinProblem
from skinlab.mechanics.model_file import BASE, Model
from skinlab.workers import Pool

Array = NDArray[np.float64]
Progress = Callable[[str], None]


class Search:
    """Explains one campaign, starting from a model that may have effects already."""

    def __init__(
        self,
        fitter: Fitter,
        *,
        model: Model = BASE,
        workers: int = 1,
        noise_um: float | None = None,
        placement_scatter: float | None = None,
        progress: Progress = lambda _: None,
        partial: Partial | None = None,
    ) -> None:
        """`noise_um` and `placement_scatter` are as stated in a campaign; None: to be learned."""
        self.fitter = fitter
        self._noise_um, self._placement_scatter = noise_um, placement_scatter
        self._thickness_mm = np.zeros(0)
        self.errors: CampaignErrors | None = None  # None: those of the fitter, as they are
        self._first: tuple[ErrorChoice, ...] = ()  # pure error, and as the model as it is sees them
        self._looks: list[tuple[Fit, ErrorChoice]] = []  # and as explanations do
        self._kept: tuple[NDArray[np.bool_], ...] = ()
        self._unknowns = with_thickness(unknowns_of(model), fitter.records)
        self._own = self._unknowns.effects
        self._workers, self._progress, self._partial = workers, progress, partial
        self._library = [
            n for n in library_names() if n not in self._own and not get_effect(n).same_as
        ]

    def base(self) -> Candidate:
        """Return the fit of the model as it is.

        Raises:
            NotTrustworthyError: it has no answer at all for these curves.
        """
        unknowns = self._unknowns
        plain = unknowns.plain
        fits = self._plainly(plain, starts(unknowns))
        if self._own:
            # Finite elements cost more: from the best of the plain fits, and from the middle.
            fits.sort(key=lambda f: f.cost)
            first = [*(f.u for f in fits[:1]), middle_of(unknowns)]
            found = (self.fitter.fit(unknowns, unknowns.start(start)) for start in first)
            fits = [f for f in found if f is not None]
        if not fits:
            raise NotTrustworthyError("the model has no answer for these curves")
        return self._candidate(min(fits, key=lambda f: f.cost), None)

    def _plainly(self, plain: Unknowns, starts: Sequence[Array]) -> list[Fit]:
        """Return fits of the law alone, until so many starts have led to the best of them."""
        found: list[Fit] = []
        for start in starts:
            fit = self.fitter.fit(plain, start)
            if fit is None:
                continue
            found.append(fit)
            least = min(f.cost for f in found)
            close = FITS.gain + FITS.close_share * max(0.0, least - self.fitter.errors.count)
            if sum(f.cost < least + close for f in found) >= SEARCH.agreeing:
                break
        return found

    def run(self) -> Found:
        """Return the base fit, the screen and the candidates."""
        self._progress("fitting the model as it is")
        base = self.learned_base()
        with Pool(self._workers, self.fitter) as pool:
            self._progress(f"screening {len(self._library)} effects")
            signatures, not_screened = self._screen(pool, base.fit, self._library)
            chosen = worth_fitting(signatures.values())
            if not chosen and not base.adequate:  # how close the best comes is told all the same
                chosen = sorted(signatures.values(), key=lambda s: -s.gain)[:2]
            singles: list[Candidate] = []
            if chosen:
                self._progress(f"fitting {', '.join(s.effect for s in chosen)}")
                singles = self._singles(pool, base, chosen)
            candidates = singles
            explaining = [c for c in singles if c.adequate]
            if explaining:
                # Something weaker may hide behind what explains nearly all: behind errors, too,
                # which are as wide as pure error leaves them until an explanation tells them.
                singles = self._weighed(base, singles)
                explaining = [c for c in singles if c.adequate]
                self._base_evidence = self._roughly(base.fit)
                candidates = singles
                # Behind what is not there itself nothing hides that the base would not show.
                if not base.adequate or max(c.log10_evidence for c in explaining) > 0.0:
                    candidates = singles + self._pairs(pool, base, explaining, 1, SEARCH.behind)
            # Errors that would do for the model as it is are no answer where something is ahead.
            missing = not base.adequate or any(
                c.adequate and c.log10_evidence >= NAMES.tie for c in candidates
            )
            if missing and not self._one_is_enough(candidates):
                # What comes nearest alone need not be one of the two.
                pairs = self._pairs(
                    pool, base, singles, SEARCH.leaders, SEARCH.seen, signatures, candidates
                )
                pairs += self._nested(pool, base, singles, pairs)
                pairs += self._gone_on(pool, base, [*candidates, *pairs])
                pairs += self._further(pool, base, singles, [*candidates, *pairs])
                candidates += pairs
            candidates = best_of_each(candidates)
            candidates = best_of_each([*candidates, *self._members(pool, base, candidates)])
            candidates = self._rivals(pool, base, candidates)
            candidates += self._every_single(pool, base, chosen, singles, candidates)
            candidates = best_of_each(candidates)
            candidates = self._weighed(base, candidates, SEARCH.looks)
            candidates = self._sharpened(pool, base, candidates)
        candidates.sort(key=lambda c: -c.log10_evidence)
        for name in self._own:
            stated = any(k.effect == name and k.stated for k in self._unknowns.known)
            not_screened[name] = (
                "the stated uncertainty of the thickness is part of every explanation"
                if stated
                else "the model has it already"
            )
        return Found(
            base, signatures, candidates, self.fitter.records, not_screened, self.fitter.errors,
            self._kept, "" if self.errors is None else self.errors.implausible,
        )  # fmt: skip

    def learned_base(self) -> Candidate:
        """Return the fit of the model as it is, with the errors that repeats and roughness tell.

        Raises:
            NotTrustworthyError: it has no answer at all for these curves.
        """
        first = self.base().fit
        before, domes = self.fitter, self.fitter.domes
        linear = Linearised.of(first, before.errors, before.measured)
        bad = outliers(before.records, linear)
        self._kept = tuple(before.errors.split(~bad))
        self._progress("learning how large the errors are")
        records = creased(without(before.records, self._kept), first, domes)
        self._thickness_mm = thickness_slopes(before.records, first, domes)[~bad]
        self.errors = self._learn(records, linear.only(~bad), None)
        fit = self._refitted(records, first)
        elsewhere = off_the_wall(self.fitter, fit, NO_LIMIT)
        if elsewhere.cost < fit.cost - FITS.gain:
            # The first errors know of no places: with them the law had ended at a wall, and these
            # were learned there.
            self._thickness_mm = thickness_slopes(records, elsewhere, domes)
            self.errors = self._learn(records, self.linear(elsewhere), None)
            fit = self._refitted(records, elsewhere)
        node = self.errors.pure.nodes[0]
        pure = pure_error(records, self.linear(fit))
        thickness_mm = thickness_slopes(records, fit, domes)
        bends = bends_mm(records, fit, domes, pure, node, self._thickness_mm, thickness_mm)
        if 1e3 * max(float(np.abs(bend).max()) for bend in bends) > ERRORS.bend_um:
            records = [replace(r, bend_mm=b) for r, b in zip(records, bends, strict=True)]
            self.fitter = self.fitter.with_errors(records, self.fitter.errors)
            self._thickness_mm = thickness_mm
            self.errors = self._learn(records, self.linear(fit), None)
            fit = self._refitted(records, fit)
        self._first = self.errors.looks
        return self._candidate(fit, None)

    def _refitted(self, records: Sequence[Record], first: Fit) -> Fit:
        """Return a fit with the errors as learned, which is how all others are fitted from here."""
        assert self.errors is not None
        self.fitter = self.fitter.with_errors(records, self.errors.working)
        fit = self.fitter.fit(first.unknowns, first.u)
        if fit is None:
            raise NotTrustworthyError("the model has no answer for these curves")
        return fit

    def _learn(
        self, records: Sequence[Record], one: Linearised, before: CampaignErrors | None
    ) -> CampaignErrors:
        return learn(
            records, [one], self._thickness_mm, noise_um=self._noise_um,
            placement_scatter=self._placement_scatter, before=before,
        )  # fmt: skip

    def errors_with(self, fit: Fit) -> CampaignErrors:
        """Return the errors that were learned, with the look that this explanation gives."""
        return self._learn(self.fitter.records, self.linear(fit), self.errors)

    def linear(self, fit: Fit) -> Linearised:
        """Return an explanation about its fit."""
        return Linearised.of(fit, self.fitter.errors, self.fitter.measured)

    def _weighed(
        self, base: Candidate, candidates: list[Candidate], rivals: int = 0
    ) -> list[Candidate]:
        """Return the candidates weighed once more, with the errors as the best of them sees them.

        The errors of a wrong model are too large: looked for there alone, those of a right one
        would be missed. So `rivals` that may still win are asked as well: an explanation whose own
        errors no setting comes near loses by the integral, not by the data.
        """
        serving = [c for c in candidates if c.adequate] or candidates
        if not serving:
            return candidates
        self._progress(f"weighing {len(candidates)} explanations")
        self._look_last(max(serving, key=lambda c: c.log10_evidence).fit)
        candidates = self.weighed(base, candidates)
        for _ in range(rivals):
            near = self._doubtful(candidates)
            if not near:
                break
            self._look(near[0].fit)
            candidates = self._weighed(base, candidates)
        return candidates

    def _doubtful(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Return what may still win, and whose errors are not known; the nearest first."""
        known = {id(fit) for fit, _ in self._looks}

        def gains(one: Candidate, best: Candidate) -> float:
            if id(one.fit) in known:
                return 0.0
            by_its_own = self._gains_by_its_own_errors(best.fit, [self.linear(one.fit)])
            return max(best.fit.cost - one.fit.cost, *by_its_own)

        return [c for c in may_still_win(candidates, gains) if id(c.fit) not in known]

    def _sharpened(
        self, pool: Pool, base: Candidate, candidates: list[Candidate]
    ) -> list[Candidate]:
        """Return the candidates, those that may win fitted again by the errors of the best.

        By errors as wide as pure error leaves them a valley is flat, and a fit ends anywhere in it:
        what it is off by there counts by the errors of the best.
        """
        near = may_still_win(candidates)[: SEARCH.sharpened]
        if len(near) < 2:
            return candidates
        self._progress(f"fitting {len(near)} explanations by the errors of the best")
        assert self.errors is not None
        errors = self.errors.looks[-1].mode
        fits = pool.map(fit_by, [(c.fit, errors) for c in near])
        moved = self.weighed(base, [self._candidate(fit, base) for fit in fits])
        better = {
            id(old): new
            for old, new in zip(near, moved, strict=True)
            if new.adequate and new.log10_evidence > old.log10_evidence
        }
        if not better:
            return candidates
        return self._weighed(base, [better.get(id(c), c) for c in candidates])

    def _look(self, fit: Fit) -> ErrorChoice:
        """Return the errors as an explanation sees them; those that are known are kept."""
        for known, errors in self._looks:
            if known is fit:
                return errors
        found = self.errors_with(fit).looks[-1]
        self._looks.append((fit, found))
        return found

    def _look_last(self, fit: Fit) -> None:
        """Take the errors of all explanations that were asked, those of this one as the last."""
        last = self._look(fit)
        others = [errors for known, errors in self._looks if known is not fit]
        self.errors = CampaignErrors((*self._first, *others, last))

    def by_its_own_errors(self, found: Found) -> Found | None:
        """Return what was found, the model as it is judged by the errors that it needs itself.

        Without repeats nothing tells slow errors from what a model misses, and pure error knows of
        none. So where nothing is likelier than the model as it is, and errors no larger than usual
        would do, there is no gap. None where that is not so.
        """
        repeated = any(len(members) > 1 for members in by_condition(found.records))
        ahead = any(c.log10_evidence >= found.tie for c in found.candidates)
        if repeated or ahead or found.implausible:
            return None
        fit = found.base.fit
        own = self._look(fit)
        if any(own.median(partial(size_um, name=n)) > um for n, um in ERRORS.usual_um.items()):
            return None
        left = judge(found.records, likeliest(own), fit.deflections_mm, len(fit.unknowns))
        base = replace(found.base, left=left)
        return replace(found, base=base) if base.adequate else None

    def weighed(self, base: Candidate, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Return candidates of the library with their evidence by the errors as they are now."""
        assert self.errors is not None
        linear = [self.linear(c.fit) for c in (base, *candidates)]
        least, *each = self.errors.log_evidences(linear).tolist()
        return [
            replace(c, log10_evidence=(one - least) / LOG10 + self.log10_odds(c.fit))
            for c, one in zip(candidates, each, strict=True)
        ]

    def log10_odds(self, fit: Fit) -> float:
        """Return the odds before the data against the base model."""
        added = len(fit.effects) - len(self._own)
        n = max(len(self._library), 2)
        return math.log10(1.0 / n if added == 1 else SEARCH.pairs_odds / (0.5 * n * (n - 1)))

    def _roughly(self, fit: Fit) -> float:
        """Return the log evidence (natural) by which explanations are ranked."""
        if self.errors is None:
            return fit.log_evidence
        return float(self.errors.log_evidences([self.linear(fit)], ERRORS.rough_nodes)[0])

    def _singles(self, pool: Pool, base: Candidate, chosen: list[Signature]) -> list[Candidate]:
        """Return fits of single effects: of the lesser ones only where the likely explain nothing.

        Where the misfit is large the screen's linear picture ranks them badly: a layer of which it
        expected four tenths of what another opening takes away was right. Of what is curved it may
        see a tenth: a layer that gained 161 was called a tension, which gained 138.
        """
        least = SEARCH.rival * chosen[0].gain
        likely = [s for s in chosen if s.gain >= least or get_effect(s.effect).curved]
        found = self._race(pool, base, [(base.fit, s) for s in likely])
        if not any(c.adequate for c in found):
            others = [s for s in chosen if s not in likely]
            found += self._race(pool, base, [(base.fit, s) for s in others])
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
        tasks = [(base.fit, seen[c.effects[-1]], c.fit) for c in best_fitting(found)]
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
        self,
        pool: Pool,
        base: Candidate,
        tasks: Sequence[tuple[Fit, Signature]],
        known: Sequence[Candidate] = (),
    ) -> list[Candidate]:
        """Return fits that end early where those before explain, and they will not.

        So do all where what is `known` explains. First come those that the table answers, then
        those with few unknowns: they take a tenth of the time of others, and may end these.
        """

        def costs(task: tuple[Fit, Signature]) -> tuple[bool, int]:
            fit, seen = task
            return fit.corrected or seen.corrected, len(fit.unknowns.axes) + len(seen.beside)

        found: list[Candidate] = []
        ranked = sorted(tasks, key=costs)
        cheap = sum(not costs(task)[0] for task in ranked)
        # What the likeliest of the costly ones explains ends the next ones early.
        starts = [*range(0, cheap, SEARCH.abreast), cheap]
        starts += range(cheap + 1, len(ranked), SEARCH.abreast)
        for begin, end in pairwise([*starts, len(ranked)]):
            limit = self._limit(base, [*known, *found])
            found += self._fits(pool, base, ranked[begin:end], limit)
        return found

    @staticmethod
    def _limit(base: Candidate, known: Iterable[Candidate]) -> Limit:
        """Return the costs above which a fit is out of the race, because others explain."""
        serving = [c.fit.cost for c in known if c.adequate]
        if not serving:
            return NO_LIMIT
        gained = max(0.0, base.fit.cost - min(serving))
        first = min(serving) + SEARCH.far + SEARCH.far_share * gained
        return Limit(first, min(first, min(serving) + SEARCH.far_later))

    def _pairs(
        self,
        pool: Pool,
        base: Candidate,
        singles: list[Candidate],
        most: int,
        least: float,
        signatures: Mapping[str, Signature] | None = None,
        known: Sequence[Candidate] = (),
        partners: int = SEARCH.partners,
    ) -> list[Candidate]:
        """Return pairs of the best singles, at most so many, with partners that gain so much.

        With the signatures of single effects all their pairs are screened as well. What is `known`
        is not fitted again. Each single gets so many `partners` at most.
        """
        fitted_already = {frozenset(c.effects[len(self._own) :]) for c in known}
        leaders = sorted(singles, key=lambda c: -c.log10_evidence)[:most]
        tasks: dict[frozenset[str], tuple[Fit, Signature]] = {}
        for leader in leaders:
            mine = leader.effects[-1]
            self._progress(f"looking for a partner of {mine}")
            library = [n for n in self._library if n != mine]
            look = next((e for fit, e in self._looks if fit is leader.fit), None)
            found, _ = self._screen(pool, leader.fit, library, None if look is None else look.mode)
            if look is not None:
                # These may have taken up what the partner does; what repeats say has not.
                found = self._by_errors_of_both(leader.fit, look, found)
                by_repeats, _ = self._screen(pool, leader.fit, library)
                found = {
                    n: max(s, found.get(n, s), key=attrgetter("gain"))
                    for n, s in by_repeats.items()
                }
            new = [
                s for s in sorted(found.values(), key=lambda s: -s.gain)
                if s.gain > least and frozenset((mine, s.effect)) not in fitted_already
            ]  # fmt: skip
            for s in new[:partners]:
                expected = leader.fit.cost - s.gain
                names = frozenset((mine, s.effect))
                if names not in tasks or expected < tasks[names][0].cost - tasks[names][1].gain:
                    tasks[names] = leader.fit, s
        ranked = sorted(tasks.values(), key=lambda t: t[0].cost - t[1].gain)[: SEARCH.most_pairs]
        costs = {frozenset((f.effects[-1], s.effect)): f.cost - s.gain for f, s in ranked}
        linear: list[tuple[Unknowns, Array]] = []
        if signatures:
            screened = linear_pairs(self.fitter, base.fit, signatures)
            there = fitted_already | costs.keys()
            others = [pair for pair in screened if frozenset(pair.names) not in there]
            costs |= {frozenset(pair.names): base.fit.cost - pair.gain for pair in others}
            chosen = sorted(costs, key=lambda names: costs[names])[: SEARCH.most_pairs]
            ranked = [t for t in ranked if frozenset((t[0].effects[-1], t[1].effect)) in chosen]
            linear = [pair.task for pair in others if frozenset(pair.names) in chosen]
        if not ranked and not linear:
            return []
        told = [f"{f.effects[-1]} and {s.effect}" for f, s in ranked]
        told += [" and ".join(u.effects[len(self._own) :]) for u, _ in linear]
        self._progress("fitting pairs: " + ", ".join(told))
        served = [*singles, *known]
        fitted = self._race(pool, base, ranked, served)
        for i in range(0, len(linear), SEARCH.abreast):
            limit = self._limit(base, [*served, *fitted])
            fits = pool.map(fit_from, [(*task, limit) for task in linear[i : i + SEARCH.abreast]])
            fitted += [self._candidate(fit, base) for fit in fits if fit is not None]
        return fitted

    def _by_errors_of_both(
        self, leader: Fit, look: ErrorChoice, found: Mapping[str, Signature]
    ) -> dict[str, Signature]:
        """Return partners' signatures with what they gain by the errors that both need, if more.

        Errors that one effect alone needs are wider than those of both: a slip of 41 µm gained 6
        beside a thickness, and 33 by those of both.
        """
        alone = self.linear(leader)
        seen = {n: s for n, s in found.items() if s.gain > SEARCH.partly}
        columns = [s.axes[s.which].prior[1] * look.mode.colour(s.direction) for s in seen.values()]
        gains = self._gains_by_its_own_errors(leader, [alone.beside(c[:, None]) for c in columns])
        told = {
            n: replace(s, gain=max(s.gain, gain))
            for (n, s), gain in zip(seen.items(), gains, strict=True)
        }
        return {**found, **told}

    def _gains_by_its_own_errors(self, fit: Fit, others: Sequence[Linearised]) -> list[float]:
        """Return twice the log evidence of others over a fit, each by errors like that one's."""
        look = self._look(fit)
        least = look.roughly(self.linear(fit).of_free)
        return [2.0 * (look.roughly(other.of_free) - least) for other in others]

    def _nested(
        self,
        pool: Pool,
        base: Candidate,
        singles: Sequence[Candidate],
        pairs: Sequence[Candidate],
    ) -> list[Candidate]:
        """Return those pairs again that fit worse than one of their members alone, begun at that.

        With a second effect nothing fits worse: such a fit has not found its optimum.
        """
        found = []
        for pair in pairs:
            names = pair.effects[len(self._own) :]
            alone = [c for c in singles if c.effects[-1] in names]
            member = min(alone, key=lambda c: c.fit.cost, default=pair)
            if member.fit.cost >= pair.fit.cost - FITS.gain:
                continue
            partner = [n for n in names if n != member.effects[-1]]
            self._progress(f"fitting {' and '.join(names)} again, from {member.effects[-1]} alone")
            seen, _ = self._screen(pool, member.fit, partner)
            found += self._fits(pool, base, [(member.fit, s) for s in seen.values()])
        return found

    def _gone_on(self, pool: Pool, base: Candidate, known: Sequence[Candidate]) -> list[Candidate]:
        """Return the pairs that come nearest, begun where they ended, where none explains.

        A narrow valley takes more anchors than a fit has while others are in the race.
        """
        pairs = [c for c in known if len(c.effects) - len(self._own) > 1]
        if not pairs or any(c.adequate for c in known):
            return []
        self._progress("going on with the pairs that come nearest")
        near = best_fitting(pairs)
        fits = pool.map(fit_from, [(c.fit.unknowns, c.fit.u, NO_LIMIT) for c in near])
        return [self._candidate(fit, base) for fit in fits if fit is not None]

    def _further(
        self,
        pool: Pool,
        base: Candidate,
        singles: Sequence[Candidate],
        known: Sequence[Candidate],
    ) -> list[Candidate]:
        """Return more pairs where none explains: of the better half of the best one.

        What the screen expects of a strong partner may be far off; of that half the next best
        partners are fitted.
        """
        pairs = [c for c in known if len(c.effects) - len(self._own) > 1]
        if not pairs or any(c.adequate for c in known):
            return []
        best = min(pairs, key=lambda c: c.fit.cost)
        halves = [c for c in singles if c.effects[-1] in best.effects]
        halves = sorted(halves, key=lambda c: c.fit.cost)[:1]
        return self._pairs(
            pool, base, halves, 1, SEARCH.seen, known=known, partners=SEARCH.most_pairs
        )

    def _members(
        self, pool: Pool, base: Candidate, candidates: Sequence[Candidate]
    ) -> list[Candidate]:
        """Return fits of the single effects of pairs that explain, begun where the pair ended.

        Where a pair leads. A strong effect changes the skin as well: from the base model's optimum
        its fit may not find there, and then needs a partner that it has not; one that the screen
        passed over was not fitted at all.
        """
        if self._leading_pair(candidates) is None:
            return []
        tasks: dict[tuple[str, ...], tuple[Unknowns, Array]] = {}
        for pair in sorted(candidates, key=lambda c: c.fit.cost):
            if pair.adequate and len(pair.effects) - len(self._own) > 1:
                for name in pair.effects[len(self._own) :]:
                    alone = self._unknowns.with_effect(name)
                    start = alone.among(pair.fit.unknowns, pair.fit.u)
                    tasks.setdefault(alone.effects, (alone, start))
        found = list(tasks.values())[: SEARCH.members]
        if found:
            self._progress("fitting the members of pairs alone")
        tried = pool.map(fit_from, [(*task, NO_LIMIT) for task in found])
        fits = [fit for fit in tried if fit is not None]
        return [c for c in (self._candidate(fit, base) for fit in fits) if c.adequate]

    def _rivals(self, pool: Pool, base: Candidate, candidates: list[Candidate]) -> list[Candidate]:
        """Return the candidates; where a pair leads, with pairs that its members make elsewhere.

        Beside one member's fit the right partner may seem to gain nothing: what both change of the
        skin lies around a bend. So each member is added to the fits of other single effects.
        """
        best = self._leading_pair(candidates)
        if best is None:
            return candidates
        members = best.effects[len(self._own) :]
        alone = [
            c for c in candidates
            if len(c.effects) - len(self._own) == 1 and c.effects[-1] not in members
        ]  # fmt: skip
        tasks = []
        for other in sorted(alone, key=lambda c: -c.log10_evidence)[: SEARCH.rivals]:
            seen, _ = self._screen(pool, other.fit, members)
            tasks += [(other.fit, s) for s in seen.values()]
        tasks.sort(key=lambda t: t[0].cost - t[1].gain)
        if not tasks:
            return candidates
        told = ", ".join(f"{f.effects[-1]} and {s.effect}" for f, s in tasks[: SEARCH.rival_pairs])
        self._progress(f"fitting its rivals: {told}")
        limit = Limit.at(best.fit.cost + SEARCH.far)
        found = self._fits(pool, base, tasks[: SEARCH.rival_pairs], limit)
        return best_of_each([*candidates, *found])

    def _every_single(
        self,
        pool: Pool,
        base: Candidate,
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
        self._progress("fitting every single effect from elsewhere")
        begun = set() if base.adequate else {c.effects[-1] for c in best_fitting(singles)}
        tasks = [(base.fit, s, None) for s in chosen if s.effect not in begun]
        fits = pool.map(fit_elsewhere, tasks)
        found = (self._candidate(fit, base) for fit in fits if fit is not None)
        return [c for c in found if c.adequate]

    def _one_is_enough(self, candidates: Sequence[Candidate]) -> bool:
        """Return whether a single effect explains the curves, and no pair does far better.

        One with a number for each opening is no simpler than a pair, and may stand for any: it has
        to lead by no more than a tie. One that is less likely than what leaves more than noise
        stands for something else.
        """
        good = [c for c in candidates if c.adequate]

        def numbers(one: Candidate) -> int:
            return sum(a.effect == one.effects[-1] for a in one.fit.unknowns.axes)

        alone = [c for c in good if len(c.effects) - len(self._own) == 1]
        single = [c.log10_evidence for c in alone if numbers(c) < SEARCH.as_a_pair]
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

    def _screen(
        self, pool: Pool, fit: Fit, names: Sequence[str], errors: Covariance | None = None
    ) -> tuple[dict[str, Signature], dict[str, str]]:
        """Return the effects' signatures, by these errors if given, and why others have none."""
        each = (
            pool.map(signature_of, [(fit, name) for name in names])
            if errors is None
            else pool.map(signature_by, [(fit, name, errors) for name in names])
        )
        found = list(zip(names, each, strict=True))
        return (
            {name: s for name, s in found if isinstance(s, Signature)},
            {name: why for name, why in found if isinstance(why, str)},
        )

    def _fits(
        self,
        pool: Pool,
        base: Candidate,
        tasks: Sequence[tuple[Fit, Signature]],
        limit: Limit = NO_LIMIT,
    ) -> list[Candidate]:
        found = []
        for fit in pool.map(fit_one, [(*task, limit) for task in tasks]):
            if fit is not None:
                found.append(self._candidate(fit, base))
        return found

    def _candidate(self, fit: Fit, base: Candidate | None) -> Candidate:
        records, k = self.fitter.records, len(fit.unknowns)
        if self.errors is None:
            left = look(records, self.fitter.errors, fit.deflections_mm, k)
        else:
            left = judge(records, self.errors.judged, fit.deflections_mm, k)
        at_bound = tuple(n for n, f in zip(fit.unknowns.names, fit.free, strict=True) if not f)
        ahead = 0.0
        if base is None:
            self._base_evidence = self._roughly(fit)
        else:
            ahead = (self._roughly(fit) - self._base_evidence) / LOG10 + self.log10_odds(fit)
        found = Candidate(fit, left, ahead, at_bound)
        if self._partial is not None:
            self._partial.add(found, base=base is None)
        return found


def creased(records: Sequence[Record], fit: Fit, domes: TableDomes) -> list[Record]:
    """Return the records with the suctions at which the skin of a fit creases."""
    skin = fit.unknowns.skin(fit.u)
    known = {r.geometry: domes.creases_mbar(SkinProblem(r.geometry, skin)) for r in records}
    return [replace(r, creases_mbar=known[r.geometry]) for r in records]
