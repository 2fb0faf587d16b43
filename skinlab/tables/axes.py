"""The axes of a database of one's own: nodes, and a spline through them in a fitting coordinate.

Between evenly spaced nodes (in the parameter, or in its logarithm) runs a cubic spline; between
Chebyshev's, the polynomial through all of them. ν runs in log(κ/X1), in which curves are smooth
towards incompressibility.
"""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from skinlab.errors import InputError
from skinlab.mechanics.materials.compressibility import KappaConvention, kappa_ratio

Array = NDArray[np.float64]
Spacing = Literal["linear", "log", "chebyshev"]

MOST_NODES = 1000
MOST_CHEBYSHEV = 16  # a polynomial of higher degree loses digits
_STEP = 1e-6


class AxisRange(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[axis.NAME]: from `low` to `high`, both nodes."""

    low: float
    high: float
    nodes: int
    spacing: Spacing = "linear"

    def check(self, where: str, lowest: float, highest: float) -> None:
        """Refuse what cannot be.

        Raises:
            InputError: names the field, and what was expected.
        """
        for key, value in (("low", self.low), ("high", self.high)):
            if not lowest <= value <= highest:
                raise InputError(f"{where}.{key} is {value:g}: expected {lowest:g} to {highest:g}")
        if not self.low < self.high:
            raise InputError(f"{where}: low {self.low:g} is not below high {self.high:g}")
        most = MOST_CHEBYSHEV if self.spacing == "chebyshev" else MOST_NODES
        if not 2 <= self.nodes <= most:
            raise InputError(f"{where}.nodes is {self.nodes}: expected 2 to {most}")
        if self.spacing == "log" and self.low <= 0:
            raise InputError(f"{where}.spacing: log needs a positive low, got {self.low:g}")

    def values(self) -> Array:
        """Return the nodes (n,), ascending; the ends are exact."""
        if self.spacing == "log":
            nodes = np.geomspace(self.low, self.high, self.nodes)
        elif self.spacing == "chebyshev":
            share = 0.5 - 0.5 * np.cos(np.pi * np.arange(self.nodes) / (self.nodes - 1))
            nodes = self.low + (self.high - self.low) * share
        else:
            nodes = np.linspace(self.low, self.high, self.nodes)
        nodes[0], nodes[-1] = self.low, self.high
        return nodes


class Interpolant:
    """How values run along one axis, as operators."""

    def __init__(self, axis: AxisRange, *, kappa: KappaConvention | None = None) -> None:
        """`kappa` is given where the axis is ν, in that convention."""
        self.nodes = axis.values()
        self._logarithmic = axis.spacing == "log"
        self._kappa = kappa
        n = len(self.nodes)
        self.degree = n - 1 if axis.spacing == "chebyshev" else min(3, n - 1)
        # Even degrees other than the full one would need knots of their own choice; there are none.
        self._spline: BSpline = make_interp_spline(
            self.coordinate(self.nodes), np.eye(n), k=self.degree
        )

    @property
    def knots(self) -> Array:
        """Knots of the spline, in its coordinate."""
        return np.asarray(self._spline.t)

    def coordinate(self, values: Array) -> Array:
        """Return the coordinate (n,) of parameter values (n,) within the axis."""
        if self._kappa is not None:
            return np.asarray(np.log(kappa_ratio(values, self._kappa)))
        return np.asarray(np.log(values) if self._logarithmic else values)

    def coordinate_slope(self, values: Array) -> Array:
        """Return the derivative (n,) of the coordinate by the parameter."""
        if self._kappa is not None:  # a rational function: differences are good to round-off
            below, above = np.maximum(values - _STEP, 0.0), values + _STEP
            return np.asarray((self.coordinate(above) - self.coordinate(below)) / (above - below))
        return 1.0 / values if self._logarithmic else np.ones_like(values)

    def coefficients(self, values: Array, axis: int) -> Array:
        """Return the spline's coefficients of nodal values along one axis; the shape stays."""
        return np.moveaxis(np.tensordot(self._spline.c, values, axes=(1, axis)), 0, axis)

    def inside(self, values: Array) -> NDArray[np.bool_]:
        """Return which values (n,) lie on the axis, its ends included."""
        low, high = self.nodes[0], self.nodes[-1]
        slack = 1e-9 * (high - low)
        return np.asarray((values >= low - slack) & (values <= high + slack))

    def cell(self, values: Array) -> NDArray[np.intp]:
        """Return the number (n,) of the cell between two nodes; the nearest where outside."""
        found = np.searchsorted(self.nodes, values, side="right") - 1
        return np.asarray(np.clip(found, 0, len(self.nodes) - 2))
