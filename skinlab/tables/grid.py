"""The paper's grid: X1 × X2 × ν at one geometry, with a curve in every node."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.errors import NotTrustworthyError
from skinlab.mechanics.fem.suction import EXTENSION_ABOVE, EXTENSION_BELOW_MBAR, Geometry
from skinlab.mechanics.materials.compressibility import KappaConvention

if TYPE_CHECKING:
    from skinlab.tables.grid_model import GridModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GridSpec:
    """What is computed. The defaults are the paper's section 2.3."""

    law: str = "extended_neo_hookean"
    kappa: KappaConvention = "paper"
    geometry: Geometry = field(default_factory=lambda: Geometry(6.0, 1.0))
    X1_MPa: tuple[float, ...] = tuple(round(0.01 * i, 10) for i in range(1, 11))
    X2_MPa: tuple[float, ...] = tuple(round(0.1 + 0.3 * i, 10) for i in range(17))
    nu: tuple[float, ...] = tuple(round(0.2 + 0.04 * i, 10) for i in range(8))
    pressure_mbar: tuple[float, ...] = tuple(2.0 * i for i in range(51))

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Nodes along X1, X2, ν and pressure."""
        return len(self.X1_MPa), len(self.X2_MPa), len(self.nu), len(self.pressure_mbar)

    @property
    def entries(self) -> int:
        """Number of curves."""
        return len(self.X1_MPa) * len(self.X2_MPa) * len(self.nu)

    def parameters(self, entry: int) -> tuple[float, float, float]:
        """Return (X1, X2, ν) of the entry with this flat number."""
        i, j, k = np.unravel_index(entry, self.shape[:3])
        return self.X1_MPa[int(i)], self.X2_MPa[int(j)], self.nu[int(k)]


@dataclass(frozen=True, eq=False)
class GridDatabase:
    """A built grid.

    `deflection_mm` has the axes (X1, X2, ν, p), `holds_to_mbar` (X1, X2, ν). Beyond the latter the
    curve is of the creased branch (NaN where even that does not converge): it supports the
    interpolation of neighbours, and is no answer in itself.
    """

    spec: GridSpec
    deflection_mm: Array
    holds_to_mbar: Array
    iterations: NDArray[np.int32]  # Newton iterations of each entry
    mesh_name: str
    solver_version: str
    dofs: int

    @property
    def law(self) -> str:
        """Name of the constitutive law."""
        return self.spec.law

    def covered(self, pressure_mbar: Array) -> NDArray[np.bool_]:
        """Return which pressures (n,) the grid speaks of, its small extensions included."""
        low = min(self.spec.pressure_mbar) - EXTENSION_BELOW_MBAR
        high = max(self.spec.pressure_mbar) * (1 + EXTENSION_ABOVE)
        return np.asarray((pressure_mbar >= low) & (pressure_mbar <= high))

    def covers(self, curve: Curve) -> NDArray[np.bool_]:
        """Return which samples (n,) of a curve it speaks of.

        Raises:
            NotTrustworthyError: the thickness is uncertain.
        """
        if curve.setup.thickness_sd_mm:
            raise NotTrustworthyError("this database holds one thickness, and knows no other")
        return self.covered(curve.pressure_mbar)

    def model(
        self,
        geometry: Geometry,
        pressure_mbar: Array,
        kappa: KappaConvention = "paper",
        thickness_sd_mm: float = 0.0,
        time_s: Array | None = None,
    ) -> GridModel:
        """Return the grid at this geometry and these pressures (u,).

        Raises:
            NotTrustworthyError: the grid does not speak of this geometry or uncertainty.
        """
        from skinlab.tables.grid_model import GridModel

        del time_s
        if thickness_sd_mm > 0.0:
            raise NotTrustworthyError("this database holds one thickness, and knows no other")
        return GridModel(self, geometry, pressure_mbar, kappa)

    @cached_property
    def content_hash(self) -> str:
        """`sha256:…` over what is computed from what, and the numbers themselves."""
        digest = hashlib.sha256()
        head = (self.spec, self.mesh_name, self.solver_version, self.dofs)
        digest.update(repr(head).encode())
        for array in (self.deflection_mm, self.holds_to_mbar, self.iterations):
            digest.update(np.ascontiguousarray(array).tobytes())
        return f"sha256:{digest.hexdigest()}"
