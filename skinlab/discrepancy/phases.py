"""A motion in step with the curves, told from a breath or pulse of phases alike by chance.

A pump or a regulator that hunts begins with the suction. Where its frequency is as well that of a
breath or a pulse, phases of curves have to tell: nine that happen to be alike look as the motion
in step does, at any of the frequencies that were tried.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import i0e, i1e, ndtr

from skinlab.discrepancy.campaign_errors import Linearised
from skinlab.discrepancy.fit import Fit
from skinlab.discrepancy.records import Record
from skinlab.discrepancy.settings import NAMES
from skinlab.inference.covariance import Covariance, block_diagonal
from skinlab.inference.error_models import breathing, pulse

Array = NDArray[np.float64]

IN_STEP = "periodic_motion"  # the effect that has the same phase in every curve
_LIVING = (breathing.ERROR_MODEL, pulse.ERROR_MODEL)
_WIDER = 1.3  # beyond a band's ends: curves whose frequencies differ have one beside all of them
_FAR = 1e6  # of a saddle point: a sum that is all but the largest there is


def out_of_step(fit: Fit, linear: Linearised, errors: Covariance, records: Sequence[Record]) -> str:
    """Return why a fit's motion in step may be a breath or a pulse; "" where it is none.

    `linear` is the explanation about its fit.
    """
    hz = fit.unknowns.values(fit.u)[IN_STEP]["frequency_hz"]
    who = next((m.what for m in _LIVING if m.low_hz / _WIDER <= hz <= _WIDER * m.high_hz), "")
    if not who:
        return ""
    waves = _waves_of_each(fit, linear, errors, records, hz)
    chance = chance_of_phases(*waves)
    if chance <= NAMES.alike_by_chance:
        return ""
    return (
        f"a motion of {hz:.2g} Hz may be {who}: whether it is in step with the curves, their "
        f"phases do not tell (p {chance:.2g})"
    )


def _waves_of_each(
    fit: Fit, linear: Linearised, errors: Covariance, records: Sequence[Record], hz: float
) -> tuple[Array, Array]:
    """Return what each curve has of the motion, by least squares beside all other unknowns.

    Cosine of its phase against the motion in step (curves,), and its size in standard deviations.
    """
    angles = [2.0 * np.pi * hz * (r.curve.time_s - r.curve.time_s[0]) for r in records]
    waves = block_diagonal([np.column_stack([np.sin(a), np.cos(a)]) for a in angles])
    k = fit.unknowns.count
    mine = np.array([*np.zeros(k, dtype=bool), *(a.effect == IN_STEP for a in fit.unknowns.axes)])
    others = linear.slopes_mm[:, linear.free & ~mine]
    amplitude_mm = 1e-3 * fit.unknowns.values(fit.u)[IN_STEP]["amplitude_um"]
    target = linear.residual_mm + amplitude_mm * np.concatenate([np.sin(a) for a in angles])
    white = errors.whiten(np.column_stack([waves, others, target]))
    columns, y = white[:, :-1], white[:, -1]
    length = np.sqrt(np.square(columns).sum(axis=0))
    inverse = np.linalg.pinv((columns / length).T @ (columns / length), hermitian=True)
    found = (inverse @ ((columns / length).T @ y)) / length
    variance = np.diag(inverse) / length**2
    n = 2 * len(records)
    each, spread = found[:n].reshape(-1, 2), variance[:n].reshape(-1, 2)
    size = np.hypot(each[:, 0], each[:, 1])
    sign = math.copysign(1.0, amplitude_mm)
    return sign * each[:, 0] / size, size / np.sqrt(spread.mean(axis=1))


def chance_of_phases(cosines: Array, sizes: Array) -> float:
    """Return how often phases of chance are so much alike as these, to either side.

    Of Σ w cos φ with independent uniform φ, w the sizes up to `NAMES.phase_known`: larger ones tell
    a phase no better. Its tail by a saddle point (Lugannani and Rice 1980).
    """
    w = np.minimum(sizes, NAMES.phase_known)
    total, most = float(w @ cosines), float(w.sum())
    if total <= 1e-3 * most:
        return 1.0

    def ratio(t: float) -> Array:
        return np.asarray(i1e(w * t) / i0e(w * t))

    def slope(t: float) -> float:
        return float(w @ ratio(t)) - total

    far = _FAR / float(w.min())
    if slope(far) <= 0.0:
        return 0.0
    t = float(brentq(slope, 0.0, far))
    bent = float(np.square(w) @ (1.0 - ratio(t) ** 2) - (w @ ratio(t)) / t)
    log_mean = float(np.sum(np.log(i0e(w * t)) + w * t))
    r = math.sqrt(2.0 * max(t * total - log_mean, 0.0))
    u = t * math.sqrt(bent)
    tail = float(ndtr(-r)) + math.exp(-0.5 * r * r) / math.sqrt(2.0 * math.pi) * (1.0 / u - 1.0 / r)
    return min(1.0, 2.0 * max(tail, 0.0))
