"""The unknowns of an explanation: the base law's parameters, and those of its effects."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.settings import SEARCH
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.fem.skin import Skin
from skinlab.mechanics.materials import DEFAULT_LAW, get_law
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.parameters import Parameter, Search, Space

Array = NDArray[np.float64]
Values = dict[str, dict[str, float]]

_FLAT = 10.0  # times as wide as the bounds: a Gaussian that is as good as even between them
HELD = 0.003  # of its range, or of a logarithm's value: the deviation of a parameter that is held


@dataclass(frozen=True)
class Axis:
    """One effect parameter as an unknown: `typical` sizes from its zero, or a logarithm."""

    effect: str
    parameter: Parameter  # with a model's bounds, where it has its own
    known: Known | None = None  # what a model says

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
        p, known = self.parameter, self.known
        if known is not None and known.sd > 0:
            mean = self.to_u(known.value if known.mean is None else known.mean)
            return mean, max(known.sd / abs(self.slope(mean)), 1e-6)
        if known is not None and known.bounded:
            low, high = self.bounds
            return 0.5 * (low + high), _FLAT * (high - low)
        if p.zero is None:
            return math.log(p.typical), SEARCH.prior_decades * math.log(10.0)
        return 0.0, SEARCH.prior_sizes

    @property
    def one_sided(self) -> bool:
        """Whether the prior is cut off at its mean, the parameter's zero."""
        p = self.parameter
        if p.zero is None or self.prior[0] != self.to_u(p.zero):
            return False
        return p.zero <= p.low or p.zero >= p.high


@dataclass(frozen=True)
class Known:
    """What a model says of one parameter: where it begins, and its prior."""

    effect: str
    parameter: str
    value: float
    sd: float = 0.0  # 0: even between bounds of its own, else the effect's own prior
    stated: bool = False  # with the data (the thickness' uncertainty), not by a model
    mean: float | None = None  # of the prior; None: the value
    low: float | None = None  # None: the effect's own bound
    high: float | None = None

    @property
    def bounded(self) -> bool:
        """Whether it has bounds of its own."""
        return self.low is not None or self.high is not None

    def within(self, parameter: Parameter) -> Parameter:
        """Return the parameter with these bounds."""
        low = parameter.low if self.low is None else self.low
        high = parameter.high if self.high is None else self.high
        return replace(parameter, low=low, high=high)


@dataclass(frozen=True)
class BasePrior:
    """What a model says of one of the law's parameters: a normal prior of its value."""

    index: int
    mean: float
    sd: float


