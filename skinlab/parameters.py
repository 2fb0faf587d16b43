"""Parameters of laws and effects, and the spaces of unknown ones that methods search."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Integral, Real
from typing import Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from skinlab.errors import InputError

Array = NDArray[np.float64]

Transform = Literal["linear", "log", "ratio"]
Spacing = Literal["linear", "log"]


@dataclass(frozen=True)
class Search:
    """Where a fit looks for a parameter, and in which coordinate it is even.

    `transform`: the value itself, its logarithm, or the logarithm of its ratio to the law's
    stiffness scale; of a ratio, `low` and `high` are those of the ratio. `step` and `reach` are
    lengths in that coordinate: of a difference that shows how curves change, and of how far a
    linear picture of that change is trusted. None: a 75th and an eighth of the range.
    """

    low: float
    high: float
    transform: Transform = "linear"
    step: float | None = None
    reach: float | None = None

    @property
    def ends(self) -> tuple[float, float]:
        """Both ends in the coordinate."""
        if self.transform == "linear":
            return self.low, self.high
        return math.log(self.low), math.log(self.high)

    @property
    def lengths(self) -> tuple[float, float]:
        """`step` and `reach`, filled in."""
        span = self.ends[1] - self.ends[0]
        step = span / 75 if self.step is None else self.step
        return step, span / 8 if self.reach is None else self.reach


@dataclass(frozen=True)
class Nodes:
    """The axis of a table along a parameter, where a spec says no more."""

    low: float
    high: float
    count: int
    spacing: Spacing = "linear"


@dataclass(frozen=True)
class Parameter:
    """One number of a law or an effect.

    `low` and `high` are the bounds within which it may be set at all. `zero` is the value at which
    an effect is not there, whatever its other parameters say; None where this parameter has no such
    value (a time constant). `typical` is a size that is seen in practice. `default` is taken where
    a file does not give the parameter; None: it must be given. A law's parameter says besides how
    reports call it, where fits look for it, what a table's axis is, and the nodes of the source's
    own grid, between whose ends its algorithms search (`published`).
    """

    name: str  # with its unit, where it has one: X1_MPa
    unit: str
    meaning: str
    low: float
    high: float
    zero: float | None
    typical: float
    source: str
    spacing: Spacing = "linear"
    default: float | None = None
    symbol: str = ""
    search: Search | None = None
    axis: Nodes | None = None
    published: tuple[float, ...] = ()

    @property
    def label(self) -> str:
        """How a reader calls it: X1, ν."""
        return self.symbol or stem(self.name, self.unit)

    @property
    def heading(self) -> str:
        """The label with the unit: X1 (MPa)."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    def check(self, value: float, where: str = "") -> None:
        """Refuse a value out of bounds.

        Raises:
            InputError: names the field, and what was expected.
        """
        if not (math.isfinite(value) and self.low <= value <= self.high):
            unit = f" {self.unit}" if self.unit else ""
            name = f"{where}.{self.name}" if where else self.name
            raise InputError(f"{name} is {value:g}: expected {self.low:g} to {self.high:g}{unit}")


