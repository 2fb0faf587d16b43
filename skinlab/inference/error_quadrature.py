"""The mode of errors' parameters, and evenly spread points about it to integrate over."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.settings import CHOICE

Array = NDArray[np.float64]

_STEP = 0.05  # of a logarithm, for derivatives
_SHORTER = 0.3 ** np.arange(4)  # steps that are tried
_FAR = 1.5  # the longest step in a logarithm
POINTS = Path(__file__).parents[1] / "data" / "sobol.npz"  # tests/unit/inference/test_sobol.py


def find_mode(
    density_of_logarithms: Callable[[Array], Array], start: Array, scales: Array
) -> tuple[Array, Array, float]:
    """Return the mode (d,) by Newton's method, a root (d, d) of the covariance, and the density.

    Steps are in units of `scales` (d,).
    """

    def density(scaled: Array) -> Array:
        return density_of_logarithms(scaled * scales)

    at, d = start / scales, len(start)
    values = np.eye(d)
    here = float(density(at[None])[0])
    for _ in range(CHOICE.newton_steps if d else 0):
        slope, curvature = _derivatives(density, at, here)
        curve, vectors = np.linalg.eigh(-curvature)
        curve = np.maximum(np.where(curve > 0, curve, -0.3 * curve), CHOICE.least_curvature)
        values = vectors / np.sqrt(curve)
        step = values @ (values.T @ slope)
        step *= min(1.0, _FAR / max(float(np.abs(step).max()), 1e-12))
        if float(slope @ step) < CHOICE.settled:
            break
        for shares in (_SHORTER[:1], _SHORTER[1:]):  # the whole one nearly always does
            trials = at + shares[:, None] * step
            there = density(trials)
            better = np.flatnonzero(there > here)
            if len(better):
                break
        if not len(better):
            break
        at, here = trials[better[0]], float(there[better[0]])
    return at * scales, values * scales[:, None], here


def _derivatives(density: Callable[[Array], Array], at: Array, here: float) -> tuple[Array, Array]:
    """Return the slope (d,) of a density, which is `here` at a point (d,), and curvature (d, d)."""
    d, h = len(at), _STEP
    steps = h * np.eye(d)
    i, j = np.tril_indices(d, -1)
    found = density(at + np.vstack([steps, -steps, steps[i] + steps[j]]))
    up, down, both = np.split(found, [d, 2 * d])
    slope = (up - down) / (2.0 * h)
    curvature = np.diag((up - 2.0 * here + down) / h**2)
    curvature[i, j] = curvature[j, i] = (both - up[i] - up[j] + here) / h**2
    return slope, curvature


@lru_cache(maxsize=64)
def normal_points(count: int, d: int) -> Array:
    """Return normally distributed points (count, d), spread evenly: a fixed Sobol' sequence."""
    stored = _stored_points().get(f"normal{d}")
    if stored is not None and count <= len(stored):
        return stored[:count]
    from scipy.special import ndtri  # slow to import

    return np.asarray(ndtri(_even(count, d)))


@lru_cache(maxsize=64)
def student_points(count: int, d: int) -> Array:
    """Return Student distributed points (count, d), from one dimension more of the sequence."""
    stored = _stored_points().get(f"student{d}")
    if stored is not None and count <= len(stored):
        return stored[:count]
    from scipy.special import gammaincinv, ndtri  # slow to import

    points = _even(count, d + 1)
    chi_square = 2.0 * gammaincinv(0.5 * CHOICE.freedom, points[:, -1])
    return np.asarray(ndtri(points[:, :-1]) * np.sqrt(CHOICE.freedom / chi_square)[:, None])


def _even(count: int, d: int) -> Array:
    """Return points (count, d) of the unit cube."""
    from scipy.stats import qmc  # slow to import

    sequence = qmc.Sobol(d, scramble=True, rng=np.random.default_rng(0))
    return np.clip(sequence.random(1 << max(count - 1, 1).bit_length())[:count], 1e-3, 1 - 1e-3)


@cache
def _stored_points() -> Mapping[str, Array]:
    """Return the first points of each dimension: scipy takes half a second to make them."""
    if not POINTS.exists():
        return {}
    with np.load(POINTS) as file:
        return dict(file)


def log_student(off: Array, wide: Array) -> Array:
    """Return the log densities (n,) of a Student distribution, (n, d) off its middle."""
    d = off.shape[1]
    z = np.linalg.solve(wide, off.T).T
    return np.asarray(
        math.lgamma(0.5 * (CHOICE.freedom + d))
        - math.lgamma(0.5 * CHOICE.freedom)
        - 0.5 * d * math.log(CHOICE.freedom * math.pi)
        - float(np.linalg.slogdet(wide)[1])
        - 0.5 * (CHOICE.freedom + d) * np.log1p(np.square(z).sum(axis=1) / CHOICE.freedom)
    )
