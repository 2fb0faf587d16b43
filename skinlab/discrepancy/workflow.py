"""The whole workflow: noise, base fit, where, which, what next, the gap."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from skinlab.curves.campaign import Campaign
from skinlab.discrepancy.cancelling import against_cancelling
from skinlab.discrepancy.candidates import Candidate, Found, Partial, is_motion
from skinlab.discrepancy.discipline import Discipline, Trial, repeats_um, shares_of
from skinlab.discrepancy.families import find_families
from skinlab.discrepancy.fit import Fit, Fitter
from skinlab.discrepancy.heldout import HeldOut, conditions_of, predict_held_out
from skinlab.discrepancy.misfit import errors_of
from skinlab.discrepancy.motion import find_motion, has_motion
from skinlab.discrepancy.next_measurement import NextMeasurement, advise
from skinlab.discrepancy.outcome import Outcome
from skinlab.discrepancy.phases import IN_STEP
from skinlab.discrepancy.placement_curves import with_stiffness_of
from skinlab.discrepancy.planned_curve import PlannedErrors
from skinlab.discrepancy.posterior import gaussian, sample
from skinlab.discrepancy.records import by_condition, coarsened, records_of
from skinlab.discrepancy.rival_functions import RivalFunctions
from skinlab.discrepancy.screen import alike
from skinlab.discrepancy.search import Search
from skinlab.discrepancy.settings import ERRORS, NAMES, PLANS
from skinlab.discrepancy.table_domes import TableDomes
from skinlab.discrepancy.unlike import contradicted_by, still_contradicted
from skinlab.discrepancy.verdict import (
    Verdict,
    decide,
    decide_learned,
    disciplined,
    may_be_chance,
    outdone_by_names,
    tied_kinds,
)
from skinlab.errors import InputError
from skinlab.inference.error_judgement import judge_errors
from skinlab.mechanics.model_file import BASE, Model
from skinlab.tables.base import Database
from skinlab.tables.forward import check_law_of

__all__ = ["Partial", "explain"]


def explain(
    campaign: Campaign,
    database: Database,
    *,
    model: Model = BASE,
    workers: int = 1,
    finite_elements: bool = True,
    data: Collection[str] = (),
    progress: Callable[[str], None] = lambda _: None,
    partial: Partial | None = None,
    seed: int = 0,
) -> Outcome:
    """Return what is missing in the model, as far as these curves tell.

    `model` is what the curves are explained by so far; without `finite_elements` the effects that
    the database cannot answer stay approximate. `partial` is told of what is known so far. The
    answer is the same for any number of workers; `seed` is that of the draws from the posterior.
    Where effects of the model were learned from a file of these curves, or from `data` (`sha256:…`
    of what each curve says), what the model says of their size is left aside: they count once. So
    it is where the curves contradict it, unless what is missing had seemed to be another size.

    Raises:
        InputError: a curve is too short, the database is of another law, or of one opening only.
        NotTrustworthyError: the thickness of a curve is outside the database, or the model has no
            answer for these curves at all.
    """
    check_law_of(database, model.model.law)
    if database.fixed_geometry is not None:
        raise InputError(
            "this database is of one opening: a missing effect is looked for with one of every "
            'opening (`form = "dimensionless"` under [table] in its SPEC.toml)'
        )
    sources = {curve.source for curve in campaign.curves if curve.source}
    learned_from_these = model.learned_from({*data, *sources})
    if learned_from_these:
        model = model.without_learned()
    records = [coarsened(r, ERRORS.coarse_hz) for r in records_of(campaign)]
    for curve in campaign.curves:
        database.covers(curve)  # names a curve whose thickness it does not speak of
    fitter = Fitter(
        records, errors_of(records), TableDomes(database), finite_elements=finite_elements
    )
    search = Search(
        fitter,
        model=model,
        workers=workers,
        noise_um=campaign.noise_um,
        placement_scatter=campaign.placement_scatter,
        progress=progress,
        partial=partial,
    )
    base = search.learned_base()
    if unlike := contradicted_by(search, base.fit):
        progress("trying other sizes of the model's own effects")
        alone = explain(
            campaign, database, model=model.without_learned(), workers=workers,
            finite_elements=finite_elements, progress=progress, partial=partial, seed=seed,
        )  # fmt: skip
        if still_contradicted(search.unknowns, unlike, alone.posteriors[alone.best.effects]):
            return replace(alone, unlike_model=tuple(unlike))
    tried = _told(search, search.run(base), progress)
    progress("working out the intervals")
    outcome = _outcome(search, tried, seed, progress)
    return replace(outcome, learned_from_these=learned_from_these)


@dataclass(frozen=True, eq=False)
class _Tried:
    """A verdict after its trials, with what these took."""

    verdict: Verdict
    found: Found
    searched: Fitter
    final: Fitter
    before: HeldOut
    held: dict[tuple[str, ...], HeldOut]
    trials: tuple[Trial, ...] = ()
    doubted: Candidate | None = None  # what did not stand them
    # What could not be told apart in parts of the data; None where that is not why it failed
    open: Verdict | None = None
    kinds: tuple[str, ...] = ()  # of functions, of which each would do

    @property
    def failed(self) -> set[str]:
        """The trials that it did not stand."""
        return {trial.name for trial in self.trials if not trial.passed}

    def again(self, fit: Fit) -> Fit:
        """Return a fit with the errors as the best explanation sees them."""
        return fit.with_errors(self.searched.errors, self.final.errors)


def _told(search: Search, found: Found, progress: Callable[[str], None]) -> _Tried:
    """Return what is told of what the search has found: a name, a tie, a kind, or nothing."""
    tried = _tried(search, found, _each_needed(search, found, decide(found)), progress)
    learned = found
    if tried.verdict.name in ("none", "unknown"):
        tried, learned = _or_a_kind(search, tried, found, progress)
    if tried.verdict.name in ("none", "unknown"):
        tried = _or_a_motion(search, tried, found)
    if tried.verdict.name == "unknown":
        tried = _told_otherwise(search, tried, found, learned)
    if tried.verdict.name == "unknown":
        tried = replace(tried, kinds=tied_kinds(learned))
    return tried


def _or_a_kind(
    search: Search, tried: _Tried, found: Found, progress: Callable[[str], None]
) -> tuple[_Tried, Found]:
    """Return the kind of thing that is missing, if one stands its trials, and all kinds asked."""
    doubtful = found.base.left.p_value < ERRORS.no_doubt
    beaten = doubtful and tried.failed == {"families"}
    # Where errors would do, a kind is asked for only by evidence that no chance gives.
    least = NAMES.unasked if tried.verdict.name == "none" and not beaten else 0.0
    if least and tried.before.as_expected:
        return tried, found  # there is no gap that a function could take away
    progress("finding out what kind of thing is missing")
    before = search.errors
    more = find_families(search, found, least)
    kind = decide_learned(more)
    if kind.explanations and kind.explanations[0].log10_evidence >= least:
        learned = _tried(search, more, kind, progress)
        named = search.weighed(found.base, found.candidates)
        stood = tried.doubted if tried.failed == {"families"} else None
        if learned.verdict.name == "learned" and not outdone_by_names(
            learned.verdict, named, stood
        ):
            both = [*more.candidates, *named]
            both.sort(key=lambda c: -c.log10_evidence)
            return replace(learned, found=replace(more, candidates=both)), more
    search.errors = before
    return tried, more


def _or_a_motion(search: Search, tried: _Tried, found: Found) -> _Tried:
    """Return the motion that all curves have in step, if there is one."""
    moving = find_motion(search, found)
    if moving is None:
        return tried
    one, trials = moving
    verdict = disciplined(Verdict("learned", [one]), found, trials)
    if not verdict.explanations:
        return tried
    return replace(
        tried,
        verdict=verdict,
        found=replace(found, candidates=[one, *found.candidates]),
        held={one.effects: tried.before},
        trials=trials,
    )


def _outcome(
    search: Search,
    tried: _Tried,
    seed: int,
    progress: Callable[[str], None],
) -> Outcome:
    """Return a verdict with its intervals, its shares of the gap and what to measure next."""
    verdict, found, final = tried.verdict, tried.found, tried.final
    chosen = verdict.explanations[0] if verdict.explanations else found.base
    shares = shares_of(search.errors, *map(search.linear, (found.base.fit, chosen.fit)))
    refined = tried.again(chosen.fit)
    if not is_motion(chosen, found.base.effects):
        refined = final.refined(refined)
    errors = with_stiffness_of(refined, search.errors.looks[-1])
    own = final.with_errors(final.records, errors.mode)
    refined = refined.with_errors(final.errors, own.errors)
    # A learned function is linear in its many coefficients: the valley needs not to be followed.
    posterior = (
        gaussian(refined)
        if verdict.name == "learned"
        else sample(own, refined, errors, np.random.default_rng(seed))
    )
    following = None
    if verdict.name == "ambiguous":
        progress("looking for the measurement that would tell them apart")
        following = _next_measurement(search, tried, np.random.default_rng([seed, 1]))
    said = judge_errors(search.errors.looks[-1], None)
    return Outcome(
        verdict,
        found,
        tried.before,
        tried.held[chosen.effects] if verdict.explanations else tried.before,
        {names: gap.rms_um for names, gap in tried.held.items()},
        following,
        seed=seed,
        posteriors={chosen.effects: posterior},
        alike=alike(found.signatures),
        trials=tried.trials,
        doubted=None if verdict.explanations else tried.doubted,
        kinds=tried.kinds,
        shares=shares,
        error_model=said.summary,
        placement=said.placement,
        repeats_um=repeats_um(
            final.records, by_condition(final.records), chosen.fit.deflections_mm
        ),
    )


def _next_measurement(
    search: Search, tried: _Tried, rng: np.random.Generator
) -> NextMeasurement | None:
    """Return what would tell the tied apart, also from what is a little behind them."""
    every = tried.verdict.explanations
    tied, known = every[: NAMES.most_tied], {c.effects for c in every}
    least = max(c.log10_evidence for c in tied) - PLANS.behind
    behind = [
        c
        for c in tried.found.candidates
        if c.adequate and c.log10_evidence >= least and c.effects not in known
    ][: PLANS.most - len(tied)]
    return advise(
        tried.final,
        [tried.again(c.fit) for c in tied],
        [c.log10_evidence for c in (*tied, *behind)],
        PlannedErrors.settings(search.errors, [search.linear(c.fit) for c in tied]),
        rng,
        [tried.again(c.fit) for c in behind],
    )


def _told_otherwise(search: Search, tried: _Tried, found: Found, learned: Found) -> _Tried:
    """Return what is told in place of `unknown`, where it is no gap that is left, or a tie.

    `found` is of the library, `learned` of functions.
    """
    if found.implausible and has_motion(search, found):
        excused = replace(found, implausible="")
        # In few curves a motion out of step may seem to be one in step.
        others = [c for c in excused.candidates if IN_STEP not in c.effects]
        if decide(replace(excused, candidates=others)).name == "none":
            return replace(tried, verdict=Verdict("none", []), found=excused)
    if noise := search.by_its_own_errors(found):
        return replace(tried, verdict=Verdict("none", []), found=noise)
    if tried.open is not None:
        return replace(tried, verdict=tried.open)
    if not tried.trials and may_be_chance(found, learned, tried.before):
        return replace(tried, verdict=Verdict("none", []))
    return tried


def _each_needed(search: Search, found: Found, verdict: Verdict) -> Verdict:
    """Return the verdict, a tie where a pair leads and one of its members would do.

    That is so where the evidence for the second effect is not there again in parts of the data.
    """
    if verdict.name != "named":
        return verdict
    (best,) = verdict.explanations
    alone = [c for c in found.candidates if c.adequate and set(c.effects) < set(best.effects)]
    if not alone:
        return verdict
    discipline = _discipline(search, (best, *alone))
    enough = [c for c in alone if not discipline.needs_both(best, c)]
    return Verdict("ambiguous", [best, *enough]) if enough else verdict


def _discipline(search: Search, candidates: Sequence[Candidate]) -> Discipline:
    linear = {id(c): search.linear(c.fit) for c in candidates}
    odds = {id(c): search.log10_odds(c.fit) for c in candidates}
    return Discipline(search.fitter.records, search.errors, linear, odds)


def _tried(search: Search, found: Found, first: Verdict, progress: Callable[[str], None]) -> _Tried:
    """Return what is left of a verdict after the trials of its first explanation.

    Where that one of a tie fails, the others are none the less for it: the next one is tried.
    """
    fitter = search.fitter
    # From here on with the errors as the best explanation sees them: those by which explanations
    # were searched are as wide as pure error leaves them.
    final = fitter.with_errors(fitter.records, search.errors.looks[-1].mode)

    def again(fit: Fit) -> Fit:
        return fit.with_errors(fitter.errors, final.errors)

    progress("predicting conditions held out of the fit")
    parts = conditions_of(final, [again(c.fit) for c in first.explanations])
    before = predict_held_out(final, again(found.base.fit), parts)
    held = {c.effects: predict_held_out(final, again(c.fit), parts) for c in first.explanations}
    tried = _Tried(first, found, fitter, final, before, held)
    if not first.explanations:
        return tried
    progress("trying whether the explanation is there again in parts of the data")
    serving = [c for c in found.candidates if c.adequate]
    others = [*first.explanations[: NAMES.most_tied], *serving[: NAMES.most_tied]]
    discipline = _discipline(search, (found.base, *others))
    masks = [part.out for part in parts]
    rivals = RivalFunctions(search, found.base)

    def trials(best: Candidate, tied: Sequence[Candidate]) -> tuple[Trial, ...]:
        stood = discipline.trials(best, found.base, serving, masks, held[best.effects], tied)
        if first.name != "learned" and all(trial.passed for trial in stood):
            apart = against_cancelling(fitter, found.base, best)
            stood += [] if apart is None else [apart]
            if apart is None or apart.passed:
                stood.append(rivals.against(best))
        return tuple(stood)

    each: list[tuple[Trial, ...]] = []
    for i, best in enumerate(first.explanations[: NAMES.most_tied]):
        each.append(trials(best, first.explanations[i + 1 :]))
        if all(trial.passed for trial in each[-1]):
            return replace(tried, verdict=first.without(i), trials=each[-1])
    tried = replace(
        tried,
        verdict=disciplined(first, found, each[0]),
        trials=each[0],
        doubted=first.explanations[0],
    )
    if first.name == "learned" or tried.failed != {"again"}:
        return tried
    best, *tied = first.explanations
    ahead = discipline.ahead_in_parts(best, found.base, serving, tied)
    every = [*first.explanations, *(c for c in ahead if c not in first.explanations)]
    if len(every) == 1:
        return tried
    every.sort(key=lambda c: -c.log10_evidence)
    held |= {c.effects: predict_held_out(final, again(c.fit), parts) for c in ahead}
    return replace(tried, open=Verdict("ambiguous", every))
