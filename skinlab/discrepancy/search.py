"""Which explanation: the base model, every effect that the screen lets through, then pairs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.adequacy import Residual, judge
from skinlab.discrepancy.campaign_errors import (
    CampaignErrors,
    Linearised,
    Measured,
    averaged,
    evidences_of_look,
    learn,
    likeliest,
    look_at_errors,
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
    tie_of,
    with_members,
)
from skinlab.discrepancy.fit import NO_LIMIT, Fit, Fitter
from skinlab.discrepancy.pair_search import PairSearch, beside_which
from skinlab.discrepancy.phases import IN_STEP, begun_in_step, out_of_step, still_errors
from skinlab.discrepancy.placement_curves import bends_mm, thickness_slopes, with_thickness_of
from skinlab.discrepancy.race import Race
from skinlab.discrepancy.range_ends import Along, along_range
from skinlab.discrepancy.records import Record, by_condition, without
from skinlab.discrepancy.screen import Signature, worth_fitting
from skinlab.discrepancy.search_workers import (
    fit_by,
    fit_elsewhere,
    fit_from_by,
    off_the_wall,
)
from skinlab.discrepancy.settings import ERRORS, FITS, NAMES, SEARCH
from skinlab.discrepancy.starts import middle_of, starts, unknowns_of, with_thickness
from skinlab.discrepancy.table_domes import TableDomes
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.errors import NotTrustworthyError
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
        self._measured = Measured(fitter.records, noise_um, placement_scatter)
        self._thickness_mm = np.zeros(0)
        self._errors: CampaignErrors | None = None
        self._first: tuple[ErrorChoice, ...] = ()  # pure error, and as the model as it is sees them
        self.looks: list[tuple[Fit, ErrorChoice]] = []  # and as explanations do
        # Evidence of fits by looks, by their addresses, and what these are of.
        self._weighed_by: dict[int, tuple[ErrorChoice, dict[int, tuple[Fit, float]]]] = {}
        self._out_of_step: dict[str, str] = {}  # why a motion is none of the explanations
        self._own_log: dict[int, float] = {}  # log evidence of each of `looks` itself, by address
        self.kept: tuple[NDArray[np.bool_], ...] = ()  # samples (n,) of each curve
        self.unknowns = with_thickness(unknowns_of(model), fitter.records)
        self.own = self.unknowns.effects
        self._workers, self.progress, self._partial = workers, progress, partial
        self.library = [
            n for n in library_names() if n not in self.own and not get_effect(n).same_as
        ]

    @property
    def errors(self) -> CampaignErrors:
        """What the errors may be, from `learned_base` on."""
        assert self._errors is not None
        return self._errors

    @errors.setter
    def errors(self, now: CampaignErrors) -> None:
        self._errors = now

    def base(self) -> Fit:
        """Return the fit of the model as it is, with the errors that the fitter knows.

        Raises:
            NotTrustworthyError: it has no answer at all for these curves.
        """
        fitter, best = self.fitter, self._best_of_starts(self.fitter)
        if self._left_um(best) > SEARCH.astray_um:
            # These errors know of no places yet: where little noise is in curves of different
            # places, a skin whose errors could be anything may seem the best.
            equal = fitter.with_equal_errors(SEARCH.equal_um)
            other = self._best_of_starts(equal)
            if self._left_um(other) < SEARCH.astray_share * self._left_um(best):
                fitter, best = equal, other
        on_paths = fitter.on_paths(best)
        if on_paths is not None:
            best = _fitted(on_paths, best)
            self.fitter = self.fitter.with_errors(on_paths.records, self.fitter.errors)
        own = self.fitter.errors
        return best if fitter.errors is own else self.fitter.by_own_errors(best, fitter.errors)

    def _best_of_starts(self, fitter: Fitter) -> Fit:
        unknowns = self.unknowns
        fits = _from_each(fitter, unknowns.plain, starts(unknowns))
        if self.own:
            # Finite elements cost more: from the best of the plain fits, and from the middle.
            fits.sort(key=lambda f: f.cost)
            first = [*(f.u for f in fits[:1]), middle_of(unknowns)]
            found = (fitter.fit(unknowns, unknowns.start(start)) for start in first)
            fits = [f for f in found if f is not None]
        if not fits:
            raise NotTrustworthyError("the model has no answer for these curves")
        return min(fits, key=lambda f: f.cost)

    def _left_um(self, fit: Fit) -> float:
        off = np.concatenate(fit.deflections_mm) - self.fitter.measured
        return 1e3 * float(np.sqrt(np.mean(off**2)))

    def run(self, base: Candidate | None = None) -> Found:
        """Return the base fit, which is `learned_base`'s, the screen and the candidates."""
        base = self.learned_base() if base is None else base
        with Pool(self._workers, self.fitter) as pool:
            race = Race(pool, base, lambda fit: self.candidate(fit, base))
            pairs = PairSearch(self, race)
            self.progress(f"screening {len(self.library)} effects")
            signatures, not_screened = race.screen(base.fit, self.library)
            chosen = worth_fitting(signatures.values())
            if not chosen and not base.adequate:  # how close the best comes is told all the same
                chosen = sorted(signatures.values(), key=lambda s: -s.gain)[:2]
            singles: list[Candidate] = []
            if chosen:
                self.progress(f"fitting {', '.join(s.effect for s in chosen)}")
                singles = self._singles(race, chosen)
            if in_step := self._begun_in_step(race):
                singles = [*(c for c in singles if c.effects != in_step[0].effects), *in_step]
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
                best = max(c.log10_evidence for c in explaining)
                if not base.adequate or best > 0.0:
                    leading = beside_which(singles, best)
                    partners = pairs.beside(leading, len(leading), SEARCH.behind)
                    candidates = [*singles, *partners]
            # Errors that would do for the model as it is are no answer where something is ahead.
            missing = not base.adequate or any(
                c.adequate and c.log10_evidence >= NAMES.tie for c in candidates
            )
            if missing and not pairs.one_is_enough(candidates):
                candidates = [*candidates, *pairs.among(singles, signatures, candidates)]
            candidates = best_of_each(candidates)
            candidates = best_of_each([*candidates, *pairs.members(candidates)])
            candidates = pairs.rivals(candidates)
            candidates = best_of_each([*candidates, *pairs.members(candidates)])
            candidates += pairs.every_single(chosen, singles, candidates)
            candidates += self._seen_off_the_wall(race, candidates)
            candidates = self._in_step(best_of_each(candidates))
            candidates = self._weighed(base, candidates, SEARCH.looks)
            candidates = self._sharpened(race, candidates)
            candidates = self._along_ranges(race, candidates)
        candidates.sort(key=lambda c: -c.log10_evidence)
        if not any(IN_STEP in c.effects for c in candidates):
            not_screened |= self._out_of_step
        for name in self.own:
            stated = any(k.effect == name and k.stated for k in self.unknowns.known)
            not_screened[name] = (
                "the stated uncertainty of the thickness is part of every explanation"
                if stated
                else "the model has it already"
            )
        return Found(
            base, signatures, candidates, self.fitter.records, not_screened, self.fitter.errors,
            self.kept, self._implausible(candidates),
        )  # fmt: skip

    def learned_base(self) -> Candidate:
        """Return the fit of the model as it is, with the errors that repeats and roughness tell.

        Raises:
            NotTrustworthyError: it has no answer at all for these curves.
        """
        self.progress("fitting the model as it is")
        first = self.base()
        before, domes = self.fitter, self.fitter.domes
        linear = Linearised.of(first, before.errors, before.measured)
        bad = outliers(before.records, linear)
        self.kept = tuple(before.errors.split(~bad))
        self.progress("learning how large the errors are")
        records = creased(without(before.records, self.kept), first, domes)
        self._thickness_mm = thickness_slopes(before.records, first, domes)[~bad]
        fit = self._learned(records, first, linear.only(~bad))
        for _ in range(SEARCH.rounds):
            bent = self._bent(fit)
            if bent is not None:
                self.fitter = self.fitter.with_errors(bent, self.fitter.errors)
                self._thickness_mm = thickness_slopes(bent, fit, domes)
                fit = self._learned(bent, fit, self.linear(fit))
            better = self._elsewhere(fit)
            if better is None:
                break
            self._thickness_mm = thickness_slopes(self.fitter.records, better, domes)
            fit = self._learned(self.fitter.records, better, self.linear(better))
        self.errors = self.errors_with(fit)
        self._first, self._weighed_by = self.errors.looks, {}
        return self.candidate(fit, None)

    def _learned(self, records: Sequence[Record], first: Fit, linear: Linearised) -> Fit:
        """Return the model's fit with the errors that are learned about a first one."""
        if records is not self._measured.records:
            self._measured = replace(self._measured, records=records)
        self.errors = learn(self._measured, linear, self._thickness_mm, self._errors)
        return self._refitted(records, first)

    def _elsewhere(self, fit: Fit) -> Fit | None:
        """Return a better fit of the model as it is by the errors as they are now, if any is.

        By the first errors, which know of no places, the law may have ended at a wall, and places
        were looked for there: a base 76 above its optimum made a tie of five effects.
        """
        if fit.corrected:
            found = [off_the_wall(self.fitter, fit, NO_LIMIT)]
        else:
            unknowns = fit.unknowns
            found = _from_each(
                self.fitter, unknowns, [unknowns.start(one) for one in starts(unknowns)]
            )
        best = min(found, key=lambda f: f.cost, default=fit)
        return best if best.cost < fit.cost - FITS.gain else None

    def _bent(self, fit: Fit) -> list[Record] | None:
        """Return the records with what their places do beyond slopes, None where it is known."""
        records, domes = self.fitter.records, self.fitter.domes
        now_mm = thickness_slopes(records, fit, domes)
        pure = pure_error(self._measured, self.linear(fit), now_mm)
        node = self.errors.pure.nodes[0]
        bends = bends_mm(records, fit, domes, pure, node, self._thickness_mm, now_mm)
        off = max(float(np.abs(b - r.bend_mm).max()) for b, r in zip(bends, records, strict=True))
        if 1e3 * off <= ERRORS.bend_um:
            return None
        return [replace(r, bend_mm=bend) for r, bend in zip(records, bends, strict=True)]

    def _refitted(self, records: Sequence[Record], first: Fit) -> Fit:
        """Return a fit with the errors as learned, which is how all others are fitted from here."""
        self.fitter = self.fitter.with_errors(records, self.errors.working)
        return _fitted(self.fitter, first)

    def errors_with(self, fit: Fit) -> CampaignErrors:
        """Return the errors that were learned, with the look that this explanation gives.

        What a placement's thickness does is told by it, too: the model as it is may be of a skin
        whose slope is another by a quarter.
        """
        linear, thickness_mm = self.linear(fit), self._thickness_mm
        if fit.unknowns.effects != self.own:
            thickness_mm = thickness_slopes(self.fitter.records, fit, self.fitter.domes)
        found = look_at_errors(self.errors, self._measured, linear, thickness_mm)
        return CampaignErrors((*self.errors.looks, found))

    def _implausible(self, ranked: Sequence[Candidate]) -> str:
        """Return what is too large for an error, as the best of the explanations leaves it.

        What a placement's stiffness does is told by that one itself: measured curves of what
        relaxes tell it badly, and what they are off by was called errors that last, of 16 µm.
        """
        told, best = self.errors.implausible, next((c for c in ranked if c.adequate), None)
        if not told or best is None:
            return told
        linear = self.linear(best.fit)
        own_mm = linear.slopes_mm[:, best.fit.unknowns.space.scale]
        look = look_at_errors(
            self.errors, self._measured, linear, self._thickness_mm, own_softer_mm=own_mm
        )
        return CampaignErrors((look,)).implausible

    def as_last_seen(self, fit: Fit) -> tuple[Fitter, Fit]:
        """Return the fitter with the errors as the last look has them, and the fit by these."""
        fitter = self.fitter.with_errors(self.fitter.records, self.errors.looks[-1].mode)
        return fitter, fitter.near(fit) or fit.with_errors(self.fitter.errors, fitter.errors)

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
        self.progress(f"weighing {len(candidates)} explanations")
        self._look_last(max(serving, key=lambda c: c.log10_evidence).fit)
        candidates = self.weighed(base, candidates)
        told = self._by_errors_as_told(candidates)
        if told:
            self._look_last(told[0].fit)
            candidates = self.weighed(base, told)
        for _ in range(rivals):
            near = self._doubtful(candidates)
            if not near:
                break
            self.look_of(near[0].fit)
            candidates = self._weighed(base, candidates)
        return candidates

    def _by_errors_as_told(self, candidates: list[Candidate]) -> list[Candidate]:
        """Return the candidates judged by the errors that the likeliest needs, itself the first.

        Where it leaves more than noise by those that repeats tell, and needs none that are larger:
        polynomials that stand for any model take up most of a breath that lasts about as long as a
        phase, so that repeats tell its size, and its frequency badly. Empty where that is not so.
        """
        ranked = sorted(candidates, key=lambda c: -c.log10_evidence)
        if ranked[0].adequate or ranked[0].log10_evidence < NAMES.tie:
            return []
        own = self.look_of(ranked[0].fit)
        if not _no_larger(own, self.errors.pure):
            return []
        least = ranked[0].log10_evidence - SEARCH.doubt
        again = [
            replace(c, left=self.left_of(c.fit, own))
            if c.log10_evidence > least and not c.adequate
            else c
            for c in ranked
        ]
        return again if again[0].adequate else []

    def _doubtful(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Return what may still win, and whose errors are not known; the nearest first."""
        known = {id(fit) for fit, _ in self.looks}

        def gains(one: Candidate, best: Candidate) -> float:
            if id(one.fit) in known:
                return 0.0
            by_its_own = self.gains_by_its_own_errors(best.fit, [self.linear(one.fit)])
            return max(best.fit.cost - one.fit.cost, *by_its_own)

        return [c for c in may_still_win(candidates, gains) if id(c.fit) not in known]

    def _sharpened(self, race: Race, candidates: list[Candidate]) -> list[Candidate]:
        """Return the candidates, those that may win fitted again by the errors of the best.

        By errors as wide as pure error leaves them a valley is flat, and a fit ends anywhere in it:
        what it is off by there counts by the errors of the best.
        """
        near = with_members(may_still_win(candidates)[: SEARCH.sharpened], candidates)
        if len(near) < 2:
            return candidates
        self.progress(f"fitting {len(near)} explanations by the errors of the best")
        errors = self.errors.looks[-1].mode
        fitted = race.fitted(fit_by, [(c.fit, errors) for c in near])
        moved = self.weighed(race.base, fitted)
        better = {
            id(old): new
            for old, new in zip(near, moved, strict=True)
            if new.adequate and new.log10_evidence > old.log10_evidence
        }
        if not better:
            return candidates
        return self._weighed(race.base, [better.get(id(c), c) for c in candidates])

    def look_of(self, fit: Fit) -> ErrorChoice:
        """Return the errors as an explanation sees them; those that are known are kept."""
        for known, errors in self.looks:
            if known is fit:
                return errors
        found = self.errors_with(fit).looks[-1]
        self.looks.append((fit, found))
        return found

    def _look_last(self, fit: Fit) -> None:
        """Take the errors of all explanations that were asked, those of this one as the last."""
        last = self.look_of(fit)
        others = [errors for known, errors in self.looks if known is not fit]
        self.errors = CampaignErrors((*self._first, *others, last))

    def by_its_own_errors(self, found: Found) -> Found | None:
        """Return what was found, the model as it is judged by the errors that it needs itself.

        Where nothing is likelier than the model as it is, and it needs no larger errors than
        repeats tell, there is no gap. Without repeats nothing tells slow errors from what a model
        misses, and pure error knows of none: then no larger ones than usual. None where that is not
        so.
        """
        ahead = any(c.log10_evidence >= found.tie for c in found.candidates)
        if ahead or found.implausible:
            return None
        fit = found.base.fit
        own = self.look_of(fit)
        if any(len(members) > 1 for members in by_condition(found.records)):
            if not _no_larger(own, self.errors.pure):
                return None
        elif any(own.median(partial(size_um, name=n)) > um for n, um in ERRORS.usual_um.items()):
            return None
        base = replace(found.base, left=self.left_of(fit, own))
        return replace(found, base=base) if base.adequate else None

    def weighed(self, base: Candidate, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Return candidates of the library with their evidence by the errors as they are now."""
        fits = [c.fit for c in (base, *candidates)]
        looks = [self._evidences(look, fits) for look in self.errors.looks]
        least, *each = averaged(looks).tolist()
        return [
            replace(c, log10_evidence=(one - least) / LOG10 + self.log10_odds(c.fit))
            for c, one in zip(candidates, each, strict=True)
        ]

    def _along_ranges(self, race: Race, candidates: list[Candidate]) -> list[Candidate]:
        """Return the candidates, with the evidence along a range of what ends at its end.

        Where that may decide: of those, the model as it is too, that are not much further behind
        the best than a name has to lead.
        """
        ranked = sorted((race.base, *candidates), key=lambda c: -c.log10_evidence)
        far = tie_of(self.fitter.records) + SEARCH.range_decades
        least = ranked[0].log10_evidence - far
        near = [c for c in ranked[: SEARCH.along] if c.log10_evidence > least]
        if len(near) < 2:
            return candidates
        self.progress("weighing what ends at the end of a range")
        more = {
            id(c): 0.0 if one is None else self._gained(c.fit, one)
            for c, one in zip(near, race.pool.map(along_range, [c.fit for c in near]), strict=True)
        }
        less = more.get(id(race.base), 0.0)
        return [
            replace(c, log10_evidence=c.log10_evidence + more.get(id(c), 0.0) - less)
            for c in candidates
        ]

    def _gained(self, fit: Fit, along: Along) -> float:
        """Return by how much log10 evidence there is more along a range than about the fit."""
        ones = [self.linear(fit), *(along.held(self.linear(one)) for one in along.fits)]
        here, *there = self.errors.log_evidences(ones, ERRORS.rough_nodes)
        return (along.log_mean(np.array(there)) - float(here)) / LOG10

    def _evidences(self, look: ErrorChoice, fits: Sequence[Fit]) -> Array:
        """Return log p(data) (fits,) as one look has it: each is found once."""
        known = self._weighed_by.setdefault(id(look), (look, {}))[1]
        new = list({id(fit): fit for fit in fits if id(fit) not in known}.values())
        if new:
            found = evidences_of_look(look, [self.linear(fit) for fit in new])
            known |= {id(fit): (fit, float(e)) for fit, e in zip(new, found, strict=True)}
        return np.array([known[id(fit)][1] for fit in fits])

    def log10_odds(self, fit: Fit) -> float:
        """Return the odds before the data against the base model."""
        added = len(fit.effects) - len(self.own)
        n = max(len(self.library), 2)
        return math.log10(1.0 / n if added == 1 else SEARCH.pairs_odds / (0.5 * n * (n - 1)))

    def _roughly(self, fit: Fit) -> float:
        """Return the log evidence (natural) by which explanations are ranked."""
        return float(self.errors.log_evidences([self.linear(fit)], ERRORS.rough_nodes)[0])

    def _singles(self, race: Race, chosen: list[Signature]) -> list[Candidate]:
        """Return fits of single effects: of the lesser ones only where the likely explain nothing.

        Where the misfit is large the screen's linear picture ranks them badly: a layer of which it
        expected four tenths of what another opening takes away was right. Of what is curved it may
        see a tenth: a layer that gained 161 was called a tension, which gained 138.
        """
        least = SEARCH.rival * chosen[0].gain
        likely = [s for s in chosen if s.gain >= least or get_effect(s.effect).curved]
        found = self._in_step(race.run([(race.base.fit, s) for s in likely]))
        if not any(c.adequate for c in found):
            others = [s for s in chosen if s not in likely]
            found += self._in_step(race.run([(race.base.fit, s) for s in others]))
        if race.base.adequate or any(c.adequate for c in found):
            return found
        return self._begun_elsewhere(race, chosen, found)

    def _begun_in_step(self, race: Race) -> list[Candidate]:
        """Return fits of a motion that all curves have in step, where errors took it up."""
        if IN_STEP not in self.library:
            return []
        base, unknowns, look = race.base.fit, self.unknowns.with_effect(IN_STEP), self.errors.pure
        tasks = []
        for values in begun_in_step(base, self.linear(base), look, self.fitter.records):
            added = (a for a in unknowns.axes if a.effect == IN_STEP)
            moved = [a.to_u(values[a.parameter.name]) for a in added]
            tasks.append((unknowns, np.array([*base.u, *moved]), still_errors(look)))
        found = self._in_step(race.fitted(fit_from_by, tasks))
        return sorted(found, key=lambda c: -c.log10_evidence)[:1]

    def _begun_elsewhere(
        self, race: Race, chosen: list[Signature], found: list[Candidate]
    ) -> list[Candidate]:
        """Return the fits, those that came nearest begun elsewhere as well, if that is better.

        A strong effect changes the skin beyond what is linear: a fit from the base model's optimum
        may end at a wall of skins that crease.
        """
        seen = {s.effect: s for s in chosen}
        tasks = [(race.base.fit, seen[c.effects[-1]], c.fit) for c in best_fitting(found)]
        better = {c.effects: c for c in race.fitted(fit_elsewhere, tasks)}
        return [
            better[c.effects]
            if c.effects in better and better[c.effects].fit.cost < c.fit.cost
            else c
            for c in found
        ]

    def _in_step(self, candidates: list[Candidate]) -> list[Candidate]:
        """Return the candidates without those that may be a breath or a pulse by chance in step.

        Those behind the same without the motion stay: nothing is called a motion for them.
        """
        return [c for c in candidates if not self._by_chance_in_step(c, candidates)]

    def _by_chance_in_step(self, one: Candidate, candidates: Sequence[Candidate]) -> bool:
        mine = one.effects[len(self.own) :]
        if IN_STEP not in mine or not one.adequate or one.log10_evidence < NAMES.tie:
            return False
        fewer = (c for c in candidates if set(c.effects) < set(one.effects))
        if any(c.log10_evidence >= one.log10_evidence for c in fewer):
            return False
        why = out_of_step(one.fit, self.linear(one.fit), self.errors.pure, self.fitter.records)
        if why:
            self._out_of_step[IN_STEP] = why
        return bool(why)

    def _seen_off_the_wall(self, race: Race, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Return single effects that explain, and that the screen does not see from a range's end.

        What the model lacks may have led it there: a stiffening passed for a skin of nu 0.495,
        where it promised 2, was not fitted, and a gain was named. Where nothing leads, only what
        takes up much of what holding the model off that end costs: a stiffening ahead by 12 decades
        took up 0.44 of it, what else there is 0.12.
        """
        leads = any(c.adequate and c.log10_evidence >= NAMES.tie for c in candidates)
        base, alone = race.base.fit, len(self.own) + 1
        fitted = {c.effects[-1] for c in candidates if len(c.effects) == alone}
        library = [name for name in self.library if name not in fitted]
        tasks = []
        for held in race.held(base):
            needed = 0.0 if leads else SEARCH.held * max(held.cost - base.cost, 0.0) + SEARCH.seen
            seen = worth_fitting(race.screen(held, library)[0].values())
            tasks += [(held, s) for s in seen if s.gain > needed]
        tasks = tasks[: SEARCH.rival_pairs]
        if not tasks:
            return []
        self.progress(f"fitting {', '.join(s.effect for _, s in tasks)}")
        return [c for c in race.run(tasks, candidates) if c.adequate]

    def gains_by_its_own_errors(self, fit: Fit, others: Sequence[Linearised]) -> list[float]:
        """Return twice the log evidence of others over a fit, each by errors like that one's."""
        look = self.look_of(fit)
        if id(look) not in self._own_log:
            self._own_log[id(look)] = look.roughly(self.linear(fit).of_free)
        least = self._own_log[id(look)]
        return [2.0 * (look.roughly(other.of_free) - least) for other in others]

    def left_of(self, fit: Fit, told: ErrorChoice) -> Residual:
        """Return what a fit leaves by the errors that are told.

        In doubt also where another thickness of a placement does what it does to this fit's skin,
        and not to that of the model as it is, with which it was fitted: the likelier of both.
        """
        records, errors = self.fitter.records, self.fitter.errors
        left = judge(records, likeliest(told), fit, errors)
        if left.by_errors >= ERRORS.no_doubt or fit.chi2 > FITS.hopeless * errors.count:
            return left
        own = with_thickness_of(fit, told, records, self.fitter.domes)
        return max(left, judge(records, likeliest(own), fit, errors), key=lambda r: r.by_errors)

    def candidate(self, fit: Fit, base: Candidate | None) -> Candidate:
        """Return a fit, its residual judged, and how far it is ahead of the base (None: itself)."""
        left = self.left_of(fit, self.errors.pure)
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


def _no_larger(own: ErrorChoice, told: ErrorChoice) -> bool:
    """Return whether no part of an explanation's own errors is larger than was told."""
    names = {name for node in own.nodes for name in node.sizes_um}

    def medians(look: ErrorChoice) -> dict[str, float]:
        return {name: look.median(partial(size_um, name=name)) for name in names}

    before = medians(told)
    return all(
        um <= ERRORS.no_larger * before[name] + ERRORS.rounding_um
        for name, um in medians(own).items()
    )


def creased(records: Sequence[Record], fit: Fit, domes: TableDomes) -> list[Record]:
    """Return the records with how the table errs for the skin of a fit.

    From which suction on it creases, and by how much the table was off between its nodes.
    """
    skin = fit.unknowns.skin(fit.u)
    problems = {r.geometry: SkinProblem(r.geometry, skin) for r in records}
    known = {g: (domes.creases_mbar(one), domes.seen_errors(one)) for g, one in problems.items()}
    found = []
    for r in records:
        creases_mbar, seen = known[r.geometry]
        found.append(replace(r, creases_mbar=creases_mbar, table_errors=seen))
    return found


def _fitted(fitter: Fitter, first: Fit) -> Fit:
    fit = fitter.fit(first.unknowns, first.u)
    if fit is None:
        raise NotTrustworthyError("the model has no answer for these curves")
    return fit


def _from_each(fitter: Fitter, unknowns: Unknowns, starts: Sequence[Array]) -> list[Fit]:
    """Return fits from starts of the law, until so many have led to the best of them."""
    found: list[Fit] = []
    for start in starts:
        fit = fitter.fit(unknowns, start)
        if fit is None:
            continue
        found.append(fit)
        least = min(f.cost for f in found)
        close = FITS.gain + FITS.close_share * max(0.0, least - fitter.errors.count)
        if sum(f.cost < least + close for f in found) >= SEARCH.agreeing:
            break
    return found
