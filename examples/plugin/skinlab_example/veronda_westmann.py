"""W = C1 (exp(C2 (J1−3)) − 1) − C1 C2/2 (J2−3) + κ/2 (J−1)², the law of Veronda and Westmann.

J1 = I3^(−1/3) I1 and J2 = I3^(−2/3) I2. Source: D. R. Veronda and R. A. Westmann, "Mechanical
characterization of skin: finite deformations", J. Biomech. 3 (1970) 111-124.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from skinlab.mechanics.materials.base import Array, Potential


class VerondaWestmann:
    """See the module."""

    name = "veronda_westmann"
    parameter_names = ("C1_MPa", "C2", "kappa_MPa")
    source = "Veronda and Westmann 1970"

    def potential(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        """Return energy and derivatives; C1_MPa and kappa_MPa in MPa, C2 without a unit."""
        c1, c2, kappa = parameters["C1_MPa"], parameters["C2"], parameters["kappa_MPa"]
        a = j ** (-2.0 / 3.0)  # J1 = a I1
        b = a * a  # J2 = b I2
        growth = np.exp(c2 * (a * i1 - 3.0))
        w1 = c1 * c2 * growth  # ∂W/∂J1
        w11 = c2 * w1
        w2 = -0.5 * c1 * c2  # ∂W/∂J2
        a_j, b_j = -2.0 / 3.0 * a / j, -4.0 / 3.0 * b / j
        j1_j, j2_j = a_j * i1, b_j * i2
        nothing = 0.0 * i1
        return Potential(
            energy=c1 * (growth - 1.0) + w2 * (b * i2 - 3.0) + 0.5 * kappa * (j - 1.0) ** 2,
            d_i1=w1 * a,
            d_i2=w2 * b + nothing,
            d_j=w1 * j1_j + w2 * j2_j + kappa * (j - 1.0),
            d_i1_i1=w11 * a * a,
            d_i1_i2=nothing,
            d_i2_i2=nothing,
            d_i1_j=w11 * j1_j * a + w1 * a_j,
            d_i2_j=w2 * b_j + nothing,
            d_j_j=w11 * j1_j**2 - 5.0 / 3.0 * w1 * j1_j / j - 7.0 / 3.0 * w2 * j2_j / j + kappa,
        )


LAW = VerondaWestmann()
