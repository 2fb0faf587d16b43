"""The pieces of a search that can be done side by side, in other processes (`skinlab.workers`).

The fitter is their state, and goes to each process once; a task is what is new, and small.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.fit import NO_LIMIT, Fit, Fitter, Limit
from skinlab.discrepancy.screen import NOT_HELD, Signature, signature
from skinlab.discrepancy.settings import FITS
from skinlab.discrepancy.starts import middle_of
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.errors import BrokenPluginError
from skinlab.inference.covariance import Covariance
from skinlab.mechanics.effects import EFFECTS, get_effect

Array = NDArray[np.float64]


def signature_of(fitter: Fitter, task: tuple[Fit, str]) -> Signature | str:
    """Return the signature of an effect at a fit, or why there is none.

    An installed effect that breaks down has none; the others are still looked at.
    """
    fit, effect = task
    try:
        found = signature(fitter, fit, effect)
    except Exception as error:
        origin = EFFECTS.origin(effect)
        if origin is None:
            raise
        why = error.__cause__ if isinstance(error, BrokenPluginError) else error
        return f"plugin {origin.distribution} broke down: {type(why).__name__}: {why}"
    return NOT_HELD if found is None else found


def signature_by(fitter: Fitter, task: tuple[Fit, str, Covariance]) -> Signature | str:
    """Return the signature of an effect at a fit by other errors than those of the fitter."""
    fit, effect, errors = task
    other = fitter.with_errors(fitter.records, errors)
    return signature_of(other, (fit.with_errors(fitter.errors, errors), effect))


def fit_from(fitter: Fitter, task: tuple[Unknowns, Array, Limit]) -> Fit | None:
    """Return a fit from a start (k,), that ends early where it stays above a cost."""
    return fitter.fit(*task)


def fit_from_by(fitter: Fitter, task: tuple[Unknowns, Array, Covariance]) -> Fit | None:
    """Return a fit from a start (k,) by other errors, as it counts by the fitter's own."""
    unknowns, start, errors = task
    fit = fitter.with_errors(fitter.records, errors).fit(unknowns, start)
    return None if fit is None else fitter.by_own_errors(fit, errors)


def fit_on(fitter: Fitter, fit: Fit) -> Fit:
    """Return a fit gone on with from where it ended, and from the middle of the law's ranges.

    A creep of 0.35 beside a gain had ended 840 above its optimum, where the creep alone had led.
    """
    known = _better(fitter.fit(fit.unknowns, fit.u), fit) or fit
    start = known.u.copy()
    start[: known.unknowns.count] = middle_of(known.unknowns)
    return _better(_from_there(fitter, known, start), known) or known


def fit_by(fitter: Fitter, task: tuple[Fit, Covariance]) -> Fit:
    """Return a fit moved to the optimum by other errors."""
    return fitter.sharpened(*task)


def _start(
    fit: Fit, unknowns: Unknowns, seen: Signature, share: float, stiffer: float = 0.0
) -> Array:
    """Return a fit's unknowns with one more effect, at a share of the size that is expected."""
    own = [share * seen.amount if i == seen.which else at for i, at in enumerate(seen.beside)]
    low, high = unknowns.bounds
    start = np.concatenate([fit.u, own])
    space = unknowns.space
    for i, transform in enumerate(space.transforms):
        if i != space.scale and transform != "linear":  # of how it stiffens, not how stiff it is
            start[i] += stiffer
    return np.asarray(np.clip(start, low, high))


def fit_elsewhere(fitter: Fitter, task: tuple[Fit, Signature, Fit | None]) -> Fit | None:
    """Return the best fit with one more effect from the starts that `fit_one` does not take.

    What is told with the task is a fit that is known.
    """
    fit, seen, known = task
    found = _from_other_sizes(fitter, fit, seen, known)
    nearest = _better(found, known)
    if nearest is None:
        return found
    # All these began with the law of the fit without the effect: a creep of 370 µm, begun there,
    # ended in a valley that is 720 above another one.
    start = _from_the_middle(fit, seen, nearest)
    return _better(_from_there(fitter, nearest, start), found)


def unscreened_start(fit: Fit, effect: str) -> tuple[Unknowns, Array]:
    """Return where a fit with one more effect begins that was not screened: at its usual size."""
    unknowns = fit.unknowns.with_effect(effect)
    own = unknowns.axes[len(fit.u) - unknowns.count :]
    sizes = [0.0 if axis.parameter.zero is None else FITS.levels[0] for axis in own]
    start = np.concatenate([fit.u, sizes])
    start[: unknowns.count] = middle_of(unknowns)
    return unknowns, np.clip(start, *unknowns.bounds)


