"""Learned effects: what kind of thing is missing, where nothing in the library explains the gap.

Each family of `skinlab.mechanics.effects` is a smooth unknown function, linear in its coefficients
about the model as it is. So its evidence is that of the errors' own machinery: coefficients are
columns as placements are, and the size of the function is integrated over a few scales. The
families that promise most are fitted with the whole model, and judged as names are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from drivers.breakdown import reason
from skinlab.discrepancy.candidates import LOG10, Candidate, Found
from skinlab.discrepancy.fit import NO_LIMIT, Fit, Limit
from skinlab.discrepancy.posterior import Posterior
from skinlab.discrepancy.records import Record
from skinlab.discrepancy.screen import Signature
from skinlab.discrepancy.search import Search
from skinlab.discrepancy.search_workers import at_wall
from skinlab.discrepancy.settings import NAMES, SEARCH
from skinlab.discrepancy.starts import middle_of
from skinlab.discrepancy.unknowns import Known, Unknowns
from skinlab.errors import BrokenPluginError
from skinlab.mechanics.effects import EFFECTS, all_effects
from skinlab.mechanics.effects.installed import check_series
from skinlab.mechanics.effects.learned import PRIOR_SIZES, LearnedEffect, Seen
from skinlab.mechanics.fem.suction import SCREENING_MESH
from skinlab.plugins import warn

Array = NDArray[np.float64]
A = TypeVar("A")

_STEP = 0.3  # typical sizes: of differences about the model as it is


def families() -> list[LearnedEffect]:
    """Return the families, by name."""
    return [one for one in all_effects() if isinstance(one, LearnedEffect)]


def functions() -> list[LearnedEffect]:
    """Return the families that do the same in every curve: what `motion` finds is no function."""
    return [one for one in families() if not one.own_of_each]


def seen_in(records: Sequence[Record], fit: Fit) -> Seen:
    """Return what the curves reach, and what a fit leaves of them."""
    return Seen(
        max(float(r.curve.deflection_mm.max()) for r in records),
        max(r.path.top_mbar for r in records),
        max(float(np.ptp(r.curve.time_s)) for r in records),
        max(r.curve.setup.cycle for r in records),
        tuple(sorted({r.geometry.aperture_mm for r in records})),
        tuple(
            (r.curve.time_s, r.at_pressure_mm - w)
            for r, w in zip(records, fit.deflections_mm, strict=True)
        ),
        tuple(fit.deflections_mm),
    )


def with_family(before: Unknowns, one: LearnedEffect, seen: Seen, scale: float) -> Unknowns:
    """Return the unknowns with a family's coefficients, whose function is so large beforehand."""
    known = [k for k in before.known if k.effect != one.name]
    for p in one.parameters:
        if p.zero is None:
            reach = one.range_of(seen)
            if not np.isfinite(reach):
                raise ValueError(f"range_of returned {reach}; expected a finite number")
            within = float(np.clip(reach, p.low, p.high))
            known.append(Known(one.name, p.name, within, 0.0))
        else:
            sd = scale * PRIOR_SIZES * abs(p.typical - p.zero)
            known.append(Known(one.name, p.name, p.zero, sd))
    effects = before.effects if one.name in before.effects else (*before.effects, one.name)
    return replace(before, effects=effects, known=tuple(known))


def find_families(search: Search, found: Found, least: float = 0.0) -> Found:
    """Return the families that were fitted, the best first, with errors as the best sees them.

    `search.errors` are those that were learned with them from then on. None is fitted where none
    promises `least` (log10 evidence over the model as it is), linearised.
    """
    base = found.base
    seen = seen_in(found.records, base.fit)
    own = set(base.effects)
    promises = [
        ask_family(one, partial(Promise.of, search, base.fit, one, seen))
        for one in functions()
        if one.name not in own
    ]
    promising = sorted((p for p in promises if p is not None), key=lambda p: -p.log_evidence)
    plain = float(search.errors.log_evidences([search.linear(base.fit)])[0])
    worth = [p for p in promising[: SEARCH.families] if p.log_evidence > plain]
    if not worth or worth[0].log_evidence - plain < least * LOG10:
        return replace(found, candidates=[])
    fits = [
        (p, ask_family(p.family, partial(fit_family, search, base.fit, p, seen))) for p in worth
    ]
    fitted = [(p, fit) for p, fit in fits if fit is not None]
    if not fitted:
        return replace(found, candidates=[])
    scaled = [at_its_scale(search, fit, p.family, seen) for p, fit in fitted]
    best = max(range(len(scaled)), key=lambda i: scaled[i][1])
    again = [
        _fitted_again(search, fit, first)
        for (fit, _), (_, first) in zip(scaled, fitted, strict=True)
    ]
    search.errors = search.errors_with(again[best])
    scaled = [
        at_its_scale(search, fit, p.family, seen) for fit, (p, _) in zip(again, fitted, strict=True)
    ]
    plain = float(search.errors.log_evidences([search.linear(base.fit)])[0])
    odds = -np.log10(max(len(promises), 2))
    candidates = [
        Candidate(
            fit,
            search.left_of(fit, search.errors.pure),
            float((log_evidence - plain) / LOG10 + odds),
        )
        for fit, log_evidence in scaled
    ]
    candidates.sort(key=lambda c: -c.log10_evidence)
    return replace(found, candidates=candidates, implausible=search.errors.implausible)


