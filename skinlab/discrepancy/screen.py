"""A first look at every effect: how well its signature fits what is left.

The signature of an effect is what a typical size of it changes in the curves, after projecting out
what the law's parameters (and the effects already there) can absorb: the score test. It costs a
handful of elastic finite-element solutions an effect, and no fit; relaxation is approximate here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.fit import Fit, Fitter
from skinlab.discrepancy.unknowns import Axis, Unknowns
from skinlab.mechanics.effects import get_effect

Array = NDArray[np.float64]

_SIZES = (0.3, 0.1, 0.03)  # of a typical one: about linear; the first that the skin bears
NO_MODEL = "its model does not hold for these skins, even at 3 % of a typical size"
_INVISIBLE = 1e-2  # standard deviations: a signature so small cannot be seen at all


@dataclass(frozen=True, eq=False)
class Signature:
    """What an effect would do to a fit's residual, linearised."""

    effect: str
    axes: tuple[Axis, ...]  # of the effect
    direction: Array  # (n,) whitened, for one typical size, absorbed parts taken out
    size: float  # its length: standard deviations at a typical size
    amount: float  # best size, in typical ones
    gain: float  # by which χ² would fall
    absorbed: float  # share of the raw signature that the fit's unknowns absorb
    which: int = 0  # of the axes: the effect's size
    beside: tuple[float, ...] = ()  # the unknowns of all axes, as they were screened

    @property
    def detectable(self) -> float:
        """Size, in typical ones, that raises χ² by 25: five standard deviations."""
        return 5.0 / self.size if self.size > _INVISIBLE else float("inf")


def signature(fitter: Fitter, fit: Fit, effect: str) -> Signature | None:
    """Return an effect's signature at a fit, None where its model does not hold there."""
    unknowns = fit.unknowns.with_effect(effect)
    axes = unknowns.axes[len(fit.unknowns.axes) :]
    # Without the correction of what relaxes, which takes most of the time of an anchor.
    without = fitter.model(fit.unknowns)
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
    found = [_along(fitter, fit, here, unknowns, own, i) for own in product(*beside) for i in sized]
    held = [s for s in found if s is not None]
    # Where several of its parameters have a zero, it is the one that explains most.
    return max(held, key=lambda s: (s.gain, s.size)) if held else None


def _along(
    fitter: Fitter,
    fit: Fit,
    here: Array,
    unknowns: Unknowns,
    own: tuple[float, ...],
    which: int,
) -> Signature | None:
    """Return the signature of one of an effect's parameters."""
    axes = unknowns.axes[len(fit.unknowns.axes) :]
    axis, effect = axes[which], axes[which].effect
    for size in _SIZES:
        step = size * axis.to_u(axis.parameter.typical)
        some = np.concatenate([fit.u, own])
        some[len(fit.u) + which] += step
        model = fitter.model(unknowns)
        if fitter.prepare(model, some, memory=False):
            there = np.concatenate(model.predict(some))
            if np.isfinite(there).all():
                break
    else:
        return None
    raw = fitter.errors.whiten(there - here) / step
    residual = fitter.errors.whiten(fitter.measured - np.concatenate(fit.deflections_mm))
    basis = np.linalg.qr(_with_priors(fit))[0][: len(raw)]
    direction = raw - basis @ (basis.T @ raw)
    length = float(np.linalg.norm(direction))
    whole = float(np.linalg.norm(raw))
    if length < _INVISIBLE:
        absorbed = 1.0 if whole > _INVISIBLE else 0.0
        return Signature(effect, axes, direction, length, 0.0, 0.0, absorbed, which, own)
    amount = float(direction @ residual) / length**2
    low, high = axis.bounds
    amount = float(np.clip(amount, low, high))
    gain = 2.0 * amount * float(direction @ residual) - amount**2 * length**2
    absorbed = 1.0 - length / max(whole, 1e-12)
    return Signature(effect, axes, direction, length, amount, max(gain, 0.0), absorbed, which, own)


def _with_priors(fit: Fit) -> Array:
    priors = fit.unknowns.prior_slopes(fit.u)
    return np.vstack([fit.jacobian, priors])[:, fit.free]  # what is at a bound absorbs nothing


def alike(signatures: Mapping[str, Signature]) -> list[tuple[str, str]]:
    """Return pairs of effects whose signatures no data of this kind can tell apart."""
    names = sorted(n for n, s in signatures.items() if s.size > _INVISIBLE)
    found = []
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            a, b = signatures[one], signatures[other]
            cosine = abs(float(a.direction @ b.direction)) / (a.size * b.size)
            if cosine > 0.9995:
                found.append((one, other))
    return found