def _from_the_middle(fit: Fit, seen: Signature, nearest: Fit) -> Array:
    """Return where a fit ended, with the law in the middle of its ranges.

    Of an effect of which nothing was left with the size that is expected.
    """
    unknowns = nearest.unknowns
    start = _start(fit, unknowns, seen, 1.0) if _is_nothing(seen, nearest) else nearest.u.copy()
    start[: unknowns.count] = middle_of(unknowns)
    return start


def _is_nothing(seen: Signature, found: Fit) -> bool:
    """Return whether nothing is left of the effect that was added last."""
    own = found.unknowns.axes[-len(seen.axes) :]
    size = found.u[len(found.u) - len(own) + seen.which]
    return own[seen.which].parameter.zero is not None and abs(size) < FITS.at_bound


def _from_other_sizes(fitter: Fitter, fit: Fit, seen: Signature, known: Fit | None) -> Fit | None:
    unknowns = fit.unknowns.with_effect(seen.effect)
    best: Fit | None = None
    alike = 0
    for share, stiffer in FITS.elsewhere:
        start = _start(fit, unknowns, seen, share, stiffer)
        found = fitter.fit(unknowns, start, known=known)
        alike += known is not None and _agree(found, known.cost)
        best, known = _better(found, best), _better(found, known)
        if best is not None and (
            best.chi2 < FITS.hopeless * fitter.errors.count or alike >= FITS.alike
        ):
            return best
    return _continued(fitter, fit, seen, best, known)


def _continued(
    fitter: Fitter, fit: Fit, seen: Signature, best: Fit | None, known: Fit | None
) -> Fit | None:
    """Return the best fit along the effect's amplitude, each begun where the last one ended.

    A strong effect lies beyond the linear reach of the base model's fit.
    """
    unknowns = fit.unknowns.with_effect(seen.effect)
    low, high = unknowns.bounds
    size = len(fit.u) + seen.which
    at = _start(fit, unknowns, seen, FITS.shares[0]) if best is None else best.u
    sign = -1.0 if seen.amount < 0 else 1.0
    for level in FITS.levels:
        start = at.copy()
        start[size] = np.clip(sign * level, low[size], high[size])
        found = fitter.fit(unknowns, start, known=known)
        if found is None:
            continue
        at = found.u
        best, known = _better(found, best), _better(found, known)
        if best is not None and best.chi2 < FITS.hopeless * fitter.errors.count:
            break
    return best


def fit_one(fitter: Fitter, task: tuple[Fit, Signature, Limit]) -> Fit | None:
    """Return a fit with one more effect, from the size that the screen expects, or others."""
    fit, seen, limit = task
    unknowns = fit.unknowns.with_effect(seen.effect)
    best: Fit | None = None
    for share in FITS.shares:
        found = fitter.fit(unknowns, _start(fit, unknowns, seen, share), limit, best)
        # Two starts that come to the same: so would a third. Beside what explains, it is enough
        # that the second one is no better, or that neither comes near.
        enough = best is not None and (
            _agree(found, best.cost)
            or (
                math.isfinite(limit.first)
                and (found is None or found.cost > FITS.again * best.cost)
            )
            or _far_off(fitter, fit, min((best, found or best), key=lambda f: f.cost), limit)
        )
        best = _better(found, best)
        # An effect that does not take away what the screen expected may have been misled.
        if best is not None and (
            best.chi2 < FITS.hopeless * fitter.errors.count
            or (best.settled and best.cost < fit.cost - 0.5 * seen.gain)
            or enough
        ):
            break
    best = _from_usual(fitter, fit, seen, best, limit)
    if best is not None and _is_nothing(seen, best):
        # Where the law had ended near the end of a range a stiffening of 40 MPa came to nothing in
        # one step, of which the screen saw a third; from the middle it gains 132.
        start = _from_the_middle(fit, seen, best)
        best = _better(_from_there(fitter, best, start, limit), best)
    if best is None or _far_off(fitter, fit, best, limit):
        return best
    return off_the_wall(fitter, best, limit)


def _far_off(fitter: Fitter, base: Fit, best: Fit, limit: Limit) -> bool:
    """Return whether an effect leaves so much of what another one explains that it may end.

    Of what is small nothing can be told by that: a fit at a wall left 23 more than another effect,
    and 9 less when it was begun off the wall.
    """
    large = best.chi2 > FITS.far_off_times * fitter.errors.count
    return large and best.cost - limit.first > FITS.far_off * (base.cost - limit.first)


