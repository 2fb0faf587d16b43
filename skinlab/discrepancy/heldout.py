"""The gap: how well a fit to the other conditions predicts one that it has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from skinlab.discrepancy.fit import Fit, Fitter
from skinlab.discrepancy.misfit import Errors, errors_of

Array = NDArray[np.float64]

_RADIUS = 1.0  # how far a refit may go from the whole fit: log X1, log X2/X1, typical sizes
_NU_RADIUS = 0.15
_NO_MODEL = 1e3


@dataclass(frozen=True)
class HeldOut:
    """Root mean squares over whole conditions, each left out of its fit in turn."""

    rms_um: float
    noise_um: float  # what a perfect model would leave
    files: tuple[str, ...]  # empty where there is one condition only: then of the fit itself


def predict_held_out(fitter: Fitter, fit: Fit) -> HeldOut:
    """Return the gap of an explanation.

    The model stays anchored at the fit to all curves; only its unknowns are fitted again. With one
    condition there is nothing to hold out, and the gap is that of the fit.
    """
    records, sigma = fitter.records, fitter.errors.sigma_mm
    conditions = list(dict.fromkeys(r.condition for r in records))
    measured = fitter.errors.split(fitter.measured)
    if len(conditions) < 2:
        off = np.concatenate(fit.deflections_mm) - fitter.measured
        return HeldOut(_rms_um(off), _rms_um(sigma), ())
    model = fitter.model(fit.unknowns)
    fitter.prepare(model, fit.u, slopes=True)
    left: list[Array] = []
    for condition in conditions:
        kept = [i for i, r in enumerate(records) if r.condition != condition]
        errors = errors_of([records[i] for i in kept])
        goal = np.concatenate([measured[i] for i in kept])

        def residuals(
            u: Array, kept: list[int] = kept, goal: Array = goal, errors: Errors = errors
        ) -> Array:
            predicted = model.predict(u)
            off = np.concatenate([predicted[i] for i in kept]) - goal
            if not np.isfinite(off).all():
                return np.full(len(goal) + len(u) - 3, _NO_MODEL)
            return np.concatenate([errors.whiten(off), fit.unknowns.prior_rows(u)])

        low, high = fit.unknowns.bounds
        radius = np.full(len(fit.u), _RADIUS)
        radius[2] = _NU_RADIUS
        low, high = np.maximum(low, fit.u - radius), np.minimum(high, fit.u + radius)
        span = np.maximum(high - low, 1e-9)
        start = np.clip(fit.u, low + 1e-6 * span, high - 1e-6 * span)
        found = least_squares(
            residuals, start, bounds=(low, high), x_scale=np.minimum(span, 1.0), max_nfev=25,
            xtol=1e-6, ftol=1e-6, diff_step=np.full(len(start), 1e-4),
        )  # fmt: skip
        predicted = model.predict(found.x)
        left += [
            predicted[i] - measured[i] for i, r in enumerate(records) if r.condition == condition
        ]
    off = np.concatenate(left)
    return HeldOut(_rms_um(off[np.isfinite(off)]), _rms_um(sigma), tuple(r.name for r in records))


def _rms_um(values_mm: Array) -> float:
    return 1e3 * float(np.sqrt(np.mean(values_mm**2)))
