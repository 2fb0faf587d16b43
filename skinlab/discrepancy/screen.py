"""A first look at every effect: how well its signature fits what is left.

The signature of an effect is what a typical size of it changes in the curves, after projecting out
what the law's parameters (and the effects already there) can absorb: the score test. It costs a
handful of elastic finite-element solutions an effect, and no fit; relaxation is approximate here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.fit import Fit, Fitter
from skinlab.discrepancy.settings import SEARCH
from skinlab.discrepancy.unknowns import Axis, Unknowns
from skinlab.inference.covariance import Covariance
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.fem.suction import SCREENING_MESH

Array = NDArray[np.float64]

NOT_HELD = "its model does not hold for these skins, even at 3 % of a typical size"


@dataclass(frozen=True, eq=False)
class Signature:
    """What an effect would do to a fit's residual, linearised.

    Below the samples' are the rows of the priors: unknowns absorb no more than these let them.
    """

    effect: str
    axes: tuple[Axis, ...]  # of the effect
    direction: Array  # (n + priors,) whitened, for one typical size, absorbed parts taken out
    size: float  # its length: standard deviations at a typical size
    amount: float  # best size, in typical ones
    gain: float  # by which χ² would fall
    absorbed: float  # share of the raw signature that the fit's unknowns absorb
    which: int = 0  # of the axes: the effect's size
    beside: tuple[float, ...] = ()  # the unknowns of all axes, as they were screened
    corrected: bool = False  # whether finite elements have to correct the table: a fit takes longer

    @property
    def detectable(self) -> float:
        """Size, in typical ones, that raises χ² by 25: five standard deviations."""
        return 5.0 / self.size if self.size > SEARCH.invisible else float("inf")


def signature(fitter: Fitter, fit: Fit, effect: str) -> Signature | None:
    """Return an effect's signature at a fit, None where its model does not hold there."""
    unknowns = fit.unknowns.with_effect(effect)
    axes = unknowns.axes[len(fit.unknowns.axes) :]
    # Without the correction of what relaxes, which takes most of the time of an anchor.
    without = fitter.model(fit.unknowns, SCREENING_MESH)
    fitter.prepare(without, fit.u, memory=False)
    here = np.concatenate(without.predict(fit.u))
    sized = [i for i, a in enumerate(axes) if a.parameter.zero is not None]
    tried = get_effect(effect).tried
    beside = [
        [0.0]
        if a.parameter.zero is not None
        else [a.to_u(v) for v in tried.get(a.parameter.name, (a.parameter.typical,))]
        for a in axes
    ]
    sizes = [(which, SEARCH.screened) for which in sized]
    for which in sized:
        one = axes[which].parameter
        sizes += [(which, (value / one.typical,)) for value in tried.get(one.name, ())]
    tasks = [(own, which, each) for own in product(*beside) for which, each in sizes]
    screened = _Screened(fitter, fit, unknowns, effect)
    held = [found for found in screened.signatures(here, tasks) if found is not None]
    # Where several of its parameters have a zero, it is the one that explains most.
    return max(held, key=lambda s: (s.gain, s.size)) if held else None


Task = tuple[tuple[float, ...], int, tuple[float, ...]]
"""The unknowns of an effect's axes, which of them is its size, and in typical sizes how large: the
first that skins bear."""