def _from_usual(
    fitter: Fitter, fit: Fit, seen: Signature, best: Fit | None, limit: Limit
) -> Fit | None:
    """Return the fit; where the screen expects little of what has a shape, from its usual size.

    A layer ten times as thin and as stiff is another valley, with a wall between: the screen is
    linear at no layer at all, and leads into the wrong one.
    """
    small = abs(seen.amount) < FITS.small and len(seen.beside) > 1
    if not small or (best is not None and best.chi2 < fitter.errors.count):
        return best
    unknowns = fit.unknowns.with_effect(seen.effect)
    size = math.copysign(FITS.levels[0], seen.amount)
    start = _start(fit, unknowns, replace(seen, amount=size), 1.0)
    return _better(fitter.fit(unknowns, start, limit, best), best)


def _better(found: Fit | None, known: Fit | None) -> Fit | None:
    """Return the fit that costs less, the one that is known where neither does."""
    return found if known is None or (found is not None and found.cost < known.cost) else known


def _agree(found: Fit | None, cost: float) -> bool:
    """Return whether a fit that explains nothing has come to the same as another one."""
    return found is not None and abs(found.cost - cost) < FITS.agree * cost


def off_the_wall(fitter: Fitter, best: Fit, limit: Limit) -> Fit:
    """Return the fit; where the law is near the end of a range, from the middle of it, if better.

    A model that lacks something may end there, and what is then added keeps it there.
    """
    walled = at_wall(best)
    if not walled.any():
        return best
    return _better(_from_there(fitter, best, _amid(best, walled), limit), best) or best


def held_off_the_wall(fitter: Fitter, fit: Fit) -> Fit | None:
    """Return the fit with what is near the end of a range held in the middle of it; or None.

    What a model lacks may have led it to a wall, from where its partner is not seen: beside a creep
    at ν 0.498 a stiffening promised 3, less than eight others; beside the same at 0.25 the most.
    """
    walled = at_wall(fit)
    if not walled.any():
        return None
    unknowns, start = fit.unknowns, _amid(fit, walled)
    for share in FITS.ways:
        begin = fit.u + share * (start - fit.u)
        found = fitter.fit(unknowns.holding(begin, np.flatnonzero(walled).tolist()), begin)
        if found is not None:
            freed = np.square(unknowns.prior_rows(found.u)).sum()
            return replace(found, unknowns=unknowns, cost=found.chi2 + float(freed))
    return None


def at_wall(fit: Fit) -> NDArray[np.bool_]:
    """Return which of the law's parameters (count,) are near the end of their range.

    A logarithm counts where it is at its bound alone.
    """
    unknowns = fit.unknowns
    low, high = unknowns.bounds
    law = slice(0, unknowns.count)
    linear = np.array([t == "linear" for t in unknowns.space.transforms])
    margin = np.minimum(fit.u - low, high - fit.u)[law] / (high - low)[law]
    bends = any(get_effect(axis.effect).curved for axis in unknowns.axes)
    near = FITS.near_end_curved if bends else FITS.near_end
    return (linear & (margin < near)) | ~fit.free[law]


def _amid(fit: Fit, walled: NDArray[np.bool_]) -> Array:
    """Return a fit's unknowns (k,), with what is near the end of a range in the middle of it."""
    unknowns = fit.unknowns
    low, high = unknowns.bounds
    law = slice(0, unknowns.count)
    start = fit.u.copy()
    start[law] = np.where(walled, 0.5 * (low + high)[law], start[law])
    # Of nothing of an effect the finite elements are not asked what a little would do.
    sizes = np.array([a.parameter.zero is not None for a in unknowns.axes], dtype=bool)
    own = start[unknowns.count :]
    little = np.where(high[unknowns.count :] > 0.0, FITS.little, -FITS.little)
    own[:] = np.where(sizes & (own == 0.0), little, own)
    return start


def _from_there(fitter: Fitter, nearest: Fit, start: Array, limit: Limit = NO_LIMIT) -> Fit | None:
    """Return the fit from a start; where it has no model, from part of the way to where one ended.

    The middle of the ranges may have none: a soft skin with ν 0.25 never reaches the suction. A lag
    that was begun there alone stayed at ν 0.499, 71 above its optimum, and was called a creep.
    """
    for share in FITS.ways:
        begin = nearest.u + share * (start - nearest.u)
        found = fitter.fit(nearest.unknowns, begin, limit, nearest)
        if found is not None:
            return found
    return None
