"""The gap: how well a fit to the other conditions predicts one that it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.fit import Fit, Fitter, Kept
from skinlab.discrepancy.settings import FITS, NAMES
from skinlab.discrepancy.space_mapping import MappedModel
from skinlab.inference.covariance import Covariance

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Part:
    """Samples (u,) that are held out together, their errors, and all others."""

    out: NDArray[np.bool_]
    errors: Covariance
    kept: Kept

    @classmethod
    def of(cls, fitter: Fitter, out: NDArray[np.bool_]) -> Part:
        """Return these samples as a part of what a fitter has."""
        return cls(out, fitter.errors.only(out), fitter.kept(~out))

    def covariance(self, errors: Covariance, fit: Fit) -> Array:
        """Return the covariance (k, k) of a fit's unknowns without these samples."""
        slopes = errors.colour(fit.jacobian)[self.kept.samples]
        kept = self.kept.errors.whiten(slopes)
        prior = fit.information - fit.jacobian.T @ fit.jacobian
        return np.asarray(np.linalg.inv(kept.T @ kept + prior))

    def spread(self, errors: Covariance, fit: Fit) -> float:
        """Return χ² of these samples that the doubt without them adds, which is linear in them."""
        reach = self.errors.whiten(errors.colour(fit.jacobian)[self.out])
        return float(np.einsum("nj,jk,nk->", reach, self.covariance(errors, fit), reach))

    def tells_alone(self, errors: Covariance, fit: Fit) -> bool:
        """Return whether an effect's unknown is hardly better known than its prior without it."""
        deviations = np.sqrt(np.diag(self.covariance(errors, fit)))
        most = [NAMES.known * axis.prior[1] for axis in fit.unknowns.axes]
        of_effects = slice(fit.unknowns.count, None)
        lost = deviations[of_effects] > most
        return bool((lost & (fit.deviations[of_effects] <= most)).any())


@dataclass(frozen=True)
class HeldOut:
    """Gaps over whole conditions, each left out of its fit in turn.

    Root mean squares weighed by the errors: of independent errors the plain ones; what a placement
    or a slow error may have done counts by how improbable it is. A perfect model leaves the noise.
    `plain_um` is not weighed: all that the prediction is off by.
    """

    rms_um: float
    noise_um: float  # what a perfect model would leave
    expected_um: float  # the same of one whose unknowns the other conditions have to tell
    files: tuple[str, ...]  # empty where there is one condition only: then of the fit itself
    plain_um: float

    @property
    def as_expected(self) -> bool:
        """Whether what was left out is predicted no worse than a perfect model would: no gap."""
        return bool(self.files) and self.rms_um <= self.expected_um


def conditions_of(fitter: Fitter, fits: Sequence[Fit]) -> list[Part]:
    """Return what is held out, in turn: whole conditions.

    A condition that alone tells an unknown of one of the fits cannot be predicted by anybody
    without it (the softening, of the only later cycle): its phases are held out instead. Empty
    where there is one condition only.
    """
    records = fitter.records
    names = np.array([i for i, r in enumerate(records) for _ in range(len(r.curve))])
    phases = np.concatenate([r.curve.phase for r in records])
    conditions = list(dict.fromkeys(r.condition for r in records))
    if len(conditions) < 2:
        return []
    found: list[Part] = []
    for condition in conditions:
        members = [i for i, r in enumerate(records) if r.condition == condition]
        whole = Part.of(fitter, np.isin(names, members))
        if not any(whole.tells_alone(fitter.errors, fit) for fit in fits):
            found.append(whole)
            continue
        each = [whole.out & (phases == phase) for phase in dict.fromkeys(phases[whole.out])]
        if len(each) > 1:
            parts = [Part.of(fitter, out) for out in each]
            found += [p for p in parts if not any(p.tells_alone(fitter.errors, f) for f in fits)]
    return found


def predict_held_out(fitter: Fitter, fit: Fit, parts: Sequence[Part]) -> HeldOut:
    """Return the gap of an explanation over these parts, of `conditions_of`.

    Only its unknowns are fitted again: the model stays anchored at the fit to all curves, unless it
    fails there. With nothing to hold out the gap is that of the fit.
    """
    errors, measured = fitter.errors, fitter.measured
    noise = errors.noise_um
    if not parts:
        off = np.concatenate(fit.deflections_mm) - measured
        z = errors.whiten(off)
        return HeldOut(noise * float(np.sqrt(np.mean(z**2))), noise, noise, (), _plain_um(off))
    model = fitter.model(fit.unknowns)
    fitter.prepare(model, fit.u, slopes=True)
    low, high = fit.unknowns.bounds
    space = fit.unknowns.space
    radius = np.full(len(fit.u), FITS.refit_radius)
    for i, transform in enumerate(space.transforms):
        if transform == "linear":
            radius[i] = FITS.refit_reaches * fit.unknowns.reaches[i]
    low, high = np.maximum(low, fit.u - radius), np.minimum(high, fit.u + radius)
    left, doubt, plain = 0.0, 0.0, 0.0
    held = np.zeros(len(measured), dtype=bool)
    for part in parts:
        spread = part.spread(errors, fit)
        most = NAMES.held_out_ratio**2 * (int(part.out.sum()) + spread)
        off, there = _off(fitter, model, fit, (low, high), part, most)
        if there is not fit:  # what the others tell little of may lie where they tell even less
            spread = max(spread, part.spread(errors, there))
        z = part.errors.whiten(off)
        left += float(z @ z)
        plain += float(off @ off)
        doubt += spread
        held |= part.out
    n = int(held.sum())
    split = errors.split(held)
    files = tuple(r.name for r, out in zip(fitter.records, split, strict=True) if out.any())
    return HeldOut(
        noise * float(np.sqrt(left / n)),
        noise,
        noise * float(np.sqrt(1.0 + doubt / n)),
        files,
        1e3 * float(np.sqrt(plain / n)),
    )


def _off(
    fitter: Fitter,
    model: MappedModel,
    fit: Fit,
    box: tuple[Array, Array],
    part: Part,
    most: float,
) -> tuple[Array, Fit]:
    """Return by how much a part is off (u,), mm, that is predicted without it, and from where.

    That is the fit, or one with the slopes of where the finite elements were asked last. Where χ²
    by the part's errors is above `most` they are asked again where the others lead: a layer below
    was moved by half of a typical size, where slopes at the first place are off by 30 µm.
    """
    at = fit.u
    for _ in range(FITS.refit_anchors):
        at = fitter.minimise(model, at, *box, part.kept)
        off = np.asarray((np.concatenate(model.predict(at)) - fitter.measured)[part.out])
        if not model.corrected or float(np.square(part.errors.whiten(off)).sum()) <= most:
            break
        model = model.exact()
        if not model.anchor(at):
            break
        fit = replace(fit, u=at, jacobian=fitter.jacobian(model, at))
    return off, fit


def _plain_um(off_mm: Array) -> float:
    return 1e3 * float(np.sqrt(np.mean(off_mm**2)))