def ask_family(one: LearnedEffect, ask: Callable[[], A | None]) -> A | None:
    """Return what is asked of a family; an installed one that breaks down is told of, and has none.

    The others are still looked at.
    """
    try:
        return ask()
    except Exception as error:
        who = EFFECTS.who(one.name)
        if who is None:
            raise
        why = error.__cause__ if isinstance(error, BrokenPluginError) else error
        # What another process raised comes without its cause, and is a sentence already.
        told = f"{error}; it is left out"
        warn(told if why is None else f"{who}: broke down, and is left out: {reason(why)}")
        return None


@dataclass(frozen=True, eq=False)
class Promise:
    """What a family would explain, linearised about the model as it is."""

    family: LearnedEffect
    log_evidence: float
    scale: float
    start: Array  # (k,) of the unknowns with the coefficients

    @classmethod
    def of(cls, search: Search, fit: Fit, one: LearnedEffect, seen: Seen) -> Promise | None:
        """Return it, None where its model does not hold or it does nothing."""
        fitter, errors = search.fitter, search.errors
        shapes = shapes_of(search, fit, one, seen)
        if shapes is None:
            return None
        here = np.concatenate(fit.deflections_mm)
        first, names = len(fit.u), one.names
        linear = search.linear(fit)
        more = linear.beside(shapes)
        each = errors.log_evidences([more.scaled(s, len(names)) for s in SEARCH.scales])
        scale = SEARCH.scales[int(np.argmax(each))]
        slopes = np.column_stack([fit.jacobian, fitter.errors.whiten(shapes / PRIOR_SIZES)])
        at_fit = np.concatenate([fit.u, np.zeros(len(names))])
        scaled = with_family(fit.unknowns, one, seen, scale)
        residual = fitter.errors.whiten(fitter.measured - here)
        moved = np.linalg.solve(
            scaled.information(slopes, at_fit),
            slopes.T @ residual - scaled.prior_slopes(at_fit).T @ scaled.prior_rows(at_fit),
        )
        moved[:first] = np.where(fit.free, moved[:first], 0.0)
        low, high = scaled.bounds
        start = np.clip(at_fit + moved, low, high)
        return cls(one, float(logsumexp(each) - np.log(len(each))), scale, start)


def shapes_of(search: Search, fit: Fit, one: LearnedEffect, seen: Seen) -> Array | None:
    """Return what a family's coefficients do (u, m), mm, at their priors' standard deviations.

    Differences about a fit; None where its model does not hold, or nothing changes.
    """
    fitter, m = search.fitter, len(one.names)
    rows: list[Array]
    unknowns = with_family(fit.unknowns, one, seen, 1.0)
    at = np.concatenate([fit.u, np.zeros(m)])
    moved = at + _STEP * np.eye(len(at))[len(fit.u) :]
    if is_of_the_solid(search, fit, one, seen):
        here = np.concatenate(fit.deflections_mm)
        rows = []  # the finite elements know of the function only where it is not zero
        for u in moved:
            model = fitter.model(unknowns, SCREENING_MESH)
            if not fitter.prepare(model, u):
                return None
            rows.append(np.concatenate(model.predict(u)))
        there = np.array(rows)
    else:
        model = fitter.model(unknowns)
        if model.needs_finite_elements(at, memory=False) and not fitter.prepare(
            model, at, memory=False
        ):
            return None
        here, *rows = np.hstack(model.predict_many(np.vstack([at, moved])))
        there = np.array(rows)
    if not np.isfinite(there).all():
        return None
    shapes = PRIOR_SIZES * (there - here).T / _STEP
    return shapes if np.abs(shapes).max() > 1e-6 else None


def is_of_the_solid(search: Search, fit: Fit, one: LearnedEffect, seen: Seen) -> bool:
    """Return whether a family changes the solid, so that the finite elements have to be asked."""
    unknowns = with_family(fit.unknowns, one, seen, 1.0)
    at = np.concatenate([fit.u, np.zeros(len(one.names))])
    moved = at + _STEP * (np.arange(len(at)) == len(fit.u))
    model = search.fitter.model(unknowns)
    before, after = (model.needs_finite_elements(u, memory=False) for u in (at, moved))
    return after and not before


