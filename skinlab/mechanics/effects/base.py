"""What an effect is: a named, parameterised change of the forward model.

At its zero it is the base model. A physical effect changes the mechanical problem before it is
solved; a sensor effect changes what is read from the finished curve. Nothing outside an effect's
own file asks which effect it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.pressure_path import PressurePath
from skinlab.errors import InputError
from skinlab.parameters import Parameter, check_declared

__all__ = ["Array", "Effect", "Effects", "Parameter", "Values"]
from skinlab.plugins import needs, texts

if TYPE_CHECKING:
    from skinlab.mechanics.fem.skin import SkinProblem

Array = NDArray[np.float64]
Values = Mapping[str, float]
Effects = Mapping[str, Values]  # by the names of effects, then of parameters


class Effect:
    """One effect; subclasses declare what it is and override what it does.

    `needs_history`: it shows in rate, hold, unloading or later cycles. Fitting the first loading
    alone would waste what tells it, and a table of it holds along one program. False of what
    depends on the suction alone; such effects are tried (`history.py`).
    """

    name: ClassVar[str]
    meaning: ClassVar[str]  # one sentence
    formula: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    source: ClassVar[str]
    physical: ClassVar[bool]
    needs_history: ClassVar[bool] = True
    bends: ClassVar[bool] = False  # `felt` bends each reading, and so its noise

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Return the mechanical problem with this effect, in this cycle (1 = first loading)."""
        return problem

    same_as: ClassVar[str] = ""  # what no curve can tell it from; such an effect is never named
    form_of: ClassVar[str] = ""  # the kind of learned effect whose function this is one form of
    family: ClassVar[str] = ""  # of a learned effect (`learned.py`): no name, but a kind of thing
    # Values of a parameter without a zero, at each of which it is screened; else its typical one.
    # Of one with a zero: larger ones, at which it is screened as well as near zero.
    tried: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    curved: ClassVar[bool] = False  # along its size: the screen is linear, and sees a part of it
    order: ClassVar[int] = 0  # of `felt` and of `read`, on the way from the pump to the record

    def felt(self, path: PressurePath, values: Values) -> PressurePath:
        """Return the suction that the skin feels where this one is measured."""
        return path

    # ---- what sensor effects override ----

    def when(self, time_s: Array, values: Values) -> Array:
        """Return the times (n,) whose deflection is recorded at these times (n,)."""
        return time_s

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Return what is recorded (n,) for a deflection (n,), `since_s` after the first sample."""
        return deflection_mm

    def read_along(
        self, since_s: Array, pressure_mbar: Array, deflection_mm: Array, values: Values
    ) -> Array:
        """Return the same where it depends on the suction (n,) that was read, too."""
        return self.read(since_s, deflection_mm, values)

    def unseen(self, values: Values, longest_s: float) -> str:
        """Return why curves no longer than this cannot show it with these values; "": they can."""
        return ""

    # ---- the same for all ----

    def full(self, values: Values) -> dict[str, float]:
        """Return the values with defaults filled in, checked.

        Raises:
            InputError: a parameter is not known, is missing, or is out of bounds.
        """
        known = {p.name: p for p in self.parameters}
        where = f"effects.{self.name}"
        for name in values:
            if name not in known:
                raise InputError(
                    f"{where}.{name} is not known; expected one of: {', '.join(known)}"
                )
        full: dict[str, float] = {}
        for name, parameter in known.items():
            value = values.get(name, parameter.default)
            if value is None:
                raise InputError(f"{where}.{name} is missing; expected a number")
            parameter.check(value, where)
            full[name] = float(value)
        return full

    @property
    def zero(self) -> dict[str, float]:
        """Values at which the effect is not there."""
        return {p.name: p.typical if p.zero is None else p.zero for p in self.parameters}

    @property
    def typical(self) -> dict[str, float]:
        """A size that is seen in practice."""
        return {p.name: p.typical for p in self.parameters}


def check_effect(one: object) -> None:
    """Check that an extension is an effect.

    Raises:
        TypeError, ValueError: it is not.
    """
    needs(one, "meaning", "formula", "parameters", "source", "physical")
    if not isinstance(one, Effect):
        raise TypeError(
            f"it is a {type(one).__name__}; expected a skinlab.mechanics.effects.base.Effect"
        )
    texts(one, "meaning", "formula", "source", "same_as", "form_of", "family")
    for name in ("physical", "needs_history", "bends", "curved"):
        if not isinstance(getattr(one, name), bool):
            raise TypeError(f"its {name} is {getattr(one, name)!r}; expected True or False")
    if not isinstance(one.order, int):
        raise TypeError(f"its order is {one.order!r}; expected an int")
    _check_physical(one)
    check_declared(one.parameters)
    _check_family(one)
    for p in one.parameters:  # it is searched between its bounds; a law says where to search
        if p.spacing == "log" and not p.low > 0.0:
            raise ValueError(f"its parameter {p.name}: low is {p.low:g}; log needs more than 0")
    _check_tried(one)
    if not any(p.zero is not None for p in one.parameters):
        raise TypeError("none of its parameters has a zero; expected one, the effect's size")


def _check_physical(one: Effect) -> None:
    """Check that an effect overrides only what one of its kind is asked for.

    Raises:
        TypeError: it overrides what is never called.
    """
    skin, record = ("change", "felt"), ("when", "read", "read_along")
    asked, never = (skin, record) if one.physical else (record, skin)
    for name in never:
        if getattr(type(one), name) is not getattr(Effect, name):
            raise TypeError(
                f"its physical is {one.physical}, and it overrides {name}, which such an effect is "
                f"never asked for; expected {' or '.join(asked)}"
            )


def _check_family(one: Effect) -> None:
    """Check that an effect is a learned one (`learned.py`) where it says of which family it is.

    Raises:
        TypeError: it is not: it would neither be named nor learned.
    """
    if one.family:
        own = ("abscissa", "function", "sentence", "range_name", "own_of_each")
        needs(one, "x_name", "y_name", *own)
        texts(one, "x_name", "y_name", "range_name")
        _check_range(one)
    elif hasattr(one, "own_of_each"):
        raise TypeError("its family is empty; expected what it is called in a verdict")


def _check_range(one: Any) -> None:
    """Check which parameter of a learned effect is the length of its function's range.

    Raises:
        TypeError: more than one has no zero, and each would be taken for it; or it is none of them.
    """
    lengths = [p.name for p in one.parameters if p.zero is None]
    if len(lengths) > 1:
        raise TypeError(
            f"{' and '.join(lengths)} have no zero; expected one such parameter of a learned "
            "effect, the length of its range"
        )
    if one.range_name not in (*lengths, "") or (one.own_of_each and not one.range_name):
        raise TypeError(
            f"its range_name is {one.range_name!r}; expected the parameter without a zero, "
            f"{lengths[0] if lengths else 'and there is none'}"
        )


def _check_tried(one: Effect) -> None:
    """Check the values at which an effect is screened.

    Raises:
        TypeError, ValueError: they are none, or are not of its parameters.
    """
    tried: object = one.tried
    if not isinstance(tried, Mapping):
        raise TypeError(f"its tried is a {type(tried).__name__}; expected a mapping")
    known = {p.name: p for p in one.parameters}
    for name, values in tried.items():
        if name not in known:
            raise ValueError(f"its tried has {name!r}; expected one of: {', '.join(known)}")
        p = known[name]
        if not isinstance(values, tuple | list) or not values:
            raise TypeError(f"its tried of {name} is {values!r}; expected numbers")
        for value in values:
            if not isinstance(value, Real) or not p.low <= float(value) <= p.high:
                raise ValueError(
                    f"its tried of {name} has {value!r}; expected {p.low:g} to {p.high:g}"
                )
