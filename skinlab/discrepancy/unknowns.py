"""The unknowns of an explanation: the base law's parameters, and those of its effects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.effects.base import Parameter
from skinlab.mechanics.effects.model import Skin
from skinlab.mechanics.materials.compressibility import KappaConvention

Array = NDArray[np.float64]
Values = dict[str, dict[str, float]]

# Ranges of log X1 (MPa), log X2/X1 and ν: those of the shipped database.
BASE_RANGES = ((math.log(0.005), math.log(0.2)), (math.log(0.5), math.log(1000.0)), (0.2, 0.49))
BASE_NAMES = ("X1_MPa", "X2_MPa", "nu")

_SIZES = 3.0  # a prior's standard deviation, in sizes that are seen in practice
_DECADES = 0.8  # the same for a parameter that has no zero, in decades


@dataclass(frozen=True)
class Axis:
    """One effect parameter as an unknown: `typical` sizes from its zero, or a logarithm."""

    effect: str
    parameter: Parameter
    known: tuple[float, float] | None = None  # value and standard deviation, from a model

    @property
    def name(self) -> str:
        """`effect.parameter`."""
        return f"{self.effect}.{self.parameter.name}"

    @property
    def _unit(self) -> float:
        p = self.parameter
        assert p.zero is not None
        return abs(p.typical - p.zero)

    def to_value(self, u: float) -> float:
        """Return the parameter."""
        p = self.parameter
        if p.zero is None:
            return min(max(math.exp(u), p.low), p.high)
        return min(max(p.zero + self._unit * u, p.low), p.high)

    def to_u(self, value: float) -> float:
        """Return the unknown."""
        p = self.parameter
        return math.log(value) if p.zero is None else (value - p.zero) / self._unit

    def slope(self, u: float) -> float:
        """Return d value / d u."""
        return self.to_value(u) if self.parameter.zero is None else self._unit

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the unknown."""
        return self.to_u(self.parameter.low), self.to_u(self.parameter.high)

    @property
    def prior(self) -> tuple[float, float]:
        """Mean and standard deviation of its Gaussian prior."""
        p = self.parameter
        if self.known is not None:
            mean = self.to_u(self.known[0])
            return mean, max(self.known[1] / abs(self.slope(mean)), 1e-6)
        if p.zero is None:
            return math.log(p.typical), _DECADES * math.log(10.0)
        return 0.0, _SIZES

    @property
    def one_sided(self) -> bool:
        """Whether the prior is cut off at its mean, the parameter's zero."""
        p = self.parameter
        if self.known is not None or p.zero is None:
            return False
        return p.zero <= p.low or p.zero >= p.high


@dataclass(frozen=True)
class Known:
    """What a model says of one parameter: its value, and how sure; an sd of 0 fixes nothing."""

    effect: str
    parameter: str
    value: float
    sd: float  # 0: no more than the effect's own prior


@dataclass(frozen=True)
class Unknowns:
    """(log X1, log X2/X1, ν) and the axes of the effects."""

    effects: tuple[str, ...]
    kappa: KappaConvention = "paper"
    known: tuple[Known, ...] = ()  # what a model says of its own effects' parameters

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """Effect parameters that are unknown: those without a default of no effect."""
        said = {(k.effect, k.parameter): (k.value, k.sd) for k in self.known if k.sd > 0}
        return tuple(
            Axis(name, p, said.get((name, p.name)))
            for name in self.effects
            for p in get_effect(name).parameters
            if p.default is None
        )

    def with_effect(self, name: str) -> Unknowns:
        """Return these with one effect more."""
        return replace(self, effects=(*self.effects, name))

    @property
    def names(self) -> tuple[str, ...]:
        """Names, in order."""
        return (*BASE_NAMES, *(a.name for a in self.axes))

    def __len__(self) -> int:
        return 3 + len(self.axes)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (k,)."""
        pairs = [*BASE_RANGES, *(a.bounds for a in self.axes)]
        return np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])

    def skin(self, u: Array) -> Skin:
        """Return the base law's parameters."""
        x1 = math.exp(u[0])
        return Skin(x1, x1 * math.exp(u[1]), float(u[2]), self.kappa)

    def values(self, u: Array) -> Values:
        """Return the effects' parameters."""
        found: Values = {name: {} for name in self.effects}
        for known in self.known:
            if known.effect in found:
                found[known.effect][known.parameter] = known.value
        for axis, value in zip(self.axes, u[3:], strict=True):
            found[axis.effect][axis.parameter.name] = axis.to_value(float(value))
        return found

    def named(self, u: Array) -> dict[str, float]:
        """Return all parameters by name."""
        skin = self.skin(u)
        found = {"X1_MPa": skin.X1_MPa, "X2_MPa": skin.X2_MPa, "nu": skin.nu}
        return found | {a.name: a.to_value(float(v)) for a, v in zip(self.axes, u[3:], strict=True)}

    def start(self, base: Array, sizes: Mapping[str, float] | None = None) -> Array:
        """Return unknowns with the effects at their typical size, or at `sizes` times it."""
        sizes = sizes or {}
        effects = [
            a.to_u(a.known[0])
            if a.known is not None
            else a.to_u(a.parameter.typical)
            * (1.0 if a.parameter.zero is None else sizes.get(a.effect, 1.0))
            for a in self.axes
        ]
        low, high = self.bounds
        return np.asarray(np.clip(np.concatenate([base[:3], effects]), low, high))

    def among(self, more: Unknowns, u: Array) -> Array:
        """Return these unknowns (k,) out of the values of `more`, which has them all."""
        at = {name: i for i, name in enumerate(more.names)}
        return u[[at[name] for name in self.names]]

    def prior_rows(self, u: Array) -> Array:
        """Return the Gaussian priors' deviations (axes,), to be squared."""
        return np.array(
            [(v - a.prior[0]) / a.prior[1] for a, v in zip(self.axes, u[3:], strict=True)]
        )

    def information(self, jacobian: Array) -> Array:
        """Return JᵀJ of whitened residuals (n, k), with the priors: (k, k)."""
        flat = [12.0 / (high - low) ** 2 for low, high in BASE_RANGES]
        gauss = [1.0 / axis.prior[1] ** 2 for axis in self.axes]
        return np.asarray(jacobian.T @ jacobian + np.diag([*flat, *gauss]))

    @property
    def log_prior_volume(self) -> float:
        """Return the log of the normalisation of all priors: flat ranges, Gaussians."""
        flat = sum(math.log(high - low) for low, high in BASE_RANGES)
        gauss = sum(
            math.log(a.prior[1])
            + 0.5 * math.log(2 * math.pi)
            - (math.log(2.0) if a.one_sided else 0)
            for a in self.axes
        )
        return flat + gauss