def check_declared(parameters: object) -> None:
    """Check the parameters that an extension declares.

    Raises:
        TypeError, ValueError: they cannot work; names the parameter and what was expected.
    """
    if not isinstance(parameters, tuple | list) or not all(
        isinstance(p, Parameter) for p in parameters
    ):
        raise TypeError("its parameters are not skinlab.parameters.Parameter")
    for p in parameters:
        if not isinstance(p.name, str) or not p.name.isidentifier():
            raise TypeError(f"its parameter {p.name!r}: expected a name of letters, digits and _")
        for field in ("unit", "meaning", "source", "symbol"):
            if not isinstance(getattr(p, field), str):
                raise TypeError(f"its parameter {p.name}: {field} is no text")
        if p.spacing not in get_args(Spacing):
            raise ValueError(f"its parameter {p.name}: spacing {p.spacing!r}; expected linear, log")
        ends = [("low", p.low), ("high", p.high), ("typical", p.typical)]
        ends += [(f, v) for f, v in (("zero", p.zero), ("default", p.default)) if v is not None]
        for field, value in ends:
            if not isinstance(value, Real):
                raise TypeError(f"its parameter {p.name}: {field} is {value!r}; expected a number")
            if not math.isfinite(value):  # a search goes through all that is between the bounds
                raise ValueError(
                    f"its parameter {p.name}: {field} is {value:g}; expected a finite number"
                )
            if not p.low <= value <= p.high or p.low == p.high:
                raise ValueError(
                    f"its parameter {p.name}: {field} is {value:g} in {p.low:g} to {p.high:g}; "
                    "expected low below high, and all else between them"
                )
        _check_search(p)
    names = [p.name for p in parameters]
    if len(set(names)) != len(names):
        raise ValueError(f"two of its parameters have one name: {', '.join(names)}")


def _check_search(p: Parameter) -> None:
    for what, one in (("search", p.search), ("axis", p.axis)):
        if one is None:
            continue
        if not isinstance(one, Search if what == "search" else Nodes):
            raise TypeError(f"its parameter {p.name}: {what} is a {type(one).__name__}")
        where = f"its parameter {p.name}: {what}"
        ends: tuple[object, ...] = (one.low, one.high)
        for end in ends:
            if not isinstance(end, Real):
                raise TypeError(f"{where} ends at {end!r}; expected a number")
        if not -math.inf < one.low < one.high < math.inf:
            raise ValueError(f"{where} is {one.low:g} to {one.high:g}; expected low below high")
        if isinstance(one, Search):
            even, known = one.transform, get_args(Transform)
            for field in ("step", "reach"):
                size: object = getattr(one, field)
                if size is None or (isinstance(size, Real) and 0.0 < float(size) < math.inf):
                    continue
                raise ValueError(f"{where} has the {field} {size!r}; expected more than 0")
        else:
            even, known = one.spacing, get_args(Spacing)
            count: object = one.count
            if not isinstance(count, Integral) or one.count < 2:
                raise ValueError(f"{where} has {count!r} nodes; expected an int above 1")
        if even not in known:
            raise ValueError(f"{where} is even in {even!r}; expected {', '.join(known)}")
        if even != "linear" and one.low <= 0.0:
            raise ValueError(f"{where} begins at {one.low:g}; {even} needs more than 0")
        if even != "ratio" and not p.low <= one.low < one.high <= p.high:
            raise ValueError(
                f"{where} is {one.low:g} to {one.high:g}; expected what lies within {p.low:g} to "
                f"{p.high:g}"
            )
    nodes: object = p.published
    if not isinstance(nodes, tuple) or not all(isinstance(node, Real) for node in nodes):
        raise TypeError(f"its parameter {p.name}: published is {nodes!r}; expected numbers")
    if list(nodes) != sorted(set(nodes)) or len(nodes) == 1:
        raise ValueError(f"its parameter {p.name}: published is {nodes!r}; expected rising numbers")


def stem(name: str, unit: str) -> str:
    """Return a parameter's name without its unit: X1 of X1_MPa, frequency of frequency_hz."""
    ending = "_" + unit.replace("µ", "u").replace("/", "_per_")
    return name.removesuffix(ending).removesuffix(ending.lower()) if unit else name


class ParameterSpace(Protocol):
    """What methods ask of a space: parameters (..., k), mapped from the unit cube [0, 1]^k."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names, which carry their unit."""
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

    def by_unit(self, parameters: Array) -> Array:
        """Return derivatives (..., p, k) of parameters (..., p) by the cube's coordinates."""
        ...


