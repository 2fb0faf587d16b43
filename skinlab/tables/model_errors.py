"""Where a table errs: its mesh near a crease and by locking, its interpolation between nodes.

Those of the mesh of record are shares of the deflection, measured by
`python benchmarks/model_error.py --law-range`, against meshes that are finer and that cannot lock
(docs/decisions/0022-going-on-near-creases.md).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skinlab.tables.settings import INTERPOLATION

Array = NDArray[np.float64]

# A finer mesh creases earlier, and its dome then is higher by a jump: root mean squares of what
# comes in between these shares of the pressure up to which the mesh of record holds.
CREASE = ((0.3, 0.6, 3e-3), (0.6, 0.8, 4e-3), (0.8, 1.0, 8e-3))
# Beyond, the curve is that of a blunter edge, and how blunt is not known.
BEYOND = ((1.0, 1.5, 4e-3), (1.5, 2.5, 8e-3), (2.5, 5.0, 8e-3))
# By so much the bluntness of the edge moves the whole dome of a skin that creases before its curve
# ends: all of it where the end is at the second of these shares, nothing at the first.
LEVEL = (0.7, 1.1, 8e-3)
# Of too low a dome, per root of κ/(μ/2): 0.12 % at ν = 0.3, 0.4 % at 0.48, 1.7 % at 0.499.
LOCKING = 5.5e-4
LOCKING_SHAPES = (1.0, 0.12, 0.05)  # of that, by orders of shifted Legendre polynomials of p/p_max


def crease_shapes(share: Array) -> Array:
    """Return shapes (u, m) at shares (u,) of the pressure up to which the skin holds."""
    low, high, size = LEVEL
    level = size * _smooth((share.max(initial=0.0) - low) / (high - low))
    steps = [s * _smooth((share - a) / (b - a)) for a, b, s in (*CREASE, *BEYOND)]
    return np.column_stack([np.full(len(share), level), *steps])


def locking(kappa_ratio: Array) -> Array:
    """Return the standard deviation (n,) at κ/(μ/2), as a share of the deflection."""
    return np.asarray(LOCKING * np.sqrt(kappa_ratio))


@dataclass(frozen=True, eq=False)
class SeenErrors:
    """By how much a table was off where it was tried, along loads or suctions (m,)."""

    at: Array
    shares: Array  # (c, m) of the deflection

    def scaled(self, factor: float) -> SeenErrors:
        """Return the same along other units, `factor` times as large."""
        return replace(self, at=factor * self.at)

    def shapes(self, at: Array) -> Array:
        """Return shapes (u, m), shares of the deflection, of a curve at these places (u,)."""
        seen = np.stack([np.interp(at, self.at, one) for one in self.shares], axis=1)
        top = max(float(at.max(initial=0.0)), 1e-12)
        return interpolation_shapes(seen, np.clip(at / top, 0.0, 1.0))


def interpolation_shapes(errors: Array, along: Array) -> Array:
    """Return shapes (u, m) of the interpolation's error, each as large as its standard deviation.

    `errors` (u, c) are those that were seen, `along` (u,) is 0 to 1. Those alone would say that no
    other shape can be: half of the variance goes to continuous shapes of the same size.
    """
    size = np.sqrt(np.mean(errors**2, axis=1))
    knots = np.linspace(0.0, 1.0, INTERPOLATION.knots)
    together = np.exp(-np.abs(knots[:, None] - knots) / INTERPOLATION.reach)
    hats = np.maximum(0.0, 1.0 - np.abs(along[:, None] - knots) * (INTERPOLATION.knots - 1))
    any_shape = size[:, None] * (hats @ np.linalg.cholesky(together))
    both = np.hstack([errors / np.sqrt(errors.shape[1]), any_shape])
    return np.asarray(np.sqrt(0.5) * both)


def _smooth(x: Array) -> Array:
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))
