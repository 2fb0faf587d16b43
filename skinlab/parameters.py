"""Spaces of unknown parameters: names, bounds, and the unit cube that methods search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class ParameterSpace(Protocol):
    """Parameters (..., k) in the order of `names`, mapped from the unit cube [0, 1]^k."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names, which carry their unit: X1_MPa."""
        ...

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (k,), as a user would say them."""
        ...

    def from_unit(self, unit: Array) -> Array:
        """Return the parameters (..., k) at points of the cube."""
        ...

    def to_unit(self, parameters: Array) -> Array:
        """Return the points of the cube (..., k) of parameters."""
        ...


def contains(space: ParameterSpace, parameters: Array) -> NDArray[np.bool_]:
    """Return which parameters (..., k) lie in the space, its bounds included."""
    unit = space.to_unit(parameters)
    return np.asarray(((unit >= -1e-12) & (unit <= 1 + 1e-12)).all(axis=-1))


@dataclass(frozen=True)
class BoxSpace:
    """A box: every parameter between its bounds, evenly."""

    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (k,)."""
        return np.array(self.low), np.array(self.high)

    def from_unit(self, unit: Array) -> Array:
        """Return the parameters."""
        low, high = self.bounds
        return low + (high - low) * unit

    def to_unit(self, parameters: Array) -> Array:
        """Return the points of the cube."""
        low, high = self.bounds
        return (parameters - low) / (high - low)


# The paper's section 2.3: where its stochastic algorithm searches.
PAPER_BOX = BoxSpace(("X1_MPa", "X2_MPa", "nu"), (0.01, 0.1, 0.2), (0.1, 4.9, 0.48))


@dataclass(frozen=True)
class RatioSpace:
    """(X1, X2, ν) with bounds on X1, on X2/X1 and on ν; even in log X1, log X2/X1 and ν."""

    X1_MPa: tuple[float, float]
    ratio: tuple[float, float]
    nu: tuple[float, float]
    names: tuple[str, ...] = ("X1_MPa", "X2_MPa", "nu")

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (3,) that the parameters can reach at all."""
        low = (self.X1_MPa[0], self.X1_MPa[0] * self.ratio[0], self.nu[0])
        high = (self.X1_MPa[1], self.X1_MPa[1] * self.ratio[1], self.nu[1])
        return np.array(low), np.array(high)

    def _ends(self) -> tuple[Array, Array]:
        rows = np.array([np.log(self.X1_MPa), np.log(self.ratio), self.nu])
        return rows[:, 0], rows[:, 1]

    def from_unit(self, unit: Array) -> Array:
        """Return the parameters."""
        low, high = self._ends()
        at = low + (high - low) * unit
        x1 = np.exp(at[..., 0])
        return np.stack([x1, x1 * np.exp(at[..., 1]), at[..., 2]], axis=-1)

    def outside(self, parameters: Array) -> str:
        """Return which bound the parameters (3,) violate, in words; empty where none."""
        x1, x2, nu = parameters
        rows = (("X1_MPa", x1, self.X1_MPa), ("X2/X1", x2 / x1, self.ratio), ("nu", nu, self.nu))
        for name, value, (low, high) in rows:
            if not low * (1 - 1e-9) <= value <= high * (1 + 1e-9):
                return f"{name} {value:g} is outside the database ({low:.4g}–{high:.4g})"
        return ""

    def to_unit(self, parameters: Array) -> Array:
        """Return the points of the cube."""
        low, high = self._ends()
        x1, x2, nu = np.moveaxis(parameters, -1, 0)
        at = np.stack([np.log(x1), np.log(x2 / x1), nu], axis=-1)
        return np.asarray((at - low) / (high - low))


@dataclass(frozen=True)
class AxisSpace:
    """A box whose parameters are even between their bounds, or in their logarithms."""

    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    logarithmic: tuple[bool, ...]

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (k,)."""
        return np.array(self.low), np.array(self.high)

    def _ends(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        logs = np.array(self.logarithmic)
        low, high = self.bounds
        return (
            np.where(logs, np.log(np.where(logs, low, 1.0)), low),
            np.where(logs, np.log(np.where(logs, high, 1.0)), high),
            logs,
        )

    def from_unit(self, unit: Array) -> Array:
        """Return the parameters."""
        low, high, logs = self._ends()
        at = low + (high - low) * unit
        return np.asarray(np.where(logs, np.exp(np.where(logs, at, 0.0)), at))

    def to_unit(self, parameters: Array) -> Array:
        """Return the points of the cube."""
        low, high, logs = self._ends()
        at = np.where(logs, np.log(np.where(logs, parameters, 1.0)), parameters)
        return np.asarray((at - low) / (high - low))


@dataclass(frozen=True)
class WithFactor:
    """A space with one more parameter at its end: a factor, even in its logarithm."""

    base: ParameterSpace
    name: str
    low: float
    high: float

    @property
    def names(self) -> tuple[str, ...]:
        """The base's names and this one."""
        return (*self.base.names, self.name)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds."""
        low, high = self.base.bounds
        return np.append(low, self.low), np.append(high, self.high)

    def from_unit(self, unit: Array) -> Array:
        """Return the parameters."""
        factor = self.low * (self.high / self.low) ** unit[..., -1:]
        return np.concatenate([self.base.from_unit(unit[..., :-1]), factor], axis=-1)

    def to_unit(self, parameters: Array) -> Array:
        """Return the points of the cube."""
        span = np.log(self.high / self.low)
        last = np.log(parameters[..., -1:] / self.low) / span
        return np.concatenate([self.base.to_unit(parameters[..., :-1]), last], axis=-1)
