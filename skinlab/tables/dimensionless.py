"""One table for every aperture, thickness and pressure.

By dimensional analysis w/R = f(q, X2/X1, κ/X1, h/R) with q = p/X1. The table holds log(f/q), the
logarithm of the secant compliance, on coordinates in which it is smooth: log(X2/X1), log(κ/X1),
log(h/R), and asinh(c(h/R) q / y0), where c(h/R) is about the compliance of a skin of that thickness
under a small load. With it the bends of the curves, from plate to membrane and to the stiffening by
X2, stand at the same place for all thicknesses; without it the interpolation along h/R is fifty
times worse. Each entry knows the q up to which it holds.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.errors import NotTrustworthyError
from skinlab.mechanics.fem.newton import StepSettings
from skinlab.mechanics.fem.suction import (
    EXTENSION_ABOVE,
    EXTENSION_BELOW_MBAR,
    MBAR,
    Geometry,
    solve,
)
from skinlab.mechanics.materials.compressibility import KappaConvention

if TYPE_CHECKING:
    from skinlab.tables.dimensionless_model import DimensionlessModel

Array = NDArray[np.float64]

# Steps in the table's own units: R = 1 mm, X1 = 1 MPa, so that 1 mbar is q = 1e-4.
_SETTINGS = StepSettings(extrapolation_error=3e-5, smallest_step_mbar=0.5, limit_mbar=20.0)


@dataclass(frozen=True)
class Axis:
    """Nodes of one coordinate, evenly spaced in its logarithm."""

    low: float
    high: float
    nodes: int

    def log_nodes(self) -> Array:
        """Return the logarithms of the nodes."""
        return np.linspace(np.log(self.low), np.log(self.high), self.nodes)


@dataclass(frozen=True)
class DimensionlessSpec:
    """What is computed; the defaults are what ships."""

    law: str = "extended_neo_hookean"
    X1_MPa: tuple[float, float] = (0.005, 0.2)  # exact along this one: it only scales
    pressure_mbar: float = 500.0
    thickness_over_radius: Axis = Axis(0.125, 3.0, 18)  # 0.5 mm under 8 mm … 3 mm under 2 mm
    X2_over_X1: Axis = Axis(0.5, 1000.0, 26)
    kappa_over_X1: Axis = Axis(2.66, 100.2, 18)  # ν of 0.2 to 0.49 in both conventions
    load_nodes: int = 84  # along asinh(c q / y0)
    load_scale: float = 0.03  # y0
    least_load: float = -0.05  # a noisy channel goes below zero

    @property
    def most_load(self) -> float:
        """Largest q: the softest skin at the highest pressure, its small extension included."""
        return self.pressure_mbar * MBAR * (1 + EXTENSION_ABOVE) / self.X1_MPa[0]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Nodes along h/R, X2/X1 and κ/X1."""
        return (
            self.thickness_over_radius.nodes,
            self.X2_over_X1.nodes,
            self.kappa_over_X1.nodes,
        )

    @property
    def entries(self) -> int:
        """Number of curves."""
        return int(np.prod(self.shape))

    def coordinate(self, load: Array, thickness_over_radius: float) -> Array:
        """Return asinh(c q / y0) of loads q."""
        return np.asarray(np.arcsinh(_compliance(thickness_over_radius) * load / self.load_scale))

    def load(self, coordinate: Array, thickness_over_radius: float) -> Array:
        """Return the loads q at coordinates: the inverse of `coordinate`."""
        return self.load_scale * np.sinh(coordinate) / _compliance(thickness_over_radius)

    def load_coordinates(self) -> Array:
        """Return the nodes along asinh(c q / y0): wide enough for the thinnest skin."""
        ends = np.array([self.least_load, self.most_load])
        low, high = self.coordinate(ends, self.thickness_over_radius.low)
        return np.linspace(low, high, self.load_nodes)


def _compliance(thickness_over_radius: float) -> float:
    """Return w/R / q for small q, within 2 % at X2/X1 = 7 and κ/X1 = 10 (a fit of our own)."""
    t = thickness_over_radius
    return 0.0246 / t**3 + 0.0803 / t**2 - 0.0072 / t + 0.182


