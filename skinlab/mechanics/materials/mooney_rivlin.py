"""Rubber, the law of Mooney and Rivlin: W = C10 (J1−3) + C01 (J2−3) + κ/2 (J−1)².

J1 = I3^(−1/3) I1 and J2 = I3^(−2/3) I2. The answers to known problems of large inflation are known
for it (the pressurised rubber disc, docs/verification.md).

Source: R. S. Rivlin, Phil. Trans. R. Soc. A 241 (1948) 379; with the volumetric term of eq. (1).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from skinlab.mechanics.materials.base import Array, Law, Potential
from skinlab.parameters import Nodes, Parameter, Search


class MooneyRivlin(Law):
    """See the module."""

    name = "mooney_rivlin"
    formula = "W = C10 (J1 − 3) + C01 (J2 − 3) + κ/2 (J − 1)²"
    meaning = "C10 + C01: half the shear modulus"
    source = "Rivlin 1948"
    linear = True
    multiplies = MappingProxyType({"C10_MPa": "J1 − 3", "C01_MPa": "J2 − 3"})
    poisson = "nu"
    parameters = (
        Parameter(
            "C10_MPa", "MPa", "of the first invariant", 1e-3, 100.0, None, 0.05, "Rivlin 1948",
            "log", search=Search(0.005, 0.5, "log"), axis=Nodes(0.01, 0.2, 8, "log"),
        ),
        Parameter(
            "C01_MPa", "MPa", "of the second invariant", 0.0, 100.0, None, 0.02, "Rivlin 1948",
            "log", search=Search(0.01, 10.0, "ratio"), axis=Nodes(0.005, 0.2, 8, "log"),
        ),
        Parameter(
            "nu", "", "Poisson's ratio at small stretch", 0.0, 0.49999, None, 0.4, "Rivlin 1948",
            symbol="ν", search=Search(0.0, 0.499), axis=Nodes(0.2, 0.48, 6),
        ),
    )  # fmt: skip

    def half_shear_modulus(self, values: Mapping[str, Any]) -> Any:
        """Return C10 + C01."""
        return values["C10_MPa"] + values["C01_MPa"]

    def isochoric(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        """Return the energy without κ; C10_MPa, C01_MPa in MPa."""
        c10, c01 = parameters["C10_MPa"], parameters["C01_MPa"]
        a = c10 * j ** (-2.0 / 3.0)
        b = c01 * j ** (-4.0 / 3.0)
        nothing = 0.0 * i1
        return Potential(
            energy=a * i1 + b * i2 - 3.0 * (c10 + c01),
            d_i1=a + nothing,
            d_i2=b + nothing,
            d_j=(-2.0 / 3.0 * a * i1 - 4.0 / 3.0 * b * i2) / j,
            d_i1_i1=nothing,
            d_i1_i2=nothing,
            d_i2_i2=nothing,
            d_i1_j=-2.0 / 3.0 * a / j + nothing,
            d_i2_j=-4.0 / 3.0 * b / j + nothing,
            d_j_j=(10.0 / 9.0 * a * i1 + 28.0 / 9.0 * b * i2) / (j * j),
        )


LAW = MooneyRivlin()
