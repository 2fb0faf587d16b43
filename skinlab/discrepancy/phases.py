"""A motion in step with the curves, told from a breath or pulse of phases alike by chance.

A pump or a regulator that hunts begins with the suction. Where its frequency is as well that of a
breath or a pulse, phases of curves have to tell: nine that happen to be alike look as the motion
in step does, at any of the frequencies that were tried.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import i0e, i1e, ndtr

from skinlab.discrepancy.campaign_errors import Linearised
from skinlab.discrepancy.fit import Fit
from skinlab.discrepancy.records import Record
from skinlab.discrepancy.settings import NAMES
from skinlab.inference.covariance import Covariance, block_diagonal
from skinlab.inference.error_choice import ErrorChoice
from skinlab.inference.error_models import breathing, pulse
from skinlab.inference.error_models.periodic import Periodic

Array = NDArray[np.float64]

IN_STEP = "periodic_motion"  # the effect that has the same phase in every curve
_LIVING = (breathing.ERROR_MODEL, pulse.ERROR_MODEL)
_WIDER = 1.3  # beyond a band's ends: curves whose frequencies differ have one beside all of them
_TINY = 1e-12
_FAR = 1e6  # of a saddle point: a sum that is all but the largest there is


def out_of_step(fit: Fit, linear: Linearised, look: ErrorChoice, records: Sequence[Record]) -> str:
    """Return why a fit's motion in step may be a breath or a pulse; "" where it is none.

    `linear` is the explanation about its fit, `look` what the errors may be.
    """
    hz = fit.unknowns.values(fit.u)[IN_STEP]["frequency_hz"]
    who = next((one.what for one in _LIVING if _like(one, hz)), "")
    if not who:
        return ""
    chance = _of_each(fit, linear, still_errors(look), records, hz).chance
    if chance <= NAMES.alike_by_chance:
        return ""
    return (
        f"a motion of {hz:.2g} Hz may be {who}: whether it is in step with the curves, their "
        f"phases do not tell (p {chance:.2g})"
    )


def begun_in_step(
    fit: Fit, linear: Linearised, look: ErrorChoice, records: Sequence[Record]
) -> Iterator[dict[str, float]]:
    """Yield motions in step that errors have as a breath or a pulse of each curve.

    Beside such errors a motion that is the same in all curves gains nearly nothing, so that no
    screen sees it. `fit` is the model as it is, `linear` the same about its fit.
    """
    errors = still_errors(look)
    # The frequency of errors is known to a part of what a record tells apart only.
    finest_hz = 0.1 / max(float(np.ptp(r.curve.time_s)) for r in records)
    for one in _LIVING:
        node = next((n for n in look.nodes if one.name in n.sizes_um), None)
        if node is None:
            continue
        near_hz = (node.values[f"{one.name}_hz"] + finest_hz * np.arange(-5, 6)).tolist()
        near_hz = [hz for hz in near_hz if _like(one, hz)]
        found = {hz: _of_each(fit, linear, errors, records, hz) for hz in near_hz}
        hz = max(found, key=lambda hz: found[hz].power)
        if found[hz].chance <= NAMES.alike_by_chance:
            yield {"amplitude_um": found[hz].in_step_um, "frequency_hz": hz}


def _like(one: Periodic, hz: float) -> bool:
    return one.low_hz / _WIDER <= hz <= _WIDER * one.high_hz


def still_errors(look: ErrorChoice) -> Covariance:
    """Return the errors without a breath or a pulse of each curve."""
    moving = [one.name for one in _LIVING]
    node = next((n for n in look.nodes if n.sizes_um.keys() & set(moving)), None)
    if node is None:
        return look.mode
    columns = [node.combination.columns[name] for name in moving if name in node.sizes_um]
    whole = node.covariance
    kept = np.ones(whole.shapes_mm.shape[1], dtype=bool)
    for which in columns:
        kept[which] = False
    sizes = None if whole.sizes is None else whole.sizes[kept]
    return replace(whole, shapes_mm=whole.shapes_mm[:, kept], sizes=sizes)


@dataclass(frozen=True)
class _Waves:
    """What each curve has of a motion: sine and cosine (curves,), and how well they are known."""

    sine_um: Array
    cosine_um: Array
    sd_um: Array

    @property
    def in_step_um(self) -> float:
        """The amplitude that all have in step."""
        return float(np.average(self.sine_um, weights=self.sd_um**-2))

    @property
    def power(self) -> float:
        """Squares of all in standard deviations: what any phases take up."""
        return float(np.sum((self.sine_um**2 + self.cosine_um**2) / self.sd_um**2))

    @property
    def chance(self) -> float:
        """How often phases of chance are so much in step."""
        size = np.maximum(np.hypot(self.sine_um, self.cosine_um), _TINY)
        cosines = math.copysign(1.0, self.in_step_um) * self.sine_um / size
        return chance_of_phases(cosines, size / self.sd_um)


def _of_each(
    fit: Fit, linear: Linearised, errors: Covariance, records: Sequence[Record], hz: float
) -> _Waves:
    """Return what each curve has of a motion, by least squares beside all other unknowns."""
    angles = [2.0 * np.pi * hz * (r.curve.time_s - r.began_s) for r in records]
    waves = block_diagonal([np.column_stack([np.sin(a), np.cos(a)]) for a in angles])
    known = fit.unknowns.values(fit.u).get(IN_STEP, {"amplitude_um": 0.0})["amplitude_um"]
    law = np.zeros(fit.unknowns.count, dtype=bool)
    mine = np.array([*law, *(a.effect == IN_STEP for a in fit.unknowns.axes)])
    others = linear.slopes_mm[:, linear.free & ~mine]
    target = linear.residual_mm + 1e-3 * known * np.concatenate([np.sin(a) for a in angles])
    white = errors.whiten(np.column_stack([1e-3 * waves, others, target]))
    length = np.sqrt(np.square(white[:, :-1]).sum(axis=0))
    length = np.where(length > 0.0, length, 1.0)  # what does nothing here gets nothing
    columns = white[:, :-1] / length
    inverse = np.linalg.pinv(columns.T @ columns, hermitian=True)
    n = 2 * len(records)
    found = (inverse @ (columns.T @ white[:, -1]) / length)[:n].reshape(-1, 2)
    variance = (np.diag(inverse) / length**2)[:n].reshape(-1, 2).mean(axis=1)
    return _Waves(found[:, 0], found[:, 1], np.sqrt(np.maximum(variance, _TINY)))


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

    far = _FAR / max(float(w.min()), _TINY)
    if slope(far) <= 0.0:
        return 0.0
    t = float(brentq(slope, 0.0, far))
    bent = float(np.square(w) @ (1.0 - ratio(t) ** 2) - (w @ ratio(t)) / t)
    log_mean = float(np.sum(np.log(i0e(w * t)) + w * t))
    r = math.sqrt(2.0 * max(t * total - log_mean, 0.0))
    u = t * math.sqrt(bent)
    tail = float(ndtr(-r)) + math.exp(-0.5 * r * r) / math.sqrt(2.0 * math.pi) * (1.0 / u - 1.0 / r)
    return min(1.0, 2.0 * max(tail, 0.0))
