"""The axes of tables: nodes, and a spline through them in a fitting coordinate.

In a custom table, between evenly spaced nodes (in the parameter, or in its logarithm) runs a cubic
spline; between Chebyshev's, the polynomial through all of them. ν runs in log κ/(μ/2), in which
curves are smooth towards incompressibility.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinlab.errors import InputError
from skinlab.mechanics.materials.compressibility import (
    KappaConvention,
    kappa_ratio,
    log_ratio_slope,
    nu_from_ratio,
)
from skinlab.tables.settings import NODES
from skinlab.tables.splines import along, inverse, inverse_of, knots, knots_through

Array = NDArray[np.float64]
Spacing = Literal["linear", "log", "chebyshev"]

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
        most = NODES.most_chebyshev if self.spacing == "chebyshev" else NODES.most
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


@dataclass(frozen=True)
class Coordinate:
    """From a parameter to what values of a table run along: smooth, and increasing.

    `ratio` is the logarithm of the parameter's ratio to the law's scale. Poisson's ratio, meant in
    the convention `kappa`, runs in log κ/(μ/2) (`dilatation`), or in what it is in the convention
    of the table, `stored` (`poisson`).
    """

    kind: Literal["linear", "log", "ratio", "dilatation", "poisson"]
    kappa: KappaConvention = "paper"
    stored: KappaConvention = "paper"

    def __call__(self, values: Array, scale: Array) -> Array:
        """Return the coordinate (n,) of values (n,); NaN or infinite where there is none."""
        if self.kind == "linear":
            return values
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.kind == "log":
                return np.asarray(np.log(values))
            if self.kind == "ratio":
                return np.asarray(np.log(values) - np.log(scale))
        if self.kind == "poisson" and self.kappa == self.stored:
            return values
        possible = (values >= 0.0) & (values < 0.5)
        ratio = kappa_ratio(np.where(possible, values, 0.3), self.kappa)
        if self.kind == "dilatation":
            found = np.log(ratio)
        else:
            with np.errstate(invalid="ignore"):  # softer than the other convention knows
                found = nu_from_ratio(ratio, self.stored)
        return np.where(possible, found, np.nan)

    def dilatation_ratio(self, values: Array) -> Array | None:
        """Return κ/(μ/2) of values (n,) of Poisson's ratio; None of another parameter."""
        if self.kind not in ("dilatation", "poisson"):
            return None
        return np.asarray(kappa_ratio(values, self.kappa))

    def by_parameter(self, slopes: Array, values: Array) -> Array:
        """Return derivatives (n, k) by the parameter at values (n,), from those by the coordinate.

        Of a ratio: with the scale as it is.
        """
        if self.kind in ("log", "ratio"):
            return slopes / values[:, None]
        if self.kind == "linear" or (self.kind == "poisson" and self.kappa == self.stored):
            return slopes
        at = np.maximum(values, _STEP)  # at 0 it may be flat, and a fit would stay there
        if self.kind == "dilatation":
            return np.asarray(slopes * log_ratio_slope(at, self.kappa)[:, None])
        # κ(ν) is a rational function: central differences are good to round-off
        rise = self(at + _STEP, at) - self(at - _STEP, at)
        return np.asarray(slopes * (rise / (2 * _STEP))[:, None])


class TableAxis:
    """The nodes of a table along one parameter, and the spline through them, as operators."""

    def __init__(self, coordinate: Coordinate, nodes: Array, degree: int = 3) -> None:
        """`nodes` (n,) ascend, in the coordinate."""
        self.coordinate, self.nodes, self.degree = coordinate, nodes, degree
        slack = 1e-9 * float(nodes[-1] - nodes[0])
        self.ends = float(nodes[0]) - slack, float(nodes[-1]) + slack
        steps = np.diff(nodes)
        self._even = bool(np.ptp(steps) <= 1e-9 * steps[0])

    @cached_property
    def _spline(self) -> tuple[Array, Array]:
        if self.degree == 3 and self._even:
            return knots(self.nodes), inverse(len(self.nodes))
        # Even degrees other than the full one would need knots of their own choice; there are none.
        return knots_through(self.nodes, self.degree), inverse_of(self.nodes, self.degree)

    @property
    def knots(self) -> Array:
        """Knots of the spline."""
        return self._spline[0]

    def coefficients(self, values: Array, axis: int) -> Array:
        """Return the spline's coefficients of nodal values along one axis; the shape stays."""
        return along(self._spline[1], values, axis)

    def inside(self, at: Array) -> NDArray[np.bool_]:
        """Return which coordinates (n,) lie on the axis, its ends included."""
        return np.asarray((at >= self.ends[0]) & (at <= self.ends[1]))

    def cell(self, at: Array) -> NDArray[np.intp]:
        """Return the number (n,) of the cell between two nodes; the nearest where outside."""
        last = len(self.nodes) - 2
        if self._even:  # quicker; `fmax` takes the number where the other is NaN
            place = (at - self.nodes[0]) * ((last + 1) / (self.nodes[-1] - self.nodes[0]))
            return np.asarray(np.fmin(np.fmax(place, 0.0), last).astype(np.intp))
        found = np.searchsorted(self.nodes, at, side="right") - 1
        return np.asarray(np.clip(found, 0, last))


def axis_of(axis: AxisRange, *, kappa: KappaConvention | None = None) -> TableAxis:
    """Return the axis of a custom table; `kappa` is given where it is Poisson's ratio's."""
    kind: Literal["linear", "log"] = "log" if axis.spacing == "log" else "linear"
    coordinate = Coordinate(kind) if kappa is None else Coordinate("dilatation", kappa)
    nodes = axis.values()
    degree = len(nodes) - 1 if axis.spacing == "chebyshev" else min(3, len(nodes) - 1)
    return TableAxis(coordinate, coordinate(nodes, nodes), degree)
