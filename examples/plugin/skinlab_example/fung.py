"""W = C1/(2 C2) (exp(C2 (J1−3)) − 1) + κ/2 (J−1)², the exponential law of Fung and Demiray.

J1 = I3^(−1/3) I1. Source: H. Demiray, "A note on the elasticity of soft biological tissues",
J. Biomech. 5 (1972) 309-311.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from skinlab.mechanics.materials.base import Array, Law, Potential, potential_of_j1
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

        def energy(e: Array) -> tuple[Array, Array, Array]:
            growth = np.exp(c2 * e)
            first = 0.5 * c1 * growth
            return c1 / (2.0 * c2) * (growth - 1.0), first, c2 * first

        return potential_of_j1(i1, j, energy)


LAW = Fung()
