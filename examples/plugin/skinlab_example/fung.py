"""W = C1/(2 C2) (exp(C2 (J1−3)) − 1) + κ/2 (J−1)², the exponential law of Fung and Demiray.

J1 = I3^(−1/3) I1. Source: H. Demiray, "A note on the elasticity of soft biological tissues",
J. Biomech. 5 (1972) 309-311.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from skinlab.mechanics.materials.base import Array, Law, Potential
from skinlab.parameters import Nodes, Parameter, Search


class Fung(Law):
    """See the module."""

    name = "fung"
    formula = "W = C1/(2 C2) (exp(C2 (J1 − 3)) − 1) + κ/2 (J − 1)²"
    meaning = "C1: shear modulus at rest; C2: how fast it stiffens"
    source = "Demiray 1972"
    poisson = "nu"
    parameters = (
        Parameter(
            "C1_MPa", "MPa", "shear modulus at rest", 1e-3, 100.0, None, 0.06, "Demiray 1972",
            "log", search=Search(0.02, 0.2, "log"), axis=Nodes(0.02, 0.2, 6, "log"),
        ),
        Parameter(
            "C2", "", "how fast it stiffens", 1e-3, 1e3, None, 10.0, "Demiray 1972", "log",
            search=Search(2.0, 60.0, "log"), axis=Nodes(2.0, 60.0, 6, "log"),
        ),
        Parameter(
            "nu", "", "Poisson's ratio at rest", 0.0, 0.499, None, 0.35, "Demiray 1972",
            symbol="ν", search=Search(0.25, 0.48), axis=Nodes(0.25, 0.48, 4),
        ),
    )  # fmt: skip

    def half_shear_modulus(self, values: Mapping[str, Any]) -> Any:
        """Return μ/2 at rest, MPa."""
        return 0.5 * values["C1_MPa"]

    def isochoric(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        """Return the energy without κ and its derivatives; C1_MPa in MPa, C2 without a unit."""
        c1, c2 = parameters["C1_MPa"], parameters["C2"]
        a = j ** (-2.0 / 3.0)  # J1 = a I1
        growth = np.exp(c2 * (a * i1 - 3.0))
        first, second = 0.5 * c1 * growth, 0.5 * c1 * c2 * growth  # by J1
        a_j = -2.0 / 3.0 * a / j
        j1_j = a_j * i1
        j1_jj = -5.0 / 3.0 * j1_j / j
        nothing = 0.0 * i1
        return Potential(
            energy=c1 / (2.0 * c2) * (growth - 1.0),
            d_i1=first * a,
            d_i2=nothing,
            d_j=first * j1_j,
            d_i1_i1=second * a * a,
            d_i1_i2=nothing,
            d_i2_i2=nothing,
            d_i1_j=second * a * j1_j + first * a_j,
            d_i2_j=nothing,
            d_j_j=second * j1_j * j1_j + first * j1_jj,
        )


LAW = Fung()
