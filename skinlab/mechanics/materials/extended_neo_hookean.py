"""The paper's law, eq. (1): W = X1 (J1−3) + X2 (J1−3)(J2−3) + κ/2 (J−1)².

J1 = I3^(−1/3) I1 and J2 = I3^(−2/3) I2 are the reduced invariants, eqs. (2.a) and (2.b) with the
misprint on the left of (2.b) mended. X2 = 0 is the compressible neo-Hookean law.

Source: "A new stochastic inverse identification of the mechanical properties of human skin", 2.2.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skinlab.mechanics.materials.base import Array, Potential


class ExtendedNeoHookean:
    """See the module."""

    name = "extended_neo_hookean"
    parameter_names = ("X1_MPa", "X2_MPa", "kappa_MPa")
    source = "eq. (1)"

    def potential(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        """Return energy and derivatives; X1_MPa, X2_MPa, kappa_MPa in MPa."""
        x1, x2 = parameters["X1_MPa"], parameters["X2_MPa"]
        kappa = parameters["kappa_MPa"]
        a = j ** (-2.0 / 3.0)  # J1 = a I1
        b = a * a  # J2 = b I2
        e1 = a * i1 - 3.0
        e2 = b * i2 - 3.0
        w1 = x1 + x2 * e2  # ∂W/∂J1
        w2 = x2 * e1  # ∂W/∂J2
        a_j = -2.0 / 3.0 * a / j
        b_j = -4.0 / 3.0 * b / j
        j1_j, j2_j = a_j * i1, b_j * i2
        j1_jj = -5.0 / 3.0 * j1_j / j
        j2_jj = -7.0 / 3.0 * j2_j / j
        return Potential(
            energy=x1 * e1 + x2 * e1 * e2 + 0.5 * kappa * (j - 1.0) ** 2,
            d_i1=w1 * a,
            d_i2=w2 * b,
            d_j=w1 * j1_j + w2 * j2_j + kappa * (j - 1.0),
            d_i1_i1=0.0 * i1,
            d_i1_i2=x2 * a * b,
            d_i2_i2=0.0 * i1,
            d_i1_j=w1 * a_j + x2 * a * j2_j,
            d_i2_j=w2 * b_j + x2 * b * j1_j,
            d_j_j=w1 * j1_jj + w2 * j2_jj + 2.0 * x2 * j1_j * j2_j + kappa,
        )


LAW = ExtendedNeoHookean()
