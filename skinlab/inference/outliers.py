"""Samples that do not belong to the curve: a movement, a glitch of the link.

Each sample's probability of being one, from a mixture of the errors' Gaussian and a wide one (Hogg,
Bovy and Lang 2010, arXiv:1008.4686), applied to its deviation from what all others predict. Scales
are medians, so that what is looked for does not widen them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.covariance import Covariance, OrnsteinUhlenbeck
from skinlab.inference.likelihood import LinearModel
from skinlab.inference.noise import roughness
from skinlab.inference.samples import Samples
from skinlab.inference.settings import OUTLIERS

Array = NDArray[np.float64]

_SIZES = np.geomspace(*OUTLIERS.sizes)
_SHARES = np.concatenate([[0.0], np.geomspace(*OUTLIERS.shares)])
SPREAD = 0.6745  # median of |z| of a Gaussian


def outlier_probability(
    linear: LinearModel,
    samples: Samples,
    step_mm: Array | None = None,
    known_mm: Array | None = None,
) -> Array:
    """Return each sample's probability (u,) of being an outlier; above 0.5 it should be left out.

    `step_mm` (u,) is the step of the readings, below which nothing is an outlier; `known_mm` (u,)
    the standard deviation of errors that are known beforehand, the pressure's.
    """
    u = len(samples)
    found = np.zeros(u)
    kept = np.ones(u, dtype=bool)
    if u < OUTLIERS.fewest:
        return found
    known = np.zeros(u) if known_mm is None else known_mm
    step = np.zeros(u) if step_mm is None else step_mm
    for _ in range(OUTLIERS.searches):
        part = LinearModel(linear.residual_mm[kept], linear.slopes_mm[kept], linear.precision)
        covariance = _robust(part.residual_mm, samples.only(kept), step[kept], known[kept])
        off, variance = part.left_out(covariance)
        sigma = np.sqrt(variance)
        sigma = sigma * max(1.0, float(np.median(np.abs(off) / sigma)) / SPREAD)
        p = _mixture(off, sigma, int((~kept).sum()))
        worst = (p > 0.5) & (np.abs(off) / sigma >= 0.5 * np.abs(off / sigma).max())
        found[kept] = p
        if not worst.any():
            break
        most = int(OUTLIERS.most * u) - int((~kept).sum())
        if most <= 0:
            break
        here = np.flatnonzero(kept)
        chosen = here[worst][np.argsort(-np.abs(off / sigma)[worst])][:most]
        kept[chosen] = False
    found[kept] = np.minimum(found[kept], 0.5)
    return _by_whole_runs(found, linear.residual_mm, samples, np.maximum(step, OUTLIERS.least_mm))


def _by_whole_runs(probability: Array, residual: Array, samples: Samples, least_mm: Array) -> Array:
    """Return the probabilities (u,), where several samples in a row are off, of the row as it is.

    Four or five samples that are off together look like an error that lasts: its flanks were left
    out, with good samples beside them, and its middle was kept. So near those that are left out
    what belongs is what lies between the samples on either side.
    """
    found = probability.copy()
    reach, most = OUTLIERS.run, int(OUTLIERS.most * len(found))
    for begin, end in zip((0, *samples.ends[:-1]), samples.ends, strict=True):
        out = begin + np.flatnonzero(found[begin:end] > 0.5)
        for near in np.split(out, np.flatnonzero(np.diff(out) > reach) + 1):
            if len(near) < 2:
                continue
            low, high = max(begin, near[0] - reach), min(end, near[-1] + reach + 1)
            sides = [residual[max(begin, low - 2 * reach) : low], residual[high : high + 2 * reach]]
            sides = [side for side in sides if len(side) >= reach]
            if not sides:
                continue
            level = [float(np.median(side)) for side in sides]
            rest = np.concatenate([s - one for s, one in zip(sides, level, strict=True)])
            spread = max(float(np.median(np.abs(rest))) / SPREAD, float(least_mm[begin]))
            if abs(level[-1] - level[0]) > OUTLIERS.run_off * spread:
                continue  # a jump, and no run
            off = np.abs(residual[low:high] - np.linspace(level[0], level[-1], high - low))
            run = off > OUTLIERS.run_off * spread
            others = int((found > 0.5).sum()) - len(near)
            if 2 <= run.sum() <= min(2 * reach, most - others):
                found[low:high] = np.where(run, 1.0, np.minimum(found[low:high], 0.5))
    return found


def _mixture(off: Array, sigma: Array, already: int) -> Array:
    wide = np.hypot(np.maximum(OUTLIERS.wide_mm, OUTLIERS.wide * sigma), sigma)
    log_narrow = -0.5 * (off / sigma) ** 2 - np.log(sigma)
    log_wide = -0.5 * (off / wide) ** 2 - np.log(wide)
    p = np.zeros(len(off))
    for _ in range(4):
        share = (p.sum() + already + OUTLIERS.usual[0]) / (len(off) + already + OUTLIERS.usual[1])
        odds = np.clip(np.log(share / (1.0 - share)) + log_wide - log_narrow, -500.0, 500.0)
        p = 1.0 / (1.0 + np.exp(-odds))
    return np.asarray(p)


def _robust(residual: Array, samples: Samples, step_mm: Array, known_mm: Array) -> Covariance:
    """Return white noise as large as the residuals are rough, and a process for the rest."""
    ends = samples.ends
    parts = zip(
        *(
            np.split(values, ends[:-1])
            for values in (residual, samples.deflection_mm - residual, known_mm)
        ),
        strict=True,
    )
    size = np.concatenate([_independent_mm(*part) for part in parts])
    least_mm = OUTLIERS.least_mm
    z = np.abs(residual) / np.maximum(size, least_mm)
    total = np.maximum(size, least_mm) * float(np.median(z)) / SPREAD
    size = np.maximum.reduce(
        [size, step_mm / np.sqrt(12.0), np.full(len(size), least_mm), 0.1 * total]
    )
    smooth = float(np.median(total)) ** 2 - float(np.median(size)) ** 2
    smooth = max(smooth, float(np.median(0.1 * total)) ** 2, least_mm**2)
    process = OrnsteinUhlenbeck(float(np.sqrt(smooth)), OUTLIERS.lasting_s)
    none = np.zeros((len(residual), 0))
    return Covariance(size**2, none, ends, process, samples.time_s)


def _independent_mm(residual: Array, deflection_mm: Array, known_mm: Array) -> Array:
    """Return the independent errors' standard deviations (u,) within one curve.

    What is known, white noise, and a share of the deflection if fourth differences call for one.
    Their likelihood is a Student's, which single samples do not sway.
    """
    plain = roughness(residual)
    if not np.isfinite(plain) or plain <= 0.0:
        return known_mm.copy()
    taps = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
    some = slice(None, None, 1 + len(residual) // OUTLIERS.most_bends)
    bend = np.convolve(residual, taps, "valid")[some]
    sizes = [np.square(v) for v in (known_mm, np.ones(len(residual)), deflection_mm)]
    known, one, squared = (np.convolve(s, taps**2, "valid")[some] for s in sizes)
    white, share = np.meshgrid(plain * _SIZES, _SHARES)
    variance = known + white[..., None] ** 2 * one + share[..., None] ** 2 * squared
    freedom = OUTLIERS.freedom
    each = np.log(variance) + (freedom + 1.0) * np.log1p(bend**2 / (freedom * variance))
    worth = -0.5 * each.sum(axis=-1)
    worth[1:] -= OUTLIERS.gain
    best = np.unravel_index(int(np.argmax(worth)), worth.shape)
    found = sizes[0] + white[best] ** 2 + share[best] ** 2 * sizes[2]
    return np.asarray(np.sqrt(found))
