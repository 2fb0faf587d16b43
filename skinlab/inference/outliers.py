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

Array = NDArray[np.float64]

_FEWEST = 12
_WIDE_MM = 0.05  # of a movement, or
_WIDE = 10.0  # times the noise
_USUAL = (0.5, 100.0)  # outliers of so many samples, before the data
_MOST = 0.1  # of all samples; more are no outliers
_ROUNDS = 12
_LASTING_S = 0.3  # of what is correlated in the residuals
_LEAST_MM = 5e-4  # of a noise beside which a sample can be off
_SPREAD = 0.6745  # median of |z| of a Gaussian


def outlier_probability(linear: LinearModel, samples: Samples, step_mm: float = 0.0) -> Array:
    """Return each sample's probability (u,) of being an outlier; above 0.5 it should be left out.

    `step_mm` is the step of the readings, below which nothing is an outlier.
    """
    u = len(samples)
    found = np.zeros(u)
    kept = np.ones(u, dtype=bool)
    if u < _FEWEST:
        return found
    for _ in range(_ROUNDS):
        part = LinearModel(linear.residual_mm[kept], linear.slopes_mm[kept], linear.precision)
        covariance = _robust(part.residual_mm, samples.only(kept), step_mm)
        off, variance = part.left_out(covariance)
        sigma = np.sqrt(variance)
        sigma = sigma * max(1.0, float(np.median(np.abs(off) / sigma)) / _SPREAD)
        p = _mixture(off, sigma, int((~kept).sum()))
        worst = (p > 0.5) & (np.abs(off) / sigma >= 0.5 * np.abs(off / sigma).max())
        found[kept] = p
        if not worst.any():
            break
        most = int(_MOST * u) - int((~kept).sum())
        if most <= 0:
            break
        here = np.flatnonzero(kept)
        chosen = here[worst][np.argsort(-np.abs(off / sigma)[worst])][:most]
        kept[chosen] = False
    found[kept] = np.minimum(found[kept], 0.5)
    return found


def _mixture(off: Array, sigma: Array, already: int) -> Array:
    wide = np.hypot(np.maximum(_WIDE_MM, _WIDE * sigma), sigma)
    log_narrow = -0.5 * (off / sigma) ** 2 - np.log(sigma)
    log_wide = -0.5 * (off / wide) ** 2 - np.log(wide)
    p = np.zeros(len(off))
    for _ in range(4):
        share = (p.sum() + already + _USUAL[0]) / (len(off) + already + _USUAL[1])
        odds = np.clip(np.log(share / (1.0 - share)) + log_wide - log_narrow, -500.0, 500.0)
        p = 1.0 / (1.0 + np.exp(-odds))
    return np.asarray(p)


def _robust(residual: Array, samples: Samples, step_mm: float) -> Covariance:
    """Return white noise as large as the residuals are rough, and a process for the rest."""
    ends = samples.ends
    rough = [roughness(part) for part in np.split(residual, ends[:-1])]
    counts = np.diff([0, *ends])
    rough = [r if np.isfinite(r) else 0.0 for r in rough]
    total = float(np.median(np.abs(residual))) / _SPREAD
    least = max(step_mm / np.sqrt(12.0), _LEAST_MM, 0.1 * total)
    size = np.repeat(np.maximum(rough, least), counts)
    smooth = max(total**2 - float(np.mean(size**2)), (0.1 * total) ** 2, _LEAST_MM**2)
    process = OrnsteinUhlenbeck(float(np.sqrt(smooth)), _LASTING_S)
    none = np.zeros((len(residual), 0))
    return Covariance(size**2, none, ends, process, samples.time_s)
