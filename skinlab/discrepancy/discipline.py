"""What an explanation has to stand before it is a name, beyond its evidence.

It has to be worth a name (its size), to be there again in part of the data, to beat a small smooth
error of the model, and to predict what was left out: chosen again without it, better than the model
as it is by more than chance, and about as well as may be expected.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from skinlab.discrepancy.adequacy import Steps, steps
from skinlab.discrepancy.campaign_errors import (
    CampaignErrors,
    Linearised,
    WithoutCurves,
    log_evidences,
)
from skinlab.discrepancy.candidates import LOG10, Candidate, are_several
from skinlab.discrepancy.fit import Fit
from skinlab.discrepancy.heldout import HeldOut
from skinlab.discrepancy.odds import likelier_words
from skinlab.discrepancy.posterior import gaussian
from skinlab.discrepancy.records import Record, by_geometry
from skinlab.discrepancy.settings import NAMES, SEARCH
from skinlab.inference.covariance import Covariance
from skinlab.inference.error_choice import ErrorChoice, Node
from skinlab.inference.noise import legendre
from skinlab.mechanics.effects import EFFECTS, get_effect
from skinlab.mechanics.names import is_logarithmic, label

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SECOND = "every second sample"


@dataclass(frozen=True)
class Trial:
    """One test of an explanation: whether it stood it, and a sentence."""

    name: str
    passed: bool
    sentence: str


def adds_in_time(name: str) -> bool:
    """Return whether an effect adds to what is read what depends on time alone.

    Small steps, each in one direction, are such a thing on average: a drift.
    """
    effect = get_effect(name)
    if effect.physical:
        return False
    since_s, rest = np.array([0.0, 1.0, 3.0]), np.zeros(3)
    values = effect.typical
    at_rest = effect.read_along(since_s, rest, rest, values)
    under_suction = effect.read_along(since_s, rest + 50.0, rest + 1.0, values) - 1.0
    return bool(np.ptp(at_rest) > 0.0 and np.allclose(at_rest, under_suction, atol=1e-9))


class Discipline:
    """The tests of one campaign's explanations."""

    def __init__(
        self,
        records: Sequence[Record],
        errors: CampaignErrors,
        linear: Mapping[int, Linearised],
        odds: Mapping[int, float],
    ) -> None:
        """Both by `id` of the candidate: the explanations about their fits, their log10 odds."""
        self._records, self._errors, self._linear, self._odds = records, errors, linear, odds
        self._nodes = [n for look in errors.looks for n in look.nodes[: SEARCH.nodes_per_look]]
        self._known: dict[bytes, dict[int, Array]] = {}

    def log10_evidence(self, one: Candidate, kept: Mask) -> float:
        """Return log10 p of some samples (u,), odds not counted."""
        return float(logsumexp(self._by_setting(one, kept)) / LOG10)

    def _predicted(self, one: Candidate, out: Mask) -> float:
        """Return log10 p of some samples (u,) by all others: the mean over the errors' settings."""
        whole, rest = (self._by_setting(one, k) for k in (np.ones_like(out), ~out))
        return float(softmax(whole) @ (whole - rest)) / LOG10

    def _by_setting(self, one: Candidate, kept: Mask) -> Array:
        """Return log p (settings,) of some samples (u,), with the settings' prior."""
        key = np.packbits(kept).tobytes()
        if key not in self._known:  # of all explanations at once: their errors are the same
            each = self._of(kept) + np.array([[n.log_prior_of(kept)] for n in self._nodes])
            self._known[key] = dict(zip(self._linear, each.T, strict=True))
        return self._known[key][id(one)]

    def _of(self, kept: Mask) -> Array:
        """Return log p (settings, explanations) of some samples."""
        split = self._nodes[0].covariance.split(kept)
        curves = np.array([bool(part.all()) for part in split])
        if (curves | [not part.any() for part in split]).all():
            return self._by_curve(curves, int(kept.sum()))
        parts = [linear.only(kept) for linear in self._linear.values()]
        return log_evidences(parts, [n.covariance.only(kept) for n in self._nodes])

    @cached_property
    def _by_curve(self) -> WithoutCurves:
        return WithoutCurves(list(self._linear.values()), [n.covariance for n in self._nodes])

    def _weighed(self, one: Candidate, kept: Mask) -> float:
        return self.log10_evidence(one, kept) + self._odds[id(one)]

    def ahead(self, one: Candidate, base: Candidate, kept: Mask) -> float:
        """Return log10 evidence in some samples over another explanation, the odds not counted."""
        return self.log10_evidence(one, kept) - self.log10_evidence(base, kept)

    @cached_property
    def _drops(self) -> dict[str, Mask]:
        """Parts of the data in which an explanation has to be there again."""
        counts = [len(r.curve) for r in self._records]
        number = np.repeat(np.arange(len(counts)), counts)
        drops = {_SECOND: np.concatenate([np.arange(n) % 2 == 0 for n in counts])}
        if len(counts) > 1:
            drops |= {r.name: number != i for i, r in enumerate(self._records)}
        return drops

    def needs_both(self, pair: Candidate, alone: Candidate) -> bool:
        """Return whether a pair is there again beside one of its members, as a name has to be.

        It has to be ahead without any one curve, and by half of the samples: not far, since these
        say half as much.
        """
        lead = pair.log10_evidence - alone.log10_evidence
        everything = np.ones(sum(len(r.curve) for r in self._records), dtype=bool)
        odds = lead - self.ahead(pair, alone, everything)
        return lead >= NAMES.second and all(
            self.ahead(pair, alone, kept) + odds >= 0.0 for kept in self._drops.values()
        )

    def trials(
        self,
        best: Candidate,
        base: Candidate,
        others: Sequence[Candidate],
        parts: Sequence[Mask],
        held: HeldOut,
        tied: Sequence[Candidate] = (),
    ) -> list[Trial]:
        """Return the tests of `best`; `parts` (u,) are what was held out, `held` what it left.

        An explanation that is tied with it is told beside it, and may lead without a curve.
        """
        rivals = self._rivals(best, others, ())
        everything = np.ones(sum(len(r.curve) for r in self._records), dtype=bool)
        whole = self.ahead(best, base, everything)
        odds = best.log10_evidence - whole  # of the prior, and what fewer settings change
        found = [*self._seen(best, base), self._size(best, base), self._smooth(best, base)]
        found.append(self._steps(best, base))
        found.append(self._again(best, base, self._rivals(best, others, tied), odds))
        if parts:
            found.append(self._chosen_again(best, base, rivals, parts))
            ratio = held.rms_um / max(held.expected_um, 1e-9)
            most = NAMES.learned_out_ratio if best.kind else NAMES.held_out_ratio
            found.append(
                Trial(
                    "predicts",
                    ratio <= most,
                    f"what was left out is predicted to {held.rms_um:.1f} µm, "
                    f"{ratio:.2f} times what is expected",
                )
            )
        return found

    def _seen(self, best: Candidate, base: Candidate) -> Iterator[Trial]:
        """Tell of effects that curves as long as these cannot show."""
        longest_s = max(float(np.ptp(r.curve.time_s)) for r in self._records)
        for name, values in best.fit.unknowns.values(best.fit.u).items():
            if name in base.effects:
                continue
            with EFFECTS.at_work(name):
                why: object = get_effect(name).unseen(values, longest_s)
                if not isinstance(why, str):
                    raise TypeError(f"unseen returned {why!r}; expected a text")
            if why:
                yield Trial("seen", False, why)

    def _size(self, best: Candidate, base: Candidate) -> Trial:
        changed = np.concatenate(best.fit.deflections_mm) - np.concatenate(base.fit.deflections_mm)
        size = 1e3 * float(np.sqrt(np.mean(changed**2)))
        moved = _moved(best.fit, base.fit)
        it_changes = "they change" if are_several(best, base.effects) else "it changes"
        return Trial(
            "size",
            size >= NAMES.practical_um or bool(moved),
            f"{it_changes} the fitted curves by {size:.1f} µm, once the law's parameters have "
            f"been fitted again{', and '.join(['', *moved])}",
        )

    def _smooth(self, best: Candidate, base: Candidate) -> Trial:
        shapes = smooth_shapes(self._records, NAMES.smooth_degree)
        mine, m = self._linear[id(base)], shapes.shape[1]
        more = mine.beside(1e-3 * shapes)
        sizes = [more.scaled(size, m) for size in NAMES.smooth_sizes_um]
        plain, *each = (self._errors.log_evidences([mine, *sizes]) / LOG10).tolist()
        each = [one - plain for one in each]
        mean = float(logsumexp(np.array(each) * LOG10)) / LOG10 - math.log10(len(each))
        size = NAMES.smooth_sizes_um[int(np.argmax(each))]
        lead = best.log10_evidence - max(mean, 0.0)
        it_is = "they are" if are_several(best, base.effects) else "it is"
        return Trial(
            "smooth",
            lead >= NAMES.tie,
            f"{it_is} {likelier_words(lead)} than a smooth error of the model of about {size:g} µm",
        )

    def _steps(self, best: Candidate, base: Candidate) -> Trial:
        # A learned function follows corners nearly: by its own errors what it leaves there stands
        # out, though pure error may be larger; where that knows of none that last, by its own.
        looks = self._errors.looks[-1:] + ((self._errors.pure,) if best.kind else ())
        moves = any(map(adds_in_time, best.effects))

        def left(one: Candidate, errors: ErrorChoice) -> Steps:
            # At its optimum by these errors: its fit ended near that by wider ones, and what a
            # refit would take off is no step.
            linear = self._linear[id(one)]
            residual_mm = linear.residual_mm - linear.explained_mm(errors.mode)
            return steps(self._records, errors.mode, residual_mm, errors.unrounded)

        # Of a corner that it does follow, some share is left; of steps it takes off half at most.
        passed = any(
            not ((found := left(best, e)).sudden or (moves and found.small))
            or (best.kind and found.large < NAMES.steps_left * left(base, e).large)
            for e in looks
        )
        it_leaves = "they leave" if are_several(best, base.effects) else "it leaves"
        return Trial(
            "steps",
            passed,
            f"{it_leaves} no sudden steps"
            if passed
            else f"what {it_leaves} has sudden steps in it, as of tape that lets go",
        )

    def _again(
        self,
        best: Candidate,
        base: Candidate,
        rivals: Sequence[Candidate],
        odds: float,
    ) -> Trial:
        """Return whether it is there with every second sample dropped, and with any one curve."""
        failed = [
            what for what, (there, ahead) in self._without(best, base, rivals, odds).items()
            if not there or ahead
        ]  # fmt: skip
        it_is = "they are" if are_several(best, base.effects) else "it is"
        return Trial(
            "again",
            not failed,
            f"{it_is} there again with every second sample left out, and with any one curve"
            if not failed
            else f"{it_is} not there without " + ", ".join(failed),
        )

    def _without(
        self, best: Candidate, base: Candidate, rivals: Sequence[Candidate], odds: float
    ) -> dict[str, tuple[bool, list[Candidate]]]:
        """Return by what is left out whether it is there, and what is then ahead of it.

        With something beside it, it is there as well: a zero that wanders in all curves but one.
        """
        # What is learned is a kind: another function of the same kind is no other answer.
        rivals = [r for r in rivals if not best.kind or r.kind != best.kind]
        with_more = [r for r in rivals if set(best.effects) < set(r.effects)]
        rivals = [r for r in rivals if r not in with_more]
        found = {}
        for what, kept in self._drops.items():
            needed = NAMES.tie - odds if what == _SECOND else 0.0
            mine = max(self._weighed(one, kept) for one in (best, *with_more))
            ahead = [r for r in rivals if self._weighed(r, kept) - mine > NAMES.tie]
            found[what] = self.ahead(best, base, kept) >= needed, ahead
        return found

    def ahead_in_parts(
        self,
        best: Candidate,
        base: Candidate,
        others: Sequence[Candidate],
        tied: Sequence[Candidate],
    ) -> list[Candidate]:
        """Return what is ahead of an explanation where data are left out.

        None where there it is no better than the model as it is: then it stands for nothing.
        """
        everything = np.ones(sum(len(r.curve) for r in self._records), dtype=bool)
        odds = best.log10_evidence - self.ahead(best, base, everything)
        parts = self._without(best, base, self._rivals(best, others, tied), odds).values()
        if not all(there for there, _ in parts):
            return []
        return list({id(c): c for _, ahead in parts for c in ahead}.values())

    @staticmethod
    def _rivals(
        best: Candidate, others: Sequence[Candidate], tied: Sequence[Candidate]
    ) -> list[Candidate]:
        rivals = [c for c in others if c is not best][: NAMES.tried_rivals]
        return [c for c in rivals if c not in tied]

    def _chosen_again(
        self,
        best: Candidate,
        base: Candidate,
        rivals: Sequence[Candidate],
        parts: Sequence[Mask],
    ) -> Trial:
        """Return whether what is chosen without a part predicts it better than the base.

        Where several are as likely without it, each predicts with its probability there. By errors
        as all data tell them, of each explanation: rounded readings of a hold are alike, those of
        a ramp are not, and errors that were learned without the holds miss these under a right
        explanation, and not under a wrong one, whose errors are wide.
        """
        gain, chosen = 0.0, (best, *rivals)
        for out in parts:
            weighed = np.array([self._weighed(c, ~out) for c in chosen]) * LOG10
            predicted = np.array([self._predicted(c, out) for c in chosen]) * LOG10
            gain += float(logsumexp(weighed + predicted) - logsumexp(weighed)) / LOG10
            gain -= self._predicted(base, out)
        return Trial(
            "chosen again",
            gain >= NAMES.held_out_chance,
            "for what is chosen without them, the conditions left out are "
            f"{likelier_words(gain)} than for the model as it is",
        )


