"""From Poisson's ratio to the compressibility constant κ and back, in both conventions.

`paper`: eq. (3) as printed, κ = 6 (1−ν) X1 / ((1+ν)(1−2ν)) − 8/3 X1. It mixes E = 6 X1 with
μ = 2 X1 and agrees with linear elasticity at ν = 1/2 only.
`consistent`: κ = 4 X1 (1+ν) / (3 (1−2ν)), the bulk modulus that goes with μ = 2 X1 and ν. The
difference is 2 X1 (1−ν)/(1+ν), exactly.
"""

from __future__ import annotations

from typing import Any, Literal, assert_never

import numpy as np

from skinlab.errors import InputError

KappaConvention = Literal["paper", "consistent"]


def kappa_ratio(nu: Any, convention: KappaConvention) -> Any:
    """Return κ/X1 (dimensionless) for Poisson's ratio `nu` (float or array, 0 ≤ nu < 0.5).

    Raises:
        InputError: the convention is not known, or a ν lies outside [0, 0.5).
    """
    if isinstance(nu, float):  # searches ask for thousands of numbers
        inside = 0.0 <= nu < 0.5
    else:
        inside = bool(((np.asarray(nu) >= 0.0) & (np.asarray(nu) < 0.5)).all())
    if not inside:
        raise InputError(f"nu must lie in [0, 0.5), got {nu}")
    if convention == "paper":
        return 6.0 * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu)) - 8.0 / 3.0
    if convention == "consistent":
        return 4.0 * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))
    assert_never(convention)


def log_ratio_slope(nu: Any, convention: KappaConvention) -> Any:
    """Return the derivative of log `kappa_ratio` by ν (float or array)."""
    down = (1.0 + nu) * (1.0 - 2.0 * nu)
    if convention == "consistent":
        return 3.0 / down
    return 12.0 * nu * (2.0 - nu) / (down * (6.0 * (1.0 - nu) - 8.0 / 3.0 * down))


def nu_from_ratio(ratio: Any, convention: KappaConvention) -> Any:
    """Return the ν whose `kappa_ratio` in this convention is `ratio` (float or array)."""
    if convention == "consistent":
        return nu_consistent(ratio)
    # (κ' + 8/3)(1+ν)(1−2ν) = 6 (1−ν): a quadratic in ν; ν in [0, 0.5) is its larger root.
    c = ratio + 8.0 / 3.0
    a, b, d = 2.0 * c, c - 6.0, 6.0 - c
    return (-b + np.sqrt(b * b - 4.0 * a * d)) / (2.0 * a)


def nu_consistent(ratio: Any) -> Any:
    """Return the ν of linear elasticity for κ/X1 = `ratio`: (3κ − 4X1) / (6κ + 4X1)."""
    return (3.0 * ratio - 4.0) / (6.0 * ratio + 4.0)
