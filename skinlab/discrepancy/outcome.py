"""The result of the workflow, and its JSON form (`skinlab.discrepancy/1`)."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

from skinlab.discrepancy.adequacy import Place
from skinlab.discrepancy.candidates import Candidate, Found, behind_best
from skinlab.discrepancy.discipline import Shares, Trial
from skinlab.discrepancy.families import Learned, describe_learned
from skinlab.discrepancy.heldout import HeldOut
from skinlab.discrepancy.next_measurement import NextMeasurement, Plan
from skinlab.discrepancy.posterior import Posterior, gaussian
from skinlab.discrepancy.screen import Signature
from skinlab.discrepancy.settings import NAMES
from skinlab.discrepancy.shared_glitches import SharedGlitches, shared_glitches
from skinlab.discrepancy.verdict import Verdict
from skinlab.inference.error_judgement import ErrorModelSummary, PlacementSummary
from skinlab.mechanics.effects import Parameter, all_effects
from skinlab.mechanics.names import is_effects

SCHEMA = "skinlab.discrepancy/1"

_MOST_PLACES = 12
_MOST_CANDIDATES = 10
_MOST_OPEN = 3


@dataclass(frozen=True, eq=False)
class Outcome:
    """All that the workflow found in one campaign."""

    verdict: Verdict
    found: Found
    gap_before: HeldOut
    gap_after: HeldOut
    held_out: dict[tuple[str, ...], float]  # explanation -> root mean square, µm
    next_measurement: NextMeasurement | None
    seed: int = 0
    adopted_model: str | None = None
    alike: list[tuple[str, str]] = field(default_factory=list)
    # Of the best explanation, by its effects.
    posteriors: dict[tuple[str, ...], Posterior] = field(default_factory=dict)
    trials: tuple[Trial, ...] = ()  # what the first explanation had to stand
    doubted: Candidate | None = None  # the one that did not stand them, where there is no other
    kinds: tuple[str, ...] = ()  # of unknown functions: each would do, none is ahead
    shares: Shares | None = None  # of the gap
    error_model: ErrorModelSummary | None = None  # of the samples, under what is chosen
    placement: PlacementSummary | None = None
    repeats_um: float | None = None  # by which a curve differs from its repeats
    learned_from_these: bool = False  # the model was, so that its own priors were left aside
    unlike_model: tuple[str, ...] = ()  # its effects whose size these curves contradict: likewise

    @property
    def best(self) -> Candidate:
        """The best explanation, or the model as it is."""
        if self.verdict.explanations:
            return self.verdict.explanations[0]
        return self.found.base

    def parameters(self, candidate: Candidate) -> dict[str, dict[str, float]]:
        """Return `value`, `low` and `high` of an explanation's parameters, by name.

        The 90 % intervals are those of draws from the posterior; but for the best, of a Gaussian
        at the optimum.
        """
        posterior = self.posteriors.get(candidate.effects)
        return (gaussian(candidate.fit) if posterior is None else posterior).parameters

    @cached_property
    def learned(self) -> Learned | None:
        """What kind of thing is missing, where that is the verdict."""
        if self.verdict.name != "learned":
            return None
        noise = self.gap_before.noise_um**2
        before, after = (max(g.rms_um**2 - noise, 0.0) for g in (self.gap_before, self.gap_after))
        share = 1.0 - min(after / before, 1.0) if before > 0 else 0.0
        posterior = self.posteriors[self.best.effects]
        return describe_learned(self.found.base.fit, self.found, self.best, posterior, share)

    def to_json(self) -> dict[str, Any]:
        """Return the document."""
        base = self.found.base
        own = set(base.effects)
        behind = behind_best(self.found.candidates, own)
        return {
            "schema": SCHEMA,
            "verdict": self.verdict.name,
            "effects": [[e for e in c.effects if e not in own] for c in self.verdict.explanations],
            "where": [place_json(p) for p in self.where],
            "candidates": [
                {
                    "effects": [e for e in c.effects if e not in own],
                    "parameters": {n: v for n, v in self.parameters(c).items() if is_effects(n)},
                    "held_out_rms_um": self.held_out.get(c.effects),
                    "log10_evidence": 0.0 - (decades or 0.0),
                }
                for c, decades in zip(
                    self.found.candidates[:_MOST_CANDIDATES], behind, strict=False
                )
            ],
            "gap": {
                "before_um": self.gap_before.rms_um,
                "after_um": self.gap_after.rms_um,
                "plain_before_um": self.gap_before.plain_um,
                "plain_after_um": self.gap_after.plain_um,
                "noise_um": self.gap_before.noise_um,
                "held_out": list(self.gap_before.files),
                "expected_um": self.gap_after.expected_um,
                "sizes": None if self.shares is None else vars(self.shares),
                "repeats_um": self.repeats_um,
            },
            "shares": self.shares and self.shares.of_the_gap(),
            "error_model": self.error_model and asdict(self.error_model),
            "placement": self.placement and asdict(self.placement),
            "learned_from_these": self.learned_from_these,
            "unlike_model": list(self.unlike_model),
            "kinds": list(self.kinds),
            "trials": [
                {"name": t.name, "passed": t.passed, "sentence": t.sentence} for t in self.trials
            ],
            "not_ruled_out": [
                {
                    "effects": [e for e in c.effects if e not in own],
                    "parameters": self.parameters(c),
                    "log10_evidence": c.log10_evidence,
                }
                for c in self.not_ruled_out
            ],
            "parameters": {
                "before": _base_only(self.parameters(base)),
                "after": _base_only(self.parameters(self.best)),
            },
            "detectable": self.detectable,
            "cannot_show": self.cannot_show,
            "not_screened": self.not_screened,
            "left_out": self.found.left_out,
            "left_out_in_all_repeats": [
                {"files": list(m.files), "time_s": list(m.time_s)} for m in self.shared_glitches
            ],
            "next_measurement": None
            if self.next_measurement is None
            else _next_json(self.next_measurement, own),
            "learned": None if self.learned is None else learned_json(self.learned),
            "adopted_model": self.adopted_model,
            "seed": self.seed,
        }

    @cached_property
    def shared_glitches(self) -> list[SharedGlitches]:
        """When samples of all repeats of a program were left out."""
        return shared_glitches(self.found.records)

    @property
    def where(self) -> list[Place]:
        """Places where the model as it is leaves more than noise, the most significant first."""
        places = self.found.base.left.places
        found = [p for p in places if p.p_value < NAMES.significant][:_MOST_PLACES]
        # What goes up and down within every stretch stands out in none: then the foremost.
        return found or ([] if self.verdict.name == "none" else list(places[:3]))

    @property
    def not_ruled_out(self) -> list[Candidate]:
        """What may be there though it got no name, and would change the parameters.

        That which failed a trial; and where nothing is missing, what would explain the data and is
        not 20 times less likely than none at all.
        """
        if self.verdict.explanations:
            return []
        first = [] if self.doubted is None else [self.doubted]
        if self.verdict.name != "none":
            return first
        others = [
            c
            for c in self.found.candidates
            if c.adequate
            and c.log10_evidence > -NAMES.tie
            and all(c.effects != known.effects for known in first)  # out of the cache it is another
        ]
        others.sort(key=lambda c: -c.log10_evidence)
        return [*first, *others[:_MOST_OPEN]]

    @property
    def detectable(self) -> dict[str, float]:
        """Smallest size of each effect that these data could have shown, as its parameter.

        Of a skin as fitted: an effect that a fit without it has taken for another skin may be
        larger, and is told by `not_ruled_out` if it was fitted.
        """
        sizes = {name: _size_needed(s) for name, s in sorted(self.found.signatures.items())}
        return {f"{name}.{p.name}": size for name, (p, size) in sizes.items() if _has(p, size)}

    @property
    def cannot_show(self) -> dict[str, str]:
        """Why, by name, these data could not have shown an effect of any size that it can have.

        Every effect of the library is here, in `detectable` or in `not_screened`.
        """
        found = {
            one.name: f"it is exactly the same as {one.same_as}"
            for one in all_effects()
            if one.same_as and one.name not in self.found.not_screened
        }
        for name, signature in sorted(self.found.signatures.items()):
            parameter, size = _size_needed(signature)
            if math.isfinite(size) and not _has(parameter, size):
                assert parameter.zero is not None
                unit = f" {parameter.unit}" if parameter.unit else ""
                found[name] = (
                    f"{parameter.name} would have to be {size:.3g}{unit} away from "
                    f"{parameter.zero:g}, and is {parameter.low:g} to {parameter.high:g}{unit}"
                )
            elif not math.isfinite(size):
                found[name] = (
                    "the law's own parameters take up all that it does to these curves"
                    if signature.absorbed > 0.5
                    else "it does nothing to these curves"
                )
        return dict(sorted(found.items()))

    @property
    def not_screened(self) -> dict[str, str]:
        """Why, by name, an effect was not looked for."""
        return dict(sorted(self.found.not_screened.items()))


def learned_json(learned: Learned) -> dict[str, Any]:
    """Return `learned`."""
    one = learned.family
    return {
        "family": one.family,
        "share_of_gap": learned.share_of_gap,
        "sentence": learned.sentence,
        "nearest": list(learned.nearest),
        "function": {
            "x_name": one.x_name,
            "y_name": one.y_name,
            "x": learned.x.tolist(),
            "y": learned.y.tolist(),
            "low": learned.low.tolist(),
            "high": learned.high.tolist(),
        },
    }


def _size_needed(signature: Signature) -> tuple[Parameter, float]:
    """Return an effect's size, and how far from its zero these data would show it."""
    parameter = signature.axes[signature.which].parameter
    assert parameter.zero is not None
    return parameter, abs(parameter.typical - parameter.zero) * signature.detectable