def smooth_shapes(records: Sequence[Record], degree: int) -> Array:
    """Return polynomials in p/p_max (u, m) of each opening, on the way up and after it apart.

    Scaled so that all together have the mean square of one.
    """
    starts = np.cumsum([0, *(len(r.curve) for r in records)])
    blocks = []
    for members in by_geometry(records):
        top = max(1e-9, *(float(records[i].pressure_mbar.max()) for i in members))
        for up in (True, False):
            block = np.zeros((starts[-1], degree + 1))
            for i in members:
                here = np.flatnonzero((records[i].curve.phase == "load") == up)
                x = np.clip(records[i].pressure_mbar[here] / top, 0.0, 1.0)
                block[starts[i] + here] = legendre(x, degree + 1)
            if block.any():
                blocks.append(block)
    return np.hstack(blocks) / math.sqrt(degree + 1)


@dataclass(frozen=True)
class Shares:
    """Root mean squares (µm) of what the residual of the model as it is consists of."""

    noise_um: float
    placement_um: float
    mesh_um: float
    effect_um: float

    def of_the_gap(self) -> dict[str, float]:
        """Return by name the shares of the mean square, which add up to 1."""
        squares = {name.removesuffix("_um"): size**2 for name, size in vars(self).items()}
        whole = sum(squares.values())
        return {name: square / whole for name, square in squares.items()} if whole else squares