@dataclass(frozen=True)
class Unknowns:
    """The law's parameters, in the coordinates of their space, and the axes of the effects."""

    effects: tuple[str, ...]
    kappa: KappaConvention = "paper"
    known: tuple[Known, ...] = ()  # what a model says of its own effects' parameters
    law: str = DEFAULT_LAW
    base_space: Space | None = None  # of a model that bounds the law's parameters; None: the law's
    base_priors: tuple[BasePrior, ...] = ()

    @cached_property
    def space(self) -> Space:
        """Where the law's parameters are looked for."""
        return get_law(self.law).space if self.base_space is None else self.base_space

    @property
    def base_names(self) -> tuple[str, ...]:
        """Names of the law's parameters."""
        return self.space.names

    @cached_property
    def count(self) -> int:
        """Number of the law's parameters; the axes' follow them."""
        return len(self.space)

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """Effect parameters that are unknown: those without a default of no effect."""
        said = {(k.effect, k.parameter): k for k in self.known}
        return tuple(
            Axis(name, p) if known is None else Axis(name, known.within(p), known)
            for name in self.effects
            for p in get_effect(name).parameters
            if p.default is None
            for known in (said.get((name, p.name)),)
        )

    def with_effect(self, name: str) -> Unknowns:
        """Return these with one effect more."""
        return replace(self, effects=(*self.effects, name))

    def holding(self, u: Array, which: Sequence[int]) -> Unknowns:
        """Return these with some of the law's parameters held where they are at u (k,)."""
        space = self.space
        values = space.from_coordinates(u[: self.count])
        ranges = (high - low for low, high in zip(space.low, space.high, strict=True))
        sizes = [
            r if kind == "linear" else float(v)
            for r, v, kind in zip(ranges, values, space.transforms, strict=True)
        ]
        held = [BasePrior(int(i), float(values[i]), HELD * sizes[i]) for i in which]
        others = [prior for prior in self.base_priors if prior.index not in which]
        return replace(self, base_priors=(*others, *held))

    @property
    def plain(self) -> Unknowns:
        """These without any effect."""
        return replace(self, effects=(), known=())

    @property
    def names(self) -> tuple[str, ...]:
        """Names, in order."""
        return (*self.base_names, *(a.name for a in self.axes))

    def __len__(self) -> int:
        return self.count + len(self.axes)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (k,)."""
        low, high = self.space.ends
        pairs = [a.bounds for a in self.axes]
        return (
            np.concatenate([low, [p[0] for p in pairs]]),
            np.concatenate([high, [p[1] for p in pairs]]),
        )

    @cached_property
    def _searches(self) -> tuple[Search, ...]:
        """Where the law's parameters are looked for, in the coordinates of `space`."""
        space, found = self.space, []
        for own, low, high, transform in zip(
            get_law(self.law).search, space.low, space.high, space.transforms, strict=True
        ):
            same = own.transform == transform or {own.transform, transform} == {"log", "ratio"}
            lengths = (own.step, own.reach) if same else (None, None)
            found.append(Search(low, high, transform, *lengths))
        return tuple(found)

    @property
    def reaches(self) -> Array:
        """How far (count,) a linear picture in the law's coordinates is trusted."""
        return np.array([s.lengths[1] for s in self._searches])

    def at_share(self, shares: Array) -> Array:
        """Return coordinates (count,) of the law's parameters at shares of their ranges."""
        low, high = self.space.ends
        return np.asarray(low + shares * (high - low))

    def base(self, u: Array) -> dict[str, float]:
        """Return the law's parameters by name."""
        values = self.space.from_coordinates(u[: self.count])
        return {n: float(v) for n, v in zip(self.base_names, values, strict=True)}

    def skin(self, u: Array) -> Skin:
        """Return the law's parameters as a skin."""
        return self.skin_of(self.space.from_coordinates(u[: self.count]))

    def skin_of(self, values: Array) -> Skin:
        """Return the law's parameters (count,) as a skin.

        Raises:
            InputError: a value is out of its range.
        """
        return Skin(tuple(values.tolist()), self.kappa, self.law)

    def values(self, u: Array) -> Values:
        """Return the effects' parameters."""
        found: Values = {name: {} for name in self.effects}
        for known in self.known:
            if known.effect in found:
                found[known.effect][known.parameter] = known.value
        for axis, value in zip(self.axes, u[self.count :], strict=True):
            found[axis.effect][axis.parameter.name] = axis.to_value(float(value))
        return found

    def named(self, u: Array) -> dict[str, float]:
        """Return all parameters by name."""
        effects = zip(self.axes, u[self.count :], strict=True)
        return self.base(u) | {a.name: a.to_value(float(v)) for a, v in effects}

    def start(self, base: Array, sizes: Mapping[str, float] | None = None) -> Array:
        """Return unknowns with the effects at their typical size, or at `sizes` times it."""
        sizes = sizes or {}
        effects = [
            a.to_u(a.known.value)
            if a.known is not None
            else a.to_u(a.parameter.typical)
            * (1.0 if a.parameter.zero is None else sizes.get(a.effect, 1.0))
            for a in self.axes
        ]
        low, high = self.bounds
        return np.asarray(np.clip(np.concatenate([base[: self.count], effects]), low, high))

    def among(self, more: Unknowns, u: Array) -> Array:
        """Return these unknowns (k,) out of the values of `more`, which has them all."""
        at = {name: i for i, name in enumerate(more.names)}
        return u[[at[name] for name in self.names]]

    # ---- priors ----

    def prior_rows(self, u: Array) -> Array:
        """Return the Gaussian priors' deviations (priors,), to be squared."""
        axes = [
            (v - a.prior[0]) / a.prior[1] for a, v in zip(self.axes, u[self.count :], strict=True)
        ]
        if not self.base_priors:
            return np.array(axes)
        values = self.space.from_coordinates(u[: self.count])
        return np.array(axes + [(values[p.index] - p.mean) / p.sd for p in self.base_priors])

    def prior_slopes(self, u: Array) -> Array:
        """Return the derivatives (priors, k) of `prior_rows`."""
        slopes = np.zeros((len(self.axes) + len(self.base_priors), len(self)))
        for i, axis in enumerate(self.axes):
            slopes[i, self.count + i] = 1.0 / axis.prior[1]
        if self.base_priors:
            at, space = u[: self.count], self.space
            values = space.from_coordinates(at)
            for i, prior in enumerate(self.base_priors, start=len(self.axes)):
                value, kind = values[prior.index], space.transforms[prior.index]
                slopes[i, prior.index] = (1.0 if kind == "linear" else value) / prior.sd
                if kind == "ratio":  # the value rises with the scale as well
                    slopes[i, space.scale] += value / prior.sd
        return slopes

    def information(self, jacobian: Array, u: Array) -> Array:
        """Return JᵀJ of whitened residuals (n, k) at u, with the priors: (k, k)."""
        low, high = self.space.ends
        flat = np.concatenate([12.0 / (high - low) ** 2, np.zeros(len(self.axes))])
        for prior in self.base_priors:  # the Gaussian says all that there is
            flat[prior.index] = 0.0
        slopes = self.prior_slopes(u)
        return np.asarray(jacobian.T @ jacobian + np.diag(flat) + slopes.T @ slopes)

    @property
    def log_prior_volume(self) -> float:
        """Return the log of the normalisation of all priors: flat ranges, Gaussians.

        A model's own priors of the law's parameters are common to all its explanations: left out.
        """
        low, high = self.space.ends
        flat = float(np.log(high - low).sum())
        gauss = sum(
            math.log(a.prior[1])
            + 0.5 * math.log(2 * math.pi)
            - (math.log(2.0) if a.one_sided else 0)
            for a in self.axes
        )
        return flat + gauss