@dataclass(frozen=True, eq=False)
class _Screened:
    """One effect beside a fit."""

    fitter: Fitter
    fit: Fit
    unknowns: Unknowns  # with the effect
    effect: str

    @cached_property
    def _axes(self) -> tuple[Axis, ...]:
        return self.unknowns.axes[len(self.fit.unknowns.axes) :]

    @cached_property
    def _residual(self) -> Array:
        return left_of(self.fit, self.fitter.errors, self.fitter.measured)

    @cached_property
    def _absorbed(self) -> Array:
        """Directions (n + priors, k) that the fit's unknowns absorb."""
        return np.linalg.qr(_with_priors(self.fit))[0]

    def signatures(self, here: Array, tasks: Sequence[Task]) -> list[Signature | None]:
        """Return those along each."""
        there: list[tuple[Array, float] | None]
        if get_effect(self.effect).physical:
            there = [self._moved(*task) for task in tasks]
        else:
            there = self._read(tasks)
        known = [i for i, one in enumerate(there) if one is not None]
        if not known:
            return [None] * len(tasks)
        own, which, sizes = tasks[known[0]]
        corrected = self._corrected(self._u(own, which, sizes[0])[0])
        off = np.column_stack([(one[0] - here) / one[1] for one in there if one is not None])
        raw = self.fitter.errors.whiten(off)
        found: list[Signature | None] = [None] * len(tasks)
        for column, i in enumerate(known):
            own, which, _ = tasks[i]
            found[i] = replace(self._along(raw[:, column], own, which), corrected=corrected)
        return found

    def _corrected(self, some: Array) -> bool:
        """Return whether the table alone does not tell the curves with the effect."""
        model = self.fitter.model(self.unknowns, SCREENING_MESH)
        return model.needs_finite_elements(some)

    def _u(self, own: tuple[float, ...], which: int, size: float) -> tuple[Array, float]:
        """Return unknowns with so much of a typical size of the effect, and the step."""
        axis = self._axes[which]
        step = size * axis.to_u(axis.parameter.typical)
        some = np.concatenate([self.fit.u, own])
        some[len(self.fit.u) + which] += step
        return some, step

    def _moved(
        self, own: tuple[float, ...], which: int, sizes: tuple[float, ...]
    ) -> tuple[Array, float] | None:
        """Return the curves with the effect, and its step; None where its model does not hold."""
        for size in sizes:
            some, step = self._u(own, which, size)
            model = self.fitter.model(self.unknowns, SCREENING_MESH)
            if self.fitter.prepare(model, some, memory=False):
                there = np.concatenate(model.predict(some))
                if np.isfinite(there).all():
                    return there, step
        return None

    def _read(self, tasks: Sequence[Task]) -> list[tuple[Array, float] | None]:
        """Return the same of an effect on the record: the skin is solved once."""
        model = self.fitter.model(self.unknowns, SCREENING_MESH)
        moved = [self._u(own, which, sizes[0]) for own, which, sizes in tasks]
        if not self.fitter.prepare(model, moved[0][0], memory=False):
            return [None] * len(tasks)
        every = np.hstack(model.predict_many(np.array([u for u, _ in moved])))
        return [
            (there, step) if np.isfinite(there).all() else self._moved(*task)
            for there, (_, step), task in zip(every, moved, tasks, strict=True)
        ]

    def _along(self, raw: Array, own: tuple[float, ...], which: int) -> Signature:
        """Return the signature of what a typical size does (n,), whitened."""
        raw = np.concatenate([raw, np.zeros(len(self._absorbed) - len(raw))])
        axes, axis, residual = self._axes, self._axes[which], self._residual
        direction = raw - self._absorbed @ (self._absorbed.T @ raw)
        length, whole = float(np.linalg.norm(direction)), float(np.linalg.norm(raw))
        if length < SEARCH.invisible:
            share = 1.0 if whole > SEARCH.invisible else 0.0
            return Signature(self.effect, axes, direction, length, 0.0, 0.0, share, which, own)
        amount = float(np.clip(float(direction @ residual) / length**2, *axis.bounds))
        gain = 2.0 * amount * float(direction @ residual) - amount**2 * length**2
        return Signature(
            self.effect, axes, direction, length, amount, max(gain, 0.0),
            1.0 - length / max(whole, 1e-12), which, own,
        )  # fmt: skip


def left_of(fit: Fit, errors: Covariance, measured_mm: Array) -> Array:
    """Return what a fit leaves of the samples (n,), whitened, and of its priors: as signatures."""
    white = errors.whiten(measured_mm - np.concatenate(fit.deflections_mm))
    return np.concatenate([white, -fit.unknowns.prior_rows(fit.u)])


def _with_priors(fit: Fit) -> Array:
    priors = fit.unknowns.prior_slopes(fit.u)
    return np.vstack([fit.jacobian, priors])[:, fit.free]  # what is at a bound absorbs nothing


def alike(signatures: Mapping[str, Signature]) -> list[tuple[str, str]]:
    """Return pairs of effects whose signatures no data of this kind can tell apart."""
    names = sorted(n for n, s in signatures.items() if s.size > SEARCH.invisible)
    found = []
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            a, b = signatures[one], signatures[other]
            cosine = abs(float(a.direction @ b.direction)) / (a.size * b.size)
            if cosine > 0.9995:
                found.append((one, other))
    return found


@dataclass(frozen=True, eq=False)
class LinearPair:
    """Two effects together, linearised."""

    names: tuple[str, str]
    gain: float  # by which χ² would fall
    task: tuple[Unknowns, Array]  # where a fit begins


def linear_pairs(fitter: Fitter, fit: Fit, signatures: Mapping[str, Signature]) -> list[LinearPair]:
    """Return all pairs of effects that can be seen, linearised about a fit; the best first."""
    residual = left_of(fit, fitter.errors, fitter.measured)
    seen = [s for s in signatures.values() if math.isfinite(s.detectable)]
    found = []
    for one, other in combinations(seen, 2):
        pair = (one, other)
        directions = np.array([s.direction for s in pair])
        score, gram = directions @ residual, directions @ directions.T
        priors = np.diag([1.0 / s.axes[s.which].prior[1] ** 2 for s in pair])
        bounds = np.array([s.axes[s.which].bounds for s in pair])
        amounts = np.clip(np.linalg.solve(gram + priors, score), bounds[:, 0], bounds[:, 1])
        gain = float(2.0 * amounts @ score - amounts @ (gram + priors) @ amounts)
        unknowns = fit.unknowns.with_effect(one.effect).with_effect(other.effect)
        own = [
            np.array([amount if i == s.which else at for i, at in enumerate(s.beside)])
            for s, amount in zip(pair, amounts, strict=True)
        ]
        low, high = unknowns.bounds
        start = np.clip(np.concatenate([fit.u, *own]), low, high)
        found.append(LinearPair((one.effect, other.effect), gain, (unknowns, start)))
    return sorted(found, key=lambda pair: -pair.gain)


def worth_fitting(signatures: Iterable[Signature]) -> list[Signature]:
    """Return the effects that change enough to be fitted, the likeliest first."""
    ranked = sorted(signatures, key=lambda s: -s.gain)
    largest = ranked[0].gain if ranked else 0.0

    def least(one: Signature) -> float:
        return SEARCH.seen_curved if get_effect(one.effect).curved else SEARCH.seen

    return [s for s in ranked if s.gain > max(least(s), SEARCH.seen_share * largest)][
        : SEARCH.most_singles
    ]
