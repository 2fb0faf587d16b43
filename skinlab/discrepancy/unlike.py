"""Curves that contradict what a model says of the size of its own effects."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from skinlab.discrepancy.fit import Fit, Fitter
from skinlab.discrepancy.posterior import Posterior
from skinlab.discrepancy.search import Search
from skinlab.discrepancy.settings import NAMES
from skinlab.discrepancy.unknowns import Axis, Unknowns


def contradicted(fitter: Fitter, fit: Fit) -> list[str]:
    """Return the effects of which a fit without the model's priors of them is far better.

    Another skin may have an effect of another size: a stretch of 1.6 % ± 0.04 % that was learned on
    one skin made X2 a third of what it was on one with 3.2 %, and the misfit was called placement.
    """
    unknowns = fit.unknowns
    own = _told(unknowns)
    if not own:
        return []
    free = tuple(k if k.stated else replace(k, sd=0.0) for k in unknowns.known)
    other = fitter.near(replace(fit, unknowns=replace(unknowns, known=free)))
    if other is None or fit.cost - other.cost < NAMES.contradicted:
        return []
    far = {
        axis.effect
        for axis, u in zip(unknowns.axes, other.u[unknowns.count :], strict=True)
        if axis in own and (u - axis.prior[0]) ** 2 > NAMES.contradicted * axis.prior[1] ** 2
    }
    return sorted(far)


def contradicted_by(search: Search, base: Fit) -> list[str]:
    """Return the same of the fit of the model as it is, by the errors as it sees them."""
    return contradicted(*search.as_last_seen(base)) if _told(base.unknowns) else []


def still_contradicted(said: Unknowns, effects: Collection[str], found: Posterior) -> bool:
    """Return whether one of these effects is of another size than a model said, in an answer.

    `said` holds the model's priors; the answer was found without them. What is missing may have
    seemed to be another size of what is there.
    """
    axes = {axis.name: i for i, axis in enumerate(found.unknowns.axes, found.unknowns.count)}
    middle, sd = found.weight @ found.u, found.deviations
    for axis in _told(said):
        (mean, known), i = axis.prior, axes[axis.name]
        far = (middle[i] - mean) ** 2 > NAMES.contradicted * (known**2 + sd[i] ** 2)
        if far and axis.effect in effects:
            return True
    return False


def _told(unknowns: Unknowns) -> list[Axis]:
    """Return the axes of whose size a model says something."""
    return [a for a in unknowns.axes if a.known and a.known.sd > 0.0 and not a.known.stated]
