"""Rubber, the law of Mooney and Rivlin: W = C10 (J1−3) + C01 (J2−3) + κ/2 (J−1)².

J1 = I3^(−1/3) I1 and J2 = I3^(−2/3) I2. Not a law of skin: it is here because the answers to known
problems of large inflation are known for it (the pressurised rubber disc, docs/verification.md).

Source: R. S. Rivlin, Phil. Trans. R. Soc. A 241 (1948) 379; with the volumetric term of eq. (1).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skinlab.mechanics.materials.base import Array, Potential


class MooneyRivlin:
    """See the module."""

    name = "mooney_rivlin"
    parameter_names = ("C10_MPa", "C01_MPa", "kappa_MPa")
    source = "Rivlin 1948"

    def potential(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        """Return energy and derivatives; C10_MPa, C01_MPa, kappa_MPa in MPa."""
        c10, c01 = parameters["C10_MPa"], parameters["C01_MPa"]
        kappa = parameters["kappa_MPa"]
        a = c10 * j ** (-2.0 / 3.0)
        b = c01 * j ** (-4.0 / 3.0)
        nothing = 0.0 * i1
        return Potential(
            energy=a * i1 + b * i2 - 3.0 * (c10 + c01) + 0.5 * kappa * (j - 1.0) ** 2,
            d_i1=a + nothing,
            d_i2=b + nothing,
            d_j=(-2.0 / 3.0 * a * i1 - 4.0 / 3.0 * b * i2) / j + kappa * (j - 1.0),
            d_i1_i1=nothing,
            d_i1_i2=nothing,
            d_i2_i2=nothing,
            d_i1_j=-2.0 / 3.0 * a / j + nothing,
            d_i2_j=-4.0 / 3.0 * b / j + nothing,
            d_j_j=(10.0 / 9.0 * a * i1 + 28.0 / 9.0 * b * i2) / (j * j) + kappa,
        )


LAW = MooneyRivlin()