def by_part(node: Node, did_mm: Array) -> dict[str, Array]:
    """Return what each part of the errors did (u,), of what each of their columns did (u, m).

    "mesh" is what the columns do that are there whatever the errors are.
    """
    where = {"mesh": slice(node.combination.fixed_mm.shape[1])} | node.combination.columns
    return {name: did_mm[:, columns].sum(axis=1) for name, columns in where.items()}


def shares_of(errors: CampaignErrors, base: Linearised, linear: Linearised) -> Shares:
    """Return the shares of the gap, by the most probable errors under the best explanation.

    `linear` is that one about its fit, `base` the model as it is about its own.
    """
    node = errors.looks[-1].nodes[0]
    did = by_part(node, linear.shares(node.covariance))
    mesh = did["mesh"]
    placement = sum(
        (what for name, what in did.items() if name.startswith("placement")), np.zeros_like(mesh)
    )
    # These errors have their own optimum: a fit by others may stand off it, as placements do.
    gap, left = (_left(one, node.covariance) for one in (base, linear))
    effect, rest = gap - left, left - mesh - placement
    return Shares(*(1e3 * float(np.sqrt(np.mean(v**2))) for v in (rest, placement, mesh, effect)))


def _left(one: Linearised, errors: Covariance) -> Array:
    """Return what an explanation leaves (u,) at its optimum by these errors.

    Where that is so far off that straight lines lead away from the data, what its own fit leaves.
    """
    left = one.residual_mm - one.explained_mm(errors)
    far = np.mean(left**2) > NAMES.astray**2 * np.mean(one.residual_mm**2)
    return one.residual_mm if far else left


