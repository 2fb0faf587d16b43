"""The paper's law, eq. (1): W = X1 (J1−3) + X2 (J1−3)(J2−3) + κ/2 (J−1)².

J1 = I3^(−1/3) I1 and J2 = I3^(−2/3) I2 are the reduced invariants, eqs. (2.a) and (2.b) with the
misprint on the left of (2.b) mended. X2 = 0 is the compressible neo-Hookean law.

Source: "A new stochastic inverse identification of the mechanical properties of human skin", 2.2.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from skinlab.mechanics.materials.base import KAPPA, Array, First, Law, Potential
from skinlab.parameters import Nodes, Parameter, Search

X1, X2, NU = "X1_MPa", "X2_MPa", "nu"


class ExtendedNeoHookean(Law):
    """See the module."""

    name = "extended_neo_hookean"
    formula = "W = X1 (J1 − 3) + X2 (J1 − 3)(J2 − 3) + κ/2 (J − 1)²"
    meaning = "X1, X2: stiffness at small and at large stretch"
    source = "eq. (1)"
    linear = True
    multiplies = MappingProxyType({X1: "J1 − 3", X2: "(J1 − 3)(J2 − 3)"})
    poisson = NU
    dilatation_scale = "kappa_over_X1"  # X1 is half the shear modulus
    parameters = (
        Parameter(
            X1, "MPa", "stiffness at small stretch, half the shear modulus", 1e-3, 100.0, None,
            0.03, "the paper, section 2.3", "log", symbol="X1",
            search=Search(0.005, 0.2, "log", step=0.05, reach=0.5),
            axis=Nodes(0.01, 0.1, 8, "log"),
            published=tuple(round(0.01 * i, 10) for i in range(1, 11)),
        ),
        Parameter(
            X2, "MPa", "how it stiffens at large stretch", 0.0, 1e4, None,
            1.0, "the paper, section 2.3", "log", symbol="X2",
            search=Search(0.5, 1000.0, "ratio", step=0.1, reach=0.9),
            axis=Nodes(0.1, 10.0, 10, "log"),
            published=tuple(round(0.1 + 0.3 * i, 10) for i in range(17)),
        ),
        Parameter(
            NU, "", "Poisson's ratio at small stretch", 0.0, 0.49999, None,
            0.32, "the paper, section 2.3", symbol="ν",
            search=Search(0.0, 0.499, step=0.02, reach=0.1),
            axis=Nodes(0.2, 0.48, 6),
            published=tuple(round(0.2 + 0.04 * i, 10) for i in range(8)),
        ),
    )  # fmt: skip

    def half_shear_modulus(self, values: Mapping[str, Any]) -> Any:
        """Return X1."""
        return values[X1]

    def isochoric(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        """Return the energy without κ; X1_MPa, X2_MPa in MPa."""
        x1, x2 = parameters[X1], parameters[X2]
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
        x2_a, none = x2 * a, np.zeros_like(i1)
        return Potential(
            energy=x1 * e1 + w2 * e2,
            d_i1=w1 * a,
            d_i2=w2 * b,
            d_j=w1 * j1_j + w2 * j2_j,
            d_i1_i1=none,
            d_i1_i2=x2_a * b,
            d_i2_i2=none,
            d_i1_j=w1 * a_j + x2_a * j2_j,
            d_i2_j=w2 * b_j + x2 * b * j1_j,
            d_j_j=w1 * j1_jj + w2 * j2_jj + 2.0 * x2 * j1_j * j2_j,
        )

    def isochoric_first(
        self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]
    ) -> First:
        """Return the first derivatives of the energy without κ."""
        x1, x2 = parameters[X1], parameters[X2]
        a = j ** (-2.0 / 3.0)
        b = a * a
        w1 = x1 + x2 * (b * i2 - 3.0)
        w2 = x2 * (a * i1 - 3.0)
        share = -2.0 / 3.0 / j
        return w1 * a, w2 * b, w1 * (share * a * i1) + w2 * (2.0 * share * b * i2)


LAW = ExtendedNeoHookean()


def neo_hookean(half_shear_mpa: float, kappa_mpa: float) -> dict[str, float]:
    """Return what the law's potential needs where X2 is nothing: other layers' tissue."""
    return {X1: half_shear_mpa, X2: 0.0, KAPPA: kappa_mpa}