def _has(parameter: Parameter, size: float) -> bool:
    """Whether a parameter can be so far from its zero."""
    assert parameter.zero is not None
    return size <= max(parameter.high - parameter.zero, parameter.zero - parameter.low)


def place_json(place: Place) -> dict[str, Any]:
    """Return an entry of `where`."""
    return {
        "file": place.file,
        "phase": place.phase,
        "pressure_mbar": list(place.pressure_mbar),
        "time_s": list(place.time_s),
        "mean_um": place.mean_um,
        "noise_um": place.noise_um,
        "p_value": place.p_value,
    }


def _base_only(values: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    return {n: v for n, v in values.items() if not is_effects(n)}


def _next_json(following: NextMeasurement, own: set[str]) -> dict[str, Any]:
    return {
        "aperture_mm": following.aperture_mm,
        "program": following.program,
        "separates": [[e for e in names if e not in own] for names in following.separates],
        "expected_log10_evidence": following.expected_log10_evidence,
        "placements": following.placements,
        "expected": None if following.alone is None else _plan_json(following.alone, own),
        "plan": None if following.plan is None else _plan_json(following.plan, own),
    }


def _plan_json(plan: Plan, own: set[str]) -> dict[str, Any]:
    return {
        "measurements": [vars(m) for m in plan.measurements],
        "minutes": plan.minutes,
        "named": [
            {"effects": [e for e in names if e not in own], "probability": p}
            for names, p in plan.named
        ],
        "wrong": plan.wrong,
        "ambiguous": plan.tied,
    }