def repeats_um(
    records: Sequence[Record],
    members: Sequence[Sequence[int]],
    model_mm: Sequence[NDArray[np.float64]],
) -> float | None:
    """Return by how much a curve differs from its repeats, root mean square; None without any.

    Less a model's curves: where first samples are lost, or a ramp is a little faster, repeats are
    none in time, and what is left of them still is.
    """
    off = [r.straight_mm - w for r, w in zip(records, model_mm, strict=True)]
    squares, count = 0.0, 0
    for group in (g for g in members if len(g) > 1):
        t = records[group[0]].curve.time_s
        curves = np.array([np.interp(t, records[i].curve.time_s, off[i]) for i in group])
        squares += float(np.square(curves - curves.mean(axis=0)).sum())
        count += (len(group) - 1) * len(t)
    return 1e3 * math.sqrt(squares / count) if count else None


def _moved(fit: Fit, base: Fit) -> list[str]:
    """Return in words which of the law's parameters leave their interval by what matters."""
    without, with_it = gaussian(base).parameters, fit.unknowns.base(fit.u)
    found = []
    for name, plain in base.unknowns.base(base.u).items():
        value = with_it[name]
        if without[name]["low"] <= value <= without[name]["high"]:
            continue
        if is_logarithmic(name):
            if abs(value / plain - 1.0) >= NAMES.practical_share:
                found.append(f"{label(name)} by {100.0 * (value / plain - 1.0):+.0f} %")
        elif abs(value - plain) >= NAMES.practical_change:
            found.append(f"{label(name)} by {value - plain:+.2f}")
    return found