@dataclass(frozen=True)
class Space:
    """Unknown parameters (..., k) in the order of `names`, and the unit cube [0, 1]^k of a search.

    Each is even between its ends in its own coordinate: its value, its logarithm, or the logarithm
    of its ratio to the parameter number `scale`, whose ends are then those of the ratio.
    """

    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    transforms: tuple[Transform, ...]
    scale: int = 0

    @classmethod
    def box(cls, names: Sequence[str], low: Sequence[float], high: Sequence[float]) -> Space:
        """Return a box: every parameter evenly between its bounds."""
        even: list[Transform] = ["linear"] * len(names)
        return cls(tuple(names), tuple(low), tuple(high), tuple(even))

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def _logs(self) -> NDArray[np.bool_]:
        return np.array([t != "linear" for t in self.transforms])

    @cached_property
    def _ratios(self) -> NDArray[np.intp]:
        return np.flatnonzero([t == "ratio" for t in self.transforms])

    @cached_property
    def ends(self) -> tuple[Array, Array]:
        """Lower and upper ends (k,), in the coordinates."""
        logs = self._logs

        def of(values: tuple[float, ...]) -> Array:
            at = np.array(values, dtype=float)
            at[logs] = np.log(at[logs])
            at.flags.writeable = False  # it is kept, and methods of others are given it
            return at

        return of(self.low), of(self.high)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (k,) that the parameters can reach at all, as users say them."""
        low, high = np.array(self.low, dtype=float), np.array(self.high, dtype=float)
        low[self._ratios] *= low[self.scale]
        high[self._ratios] *= high[self.scale]
        low.flags.writeable = high.flags.writeable = False
        return low, high

    def coordinates(self, parameters: Array) -> Array:
        """Return the coordinates (..., k) of parameters; NaN or infinite where these have none."""
        at = np.array(parameters, dtype=float)
        with np.errstate(divide="ignore", invalid="ignore"):
            at[..., self._ratios] /= at[..., [self.scale]]
            at[..., self._logs] = np.log(at[..., self._logs])
        return at

    def from_coordinates(self, at: Array) -> Array:
        """Return the parameters (..., k) at coordinates."""
        values = np.array(at, dtype=float)
        values[..., self._logs] = np.exp(values[..., self._logs])
        values[..., self._ratios] *= values[..., [self.scale]]
        return values

    def from_unit(self, unit: Array) -> Array:
        """Return the parameters (..., k) at points of the cube."""
        low, high = self.ends
        return self.from_coordinates(low + (high - low) * unit)

    def to_unit(self, parameters: Array) -> Array:
        """Return the points of the cube (..., k) of parameters."""
        low, high = self.ends
        return np.asarray((self.coordinates(parameters) - low) / (high - low))

    def by_unit(self, parameters: Array) -> Array:
        """Return derivatives (..., k, k) of parameters (..., k) by the cube's coordinates."""
        low, high = self.ends
        each = (high - low) * np.where(self._logs, parameters, 1.0)
        slopes = each[..., None] * np.eye(len(self))
        if len(self._ratios):
            share = each[..., [self.scale]] / parameters[..., [self.scale]]
            slopes[..., self._ratios, self.scale] = parameters[..., self._ratios] * share
        return np.asarray(slopes)

    def outside(self, parameters: Array) -> str:
        """Return which end the parameters (k,) are beyond, in words; empty where none."""
        for i, name in enumerate(self.names):
            value, called = float(parameters[i]), name
            if self.transforms[i] == "ratio":
                value /= float(parameters[self.scale])
                called = "/".join(n.rpartition("_")[0] or n for n in (name, self.names[self.scale]))
            low, high = self.low[i], self.high[i]
            slack = 1e-9 * max(abs(low), abs(high))
            if not low - slack <= value <= high + slack:
                return f"{called} {value:g} is outside the database ({low:.4g}–{high:.4g})"
        return ""

    def extended(self, name: str, low: float, high: float) -> Space:
        """Return the space with one more parameter at its end, searched in its logarithm."""
        return replace(
            self,
            names=(*self.names, name),
            low=(*self.low, low),
            high=(*self.high, high),
            transforms=(*self.transforms, "log"),
        )
