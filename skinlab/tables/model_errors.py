"""Where the mesh of record itself errs, as shares of the deflection: near a crease, and by locking.

Measured by `python benchmarks/model_error.py --law-range`, against meshes that are finer and that
cannot lock (docs/decisions/0022-going-on-near-creases.md).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A finer mesh creases earlier, and its dome then is higher by a jump: root mean squares of what
# comes in between these shares of the pressure up to which the mesh of record holds.
CREASE = ((0.3, 0.6, 3e-3), (0.6, 0.8, 4e-3), (0.8, 1.0, 8e-3))
# Of too low a dome, per root of κ/(μ/2): 0.12 % at ν = 0.3, 0.4 % at 0.48, 1.7 % at 0.499.
LOCKING = 5.5e-4
LOCKING_SHAPES = (1.0, 0.12, 0.05)  # of that, by orders of shifted Legendre polynomials of p/p_max


def crease_shapes(share: Array) -> Array:
    """Return shapes (u, m) at shares (u,) of the pressure up to which the skin holds."""
    return np.stack(
        [size * _smooth((share - low) / (high - low)) for low, high, size in CREASE], axis=1
    )


def locking(kappa_ratio: Array) -> Array:
    """Return the standard deviation (n,) at κ/(μ/2), as a share of the deflection."""
    return np.asarray(LOCKING * np.sqrt(kappa_ratio))


def _smooth(x: Array) -> Array:
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))