def fit_family(
    search: Search, base: Fit, promise: Promise, seen: Seen, limit: Limit = NO_LIMIT
) -> Fit | None:
    """Return the fit from where the linear picture leads, or from near the model as it is.

    Where the law's parameters are near an end of their range, as a wrong model drives them, also
    from the middle of it. One that stays above its `limit` ends early.
    """
    unknowns = with_family(base.unknowns, promise.family, seen, promise.scale)
    k = base.unknowns.count
    best: Fit | None = None
    for law in (promise.start[:k], base.u[:k], middle_of(unknowns)):
        own = (
            promise.start
            if best is None
            else np.concatenate([base.u, promise.start[len(base.u) :]])
        )
        fit = search.fitter.fit(unknowns, np.concatenate([law, own[k:]]), limit)
        if fit is not None and (best is None or fit.cost < best.cost):
            best = fit
        if best is not None and best.settled and best.cost < base.cost and not at_wall(best).any():
            break
    return best


def _fitted_again(search: Search, fit: Fit, before: Fit) -> Fit:
    """Return the fit at the scale that it has now, where that is another than `before`'s.

    Linearised a function may promise most at a scale too small for it, and is then held back.
    """
    if fit.unknowns == before.unknowns:
        return fit
    again = search.fitter.fit(fit.unknowns, fit.u)
    return fit if again is None else again


def at_its_scale(search: Search, fit: Fit, one: LearnedEffect, seen: Seen) -> tuple[Fit, float]:
    """Return the fit at its likeliest scale, and log evidence with the scale integrated out."""
    fits = [replace(fit, unknowns=with_family(fit.unknowns, one, seen, s)) for s in SEARCH.scales]
    linear = search.linear(fit)
    ones = [
        replace(
            linear,
            prior=f.unknowns.prior_rows(f.u),
            prior_slopes=f.unknowns.prior_slopes(f.u),
            log_prior_volume=f.unknowns.log_prior_volume,
        )
        for f in fits
    ]
    each = search.errors.log_evidences(ones)
    return fits[int(np.argmax(each))], float(logsumexp(each) - np.log(len(each)))


# ---- what was learned -------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Learned:
    """A family's function with its 90 % band, and what is said of it."""

    family: LearnedEffect
    x: Array
    y: Array
    low: Array
    high: Array
    sentence: str  # what kind of thing it is
    share_of_gap: float
    nearest: tuple[str, ...]


def describe_learned(
    base: Fit,
    found: Found,
    candidate: Candidate,
    posterior: Posterior,
    share_of_gap: float,
) -> Learned:
    """Return what a learned explanation says."""
    (one,) = [f for f in families() if f.name in set(candidate.effects) - set(base.effects)]
    seen = seen_in(found.records, base)
    if one.own_of_each:
        known = [k for k in posterior.unknowns.known if k.effect == one.name]
        (hz,) = [k.value for k in known if k.parameter == one.range_name]
        seen = replace(seen, time_s=min(seen.time_s, 1.0 / hz))
        left = np.concatenate([left_mm for _, left_mm in seen.left])
        share_of_gap = 0.5e-6 * sum(k.sd**2 for k in known) / float(np.mean(left**2))
        share_of_gap = min(share_of_gap, 1.0)
    each = [posterior.unknowns.values(u)[one.name] for u in posterior.u]
    with EFFECTS.at_work(one.name):
        x = one.abscissa(seen)
        functions = [one.function(x, values) for values in each]
        for function in functions:
            check_series("function", function, x.shape, x)
        draws = one.shown(x, np.array(functions))
        check_series("shown", draws, (len(each), *x.shape), x)
        low, y, high = (_quantile(draws, posterior.weight, q) for q in (0.05, 0.5, 0.95))
        says: object = one.sentence(x, y)
        if not isinstance(says, str):
            raise TypeError(f"sentence returned {says!r}; expected a text")
    sentence, nearest = f"something that {says}", _nearest(base, found, candidate)
    return Learned(one, x, y, low, high, sentence, share_of_gap, nearest)


def _quantile(draws: Array, weight: Array, q: float) -> Array:
    """Return weighted quantiles (m,) of draws (n, m)."""
    order = np.argsort(draws, axis=0)
    total = np.cumsum(weight[order], axis=0)
    at = np.minimum((total < q).sum(axis=0), len(draws) - 1)
    return np.asarray(np.take_along_axis(draws, np.take_along_axis(order, at[None], 0), 0)[0])


def _nearest(base: Fit, found: Found, candidate: Candidate) -> tuple[str, ...]:
    """Return the named effect that changes the curves most alike; none where none does."""
    change = found.errors.whiten(
        np.concatenate(candidate.fit.deflections_mm) - np.concatenate(base.deflections_mm)
    )

    def cosine(s: Signature) -> float:
        along = abs(float(s.direction[: len(change)] @ change))
        return along / max(s.size * float(np.linalg.norm(change)), 1e-12)

    near = [s for s in found.signatures.values() if s.size > 0 and cosine(s) >= NAMES.near]
    return tuple(s.effect for s in sorted(near, key=cosine, reverse=True)[:1])
