"""From candidates to one of five verdicts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from skinlab.discrepancy.candidates import Candidate, Found, outdone
from skinlab.discrepancy.discipline import Trial
from skinlab.discrepancy.heldout import HeldOut
from skinlab.discrepancy.settings import ERRORS, NAMES
from skinlab.mechanics.effects import get_effect

Name = Literal["none", "named", "learned", "ambiguous", "unknown"]


@dataclass(frozen=True, eq=False)
class Verdict:
    """What is missing: `explanations` are empty, one, or all that are tied."""

    name: Name
    explanations: list[Candidate]

    @property
    def explains(self) -> bool:
        """Whether there is one explanation, which a model may adopt."""
        return self.name in ("named", "learned")

    def without(self, first: int) -> Verdict:
        """Return the verdict without so many of its first explanations.

        What is left alone of a tie is a name where it is part of one of those: else it is behind
        all of them, and a tie with them still.
        """
        failed, left = self.explanations[:first], self.explanations[first:]
        if self.name == "learned":  # functions of one kind say the same: the first that stands
            return Verdict("learned", left[:1])
        if not failed or len(left) > 1:
            return Verdict(self.name, left)
        if any(set(left[0].effects) < set(one.effects) for one in failed):
            return Verdict("named", left)
        return Verdict("ambiguous", [*left, *failed])


def decide(found: Found) -> Verdict:
    """Return the verdict.

    `none`: the model's residual may be noise, and no effect's evidence is more than 20 : 1 against
    it, the many effects that were tried counted. Else the explanations whose residual may be noise
    are compared: `named` where one is at least 20 : 1 ahead of all others, `ambiguous` where
    several are not; `unknown` where no explanation's residual may be noise, or where one that
    leaves more is at least 20 : 1 ahead of all whose residual may be. Where one condition
    only was measured, 10,000 : 1 is asked for instead. Errors too large to be errors: `unknown`.
    """
    base, tie = found.base, found.tie
    if found.implausible:
        return Verdict("unknown", [])
    ahead = [c for c in found.candidates if c.log10_evidence >= tie]
    if base.adequate and not any(c.adequate for c in ahead):
        return Verdict("none", [])
    good = [c for c in ahead if c.adequate]
    if not good or outdone(found.candidates):
        return Verdict("unknown", [])
    best = max(c.log10_evidence for c in good)
    near = [c for c in found.candidates if c.log10_evidence > best - tie and c.log10_evidence > 0]
    # One whose residual is nearly as likely as that of one that may be noise is not out for it.
    least = 10.0**-NAMES.tie * max(c.left.by_errors for c in good if c in near)
    # Nor is one to which more effects are added that make the residual likelier, and not the whole.
    spared = [
        c.left.by_errors
        for c in near
        if c.left.by_errors >= ERRORS.hardly
        and any(
            g.adequate and set(c.effects) < set(g.effects) and g.log10_evidence <= c.log10_evidence
            for g in near
        )
    ]
    least = min([least, *spared])
    tied = [c for c in near if c.adequate or c.left.by_errors >= least]
    # More effects where fewer do as well are no other explanation.
    minimal = [c for c in tied if not any(set(o.effects) < set(c.effects) for o in tied)]
    minimal.sort(key=lambda c: -c.log10_evidence)
    return Verdict("named" if len(minimal) == 1 else "ambiguous", minimal)


def decide_learned(found: Found) -> Verdict:
    """Return the verdict where the library explains nothing, of its families of functions.

    `learned`: one's residual may be noise, or all but a little of it, and it is 20 : 1 ahead of the
    other kinds and of the model as it is with errors as large as that one needs; else `unknown`.
    Behind it are those of its kind that are as likely.
    """
    good = [c for c in found.candidates if _learns(c, found) and c.log10_evidence >= found.tie]
    if not good:
        return Verdict("unknown", [])
    best = max(good, key=lambda c: c.log10_evidence)
    others = [c.log10_evidence for c in found.candidates if c.kind != best.kind]
    if best.log10_evidence - max(others, default=0.0) < NAMES.tie:
        return Verdict("unknown", [])
    alike = [
        c for c in good
        if c.kind == best.kind and best.log10_evidence - c.log10_evidence < NAMES.tie
    ]  # fmt: skip
    return Verdict("learned", sorted(alike, key=lambda c: -c.log10_evidence))


def tied_kinds(found: Found) -> tuple[str, ...]:
    """Return the kinds of functions of which several do equally well; none where one is ahead."""
    good = [c for c in found.candidates if c.kind and _learns(c, found)]
    best = max((c.log10_evidence for c in good), default=0.0)
    near = [c for c in good if c.log10_evidence > max(best - NAMES.tie, found.tie)]
    near.sort(key=lambda c: -c.log10_evidence)
    kinds = tuple(dict.fromkeys(c.kind for c in near))
    return kinds if len(kinds) > 1 else ()


def _learns(one: Candidate, found: Found) -> bool:
    """Return whether what a family leaves may be noise, but for a little."""
    noise = found.errors.count
    left, whole = (max(fit.chi2 - noise, 0.0) for fit in (one.fit, found.base.fit))
    little = left <= NAMES.learned_left * noise and left <= NAMES.learned_share * whole
    nearly_all = left <= NAMES.learned_rest * noise and left <= NAMES.learned_tail * whole
    return one.adequate or little or nearly_all


def outdone_by_names(
    learned: Verdict, named: Sequence[Candidate], stood: Candidate | None = None
) -> bool:
    """Return whether effects with a name explain, and a learned function is no better than they.

    One that leaves more than noise and is behind them: it is one of these that is missing, though
    nobody can tell which. So is one that is behind a single effect, which did not stand its trials:
    a pair is supple, and may be ahead of anything. So it is where the function is not 20 times
    likelier than the name that `stood` all other trials, unless that is a form of its kind.
    """
    (one,) = learned.explanations
    explain = [c for c in named if c.adequate and (len(c.effects) == 1 or not one.adequate)]
    best = max((c.log10_evidence for c in explain), default=-math.inf)
    if best >= one.log10_evidence + NAMES.tie:
        return True
    if stood is None or one.kind in {get_effect(name).form_of for name in stood.effects}:
        return False
    (again,) = (c for c in named if c.effects == stood.effects)
    return one.log10_evidence - again.log10_evidence < NAMES.tie


def may_be_chance(found: Found, learned: Found, left: HeldOut) -> bool:
    """Return whether what the model leaves may be chance though its p value is small.

    Nothing that has a name and no function is likelier than the model as it is, and it predicts
    what was left out about as well as is expected: no gap is there that anything could close. Not
    where one condition only was measured, of which nothing was left out.
    """
    if not left.files:
        return False
    leads = any(c.log10_evidence >= found.tie for c in (*found.candidates, *learned.candidates))
    more_um = math.sqrt(max(left.rms_um**2 - left.expected_um**2, 0.0))
    hardly = found.base.left.by_errors < ERRORS.hardly
    return not (leads or hardly or found.implausible) and more_um < NAMES.practical_um


def disciplined(verdict: Verdict, found: Found, trials: Sequence[Trial]) -> Verdict:
    """Return the verdict after the trials of its first explanation.

    An explanation that failed one is none: what is left then is `none` where the model's residual
    may be noise, or where the explanation stood all but for its size: it is too small to matter.
    Else `unknown`.
    """
    failed = {trial.name for trial in trials if not trial.passed}
    if not failed:
        return verdict
    return Verdict("none" if found.base.adequate or failed == {"size"} else "unknown", [])