@dataclass(frozen=True, eq=False)
class DimensionlessTable:
    """A built table.

    `log_compliance` (h/R, X2/X1, κ/X1, load) is log(w/R / q); beyond `holds_to_load` (h/R, X2/X1,
    κ/X1) it is filled to support the interpolation of neighbours, and is no answer in itself.
    """

    spec: DimensionlessSpec
    log_compliance: NDArray[np.float32]
    holds_to_load: Array
    mesh_name: str
    solver_version: str

    @cached_property
    def content_hash(self) -> str:
        """Return `sha256:…` over what is computed from what, and the numbers themselves."""
        digest = hashlib.sha256(repr((self.spec, self.mesh_name, self.solver_version)).encode())
        digest.update(np.ascontiguousarray(self.log_compliance).tobytes())
        digest.update(np.ascontiguousarray(self.holds_to_load).tobytes())
        return f"sha256:{digest.hexdigest()}"

    @property
    def law(self) -> str:
        """Name of the constitutive law."""
        return self.spec.law

    def covered(self, pressure_mbar: Array) -> NDArray[np.bool_]:
        """Return which pressures (n,) the table speaks of, its small extensions included."""
        high = self.spec.pressure_mbar * (1 + EXTENSION_ABOVE)
        return np.asarray((pressure_mbar >= -EXTENSION_BELOW_MBAR) & (pressure_mbar <= high))

    def covers(self, curve: Curve) -> NDArray[np.bool_]:
        """Return which samples (n,) of a curve it speaks of."""
        return self.covered(curve.pressure_mbar)

    def model(
        self,
        geometry: Geometry,
        pressure_mbar: Array,
        kappa: KappaConvention = "paper",
        thickness_sd_mm: float = 0.0,
        time_s: Array | None = None,
    ) -> DimensionlessModel:
        """Return the table at this geometry and these pressures (u,).

        With a standard deviation of the thickness, its ratio to the stated one is a parameter too.

        Raises:
            NotTrustworthyError: the thickness is outside the table.
        """
        from skinlab.tables.dimensionless_model import DimensionlessModel

        del time_s
        axis = self.spec.thickness_over_radius
        asked = geometry.thickness_mm / geometry.radius_mm
        if not axis.low * (1 - 1e-12) <= asked <= axis.high * (1 + 1e-12):
            raise NotTrustworthyError(
                f"thickness/radius {asked:.4g} is outside the database "
                f"({axis.low:g}–{axis.high:g}): {geometry.thickness_mm:g} mm of skin under a "
                f"{geometry.aperture_mm:g} mm opening"
            )
        return DimensionlessModel(self, geometry, pressure_mbar, kappa, thickness_sd_mm)


def compute_row(spec: DimensionlessSpec, entry: int) -> Array:
    """Return one entry of the table: log compliance (load,), NaN beyond the q to which it holds.

    That q is the last number. By finite elements with R = 1 mm and X1 = 1 MPa.
    """
    i, j, k = np.unravel_index(entry, spec.shape)
    thickness = float(np.exp(spec.thickness_over_radius.log_nodes()[i]))
    parameters = {
        "X1_MPa": 1.0,
        "X2_MPa": float(np.exp(spec.X2_over_X1.log_nodes()[j])),
        "kappa_MPa": float(np.exp(spec.kappa_over_X1.log_nodes()[k])),
    }
    curve = solve(
        Geometry(2.0, thickness),
        parameters,
        spec.most_load / MBAR,
        law=spec.law,
        settings=_SETTINGS,
        below_mbar=-spec.least_load / MBAR,
    )
    nodes = spec.load_coordinates()
    load = spec.load_scale * np.sinh(nodes) / _compliance(thickness)
    holds_to = curve.holds_to_mbar * MBAR
    held = np.flatnonzero((load >= spec.least_load) & (load <= holds_to))
    q = load[held]
    dome = curve.spline
    with np.errstate(invalid="ignore"):
        secant = dome(q / MBAR) / q
    secant[np.abs(q) < 1e-9] = dome(0.0, 1) / MBAR  # at zero the secant is the tangent
    row = np.full(len(nodes), np.nan)
    row[held] = np.log(secant)
    return np.append(row, holds_to)
