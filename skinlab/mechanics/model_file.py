"""MODEL.toml: a law, bounds on its parameters, the effects added to it, and what they are from.

    [model]
    name = "forearm with relaxation"
    law = "extended_neo_hookean"
    kappa = "paper"

    [parameters.X1_MPa]
    low = 0.005
    high = 0.2
    prior = "log-uniform"

    [effects.viscoelasticity.g]
    low = 0.0
    high = 0.9
    value = 0.27
    prior = {mean = 0.27, sd = 0.02}

    [provenance]
    verdict = "named"

Everything but `[model] name` and an effect's `value` may be left out. Decoded strictly.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec
from msgspec import field

from drivers.reading import read_whole
from skinlab.errors import BrokenPluginError, InputError
from skinlab.io.documents import decode, read_toml, toml_text
from skinlab.io.files import named_in_errors
from skinlab.mechanics.effects import checked, get_effect
from skinlab.mechanics.materials import DEFAULT_LAW, Law, get_law
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.mechanics.model_plugins import check_installed, what_differs
from skinlab.parameters import Space
from skinlab.plugins import warn

T = TypeVar("T")

PriorName = Literal["uniform", "log-uniform"]


class Normal(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A normal prior, cut off at the bounds."""

    mean: float
    sd: float


class Range(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Bounds and prior of one of the law's parameters."""

    low: float
    high: float
    prior: PriorName | Normal = "uniform"


class EffectRange(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Value, bounds and prior of one of an effect's parameters; bounds None: the effect's own."""

    value: float
    low: float | None = None
    high: float | None = None
    prior: PriorName | Normal = "uniform"


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[model]."""

    name: str
    law: str = DEFAULT_LAW
    kappa: KappaConvention = "paper"


class Provenance(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[provenance]: what the effects were found in, by what, and when."""

    data: dict[str, str] = field(default_factory=dict)  # file -> sha256
    versions: dict[str, str] = field(default_factory=dict)  # program, plugin -> version
    verdict: str = ""
    date: str = ""  # ISO 8601
    based_on: str = ""  # hash of the model that the effects were added to


class Model(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole MODEL.toml. `effects`: name -> parameter -> value and range."""

    model: Header
    parameters: dict[str, Range] = field(default_factory=dict)
    effects: dict[str, dict[str, EffectRange]] = field(default_factory=dict)
    provenance: Provenance = field(default_factory=Provenance)

    @property
    def law(self) -> Law:
        """The constitutive law."""
        return get_law(self.model.law)

    @property
    def values(self) -> dict[str, dict[str, float]]:
        """Effect -> parameter -> value, defaults filled in."""
        given = {
            name: {parameter: at.value for parameter, at in ranges.items()}
            for name, ranges in self.effects.items()
        }
        return checked(given)

    def bounds(self, name: str) -> tuple[float, float]:
        """Return the bounds of one of the law's parameters, or of `EFFECT.PARAMETER`.

        Raises:
            InputError: the model has no such parameter.
        """
        effect, _, parameter = name.rpartition(".")
        if name in self.law.names:
            own = self.parameters.get(name)
            at = self.law.parameter(name)
            return (at.low, at.high) if own is None else (own.low, own.high)
        if parameter in self.effects.get(effect, {}):
            said = self.effects[effect][parameter]
            declared = {p.name: p for p in get_effect(effect).parameters}[parameter]
            low = declared.low if said.low is None else said.low
            return low, declared.high if said.high is None else said.high
        raise InputError(f"model {self.model.name!r} has no parameter {name}")

    @property
    def space(self) -> Space:
        """Where a fit looks for the law's parameters: where the law says, or within own bounds."""
        space, low, high = self.law.space, list(self.law.space.low), list(self.law.space.high)
        transforms = list(space.transforms)
        for i, name in enumerate(space.names):
            own = self.parameters.get(name)
            if own is None:
                continue
            if space.transforms[i] == "ratio" and own.prior != "uniform":
                reach = space.bounds[0][i], space.bounds[1][i]
                if own.low <= reach[0] and own.high >= reach[1]:
                    continue  # what the ratio's ends allow is all inside
            low[i], high[i] = own.low, own.high
            even = own.prior == "uniform" or own.low <= 0 or space.transforms[i] == "linear"
            transforms[i] = "linear" if even else "log"
        return replace(space, low=tuple(low), high=tuple(high), transforms=tuple(transforms))

    @property
    def needs_history(self) -> bool:
        """Whether an effect depends on time or cycle."""
        from skinlab.mechanics.effects.history import depends_on_history

        return any(depends_on_history(get_effect(name)) for name in self.effects)

    def normal_priors(self, space: Space) -> list[tuple[int, float, float]]:
        """Return what is known of a space's parameters beforehand: number, mean and sd of each."""
        priors = [(i, self.prior(name)) for i, name in enumerate(space.names)]
        return [(i, known.mean, known.sd) for i, known in priors if isinstance(known, Normal)]

    def prior(self, name: str) -> PriorName | Normal | None:
        """Return what the model says is known of a parameter beforehand; None: nothing."""
        effect, _, parameter = name.rpartition(".")
        if name in self.law.names:
            own = self.parameters.get(name)
            return None if own is None else own.prior
        return self.effects[effect][parameter].prior

    def learned_from(self, hashes: Collection[str]) -> bool:
        """Return whether effects' priors were learned from data with one of these hashes.

        The hashes are of curves. Models of earlier versions hold their campaign.toml's as well,
        which says nothing: it stays the same when its curves are others.
        """
        priors = [at.prior for each in self.effects.values() for at in each.values()]
        known = any(isinstance(prior, Normal) for prior in priors)
        return known and not set(self.provenance.data.values()).isdisjoint(hashes)

    def without_learned(self) -> Model:
        """Return it as it is for the data that its effects were learned from: these count once."""
        effects = {
            name: {p: msgspec.structs.replace(at, prior="uniform") for p, at in each.items()}
            for name, each in self.effects.items()
        }
        return msgspec.structs.replace(self, effects=effects)

    @property
    def differs(self) -> str:
        """In words: which law or effect may be another one than at adoption; empty: none."""
        return what_differs(self.model.law, self.effects, self.provenance.versions)

    @property
    def hash(self) -> str:
        """`sha256:…` of what the model says, whatever its file looks like and its provenance."""
        said = msgspec.to_builtins(self)
        del said["provenance"]
        text = json.dumps(said, sort_keys=True, separators=(",", ":"))
        return "sha256:" + hashlib.sha256(text.encode()).hexdigest()

    def to_toml(self) -> str:
        """Return the file's text."""
        return toml_text(msgspec.to_builtins(self))


BASE = Model(Header("base"))


def model_of_law(name: str) -> Model:
    """Return a law as it is: all of its parameters free, no effects."""
    return BASE if name == BASE.model.law else Model(Header(name, name))


def read_model(path: str | Path) -> Model:
    """Return the model of this file; warn where a plugin of it is another one than at adoption.

    Raises:
        InputError: it cannot be read, or something in it is not known, missing or out of range; the
            message names the file and the field.
    """
    with named_in_errors(path):
        raw = read_whole(path)
    model = decode_model(raw, str(path))
    if differs := model.differs:
        warn(f"{path}: {differs}")
    return model


def decode_model(raw: bytes | str, path: str) -> Model:
    """Return the model that a file's text says; `path` is what to call it in messages.

    Raises:
        InputError: something in it is not known, missing or out of range; names the field.
    """
    with named_in_errors(path):
        return model_of(read_toml(raw))


def model_of(said: Mapping[str, Any]) -> Model:
    """Return the model that decoded tables say.

    Raises:
        ValueError: something in them is not known, missing or out of range; the field comes first.
    """
    _check_entries(said)
    model = decode(said, Model)
    check_installed(model.model.law, model.effects, model.provenance.versions)
    try:
        check_model(model)
    except InputError as error:
        differs = model.differs  # another package's effect has other parameters, too
        raise InputError(f"{error}{f'; {differs}' if differs else ''}") from None
    return model


def _check_entries(said: Mapping[str, Any]) -> None:
    """Decode the tables with names of their own one by one: errors then say which."""
    for name, entry in _items(said.get("parameters")):
        check_entry(f"parameters.{name}", entry, Range)
    for name, entries in _items(said.get("effects")):
        for parameter, entry in _items(entries):
            check_entry(f"effects.{name}.{parameter}", entry, EffectRange)


def _items(table: Any) -> list[tuple[str, Any]]:
    return list(table.items()) if isinstance(table, dict) else []


def check_entry(where: str, entry: Any, kind: type[T]) -> T:
    """Return the entry of a table with names of its own, decoded.

    Raises:
        InputError: it is not of that kind; names the field.
    """
    try:
        return decode(entry, kind)
    except ValueError as error:
        message = str(error)
        inner = re.match(r"([a-z]+): ", message)  # a field of it
        raise InputError(f"{where}{'.' if inner else ': '}{message}") from None


def check_model(model: Model) -> None:
    """Refuse a model that says what cannot be.

    Raises:
        InputError: names the field, and what was expected.
    """
    if not model.model.name.strip():
        raise InputError("model.name is empty; expected a name")
    try:
        law = model.law
    except InputError as error:
        raise InputError(f"model.law: {error}") from None
    for name, own in model.parameters.items():
        try:
            declared = law.parameter(name)
        except InputError as error:
            raise InputError(f"parameters.{error}") from None
        _check_range(f"parameters.{name}", own, own.low, own.high, (declared.low, declared.high))
    for name, values in model.values.items():
        widest = {p.name: (p.low, p.high) for p in get_effect(name).parameters}
        for parameter, at in model.effects[name].items():
            where = f"effects.{name}.{parameter}"
            low, high = model.bounds(f"{name}.{parameter}")
            _check_range(where, at, low, high, widest[parameter])
            if not low <= values[parameter] <= high:
                raise InputError(f"{where}.value is {at.value:g}: expected {low:g} to {high:g}")
    if model.effects:
        _check_together(model)


def _check_together(model: Model) -> None:
    """Refuse values that no skin has together: of a usual one, under the usual opening.

    Raises:
        InputError: names the effect.
    """
    from skinlab.mechanics.effects.model import problem_of
    from skinlab.mechanics.fem.skin import Skin
    from skinlab.mechanics.fem.suction import Geometry

    typical = tuple(p.typical for p in model.law.parameters)
    with contextlib.suppress(BrokenPluginError):  # the curve that it breaks down at tells of it
        problem_of(Skin(typical, law=model.model.law), model.values, Geometry(6.0, 1.0))


def _check_range(
    where: str, at: Range | EffectRange, low: float, high: float, outer: tuple[float, float]
) -> None:
    for key, value in (("low", low), ("high", high)):
        if not (math.isfinite(value) and outer[0] <= value <= outer[1]):
            raise InputError(f"{where}.{key} is {value:g}: expected {outer[0]:g} to {outer[1]:g}")
    if not low < high:
        raise InputError(f"{where}: low {low:g} is not below high {high:g}")
    if isinstance(at.prior, Normal):
        if not (math.isfinite(at.prior.mean) and 0 < at.prior.sd < math.inf):
            raise InputError(f"{where}.prior: expected a finite mean and a positive sd")
        if not low <= at.prior.mean <= high:
            raise InputError(
                f"{where}.prior.mean is {at.prior.mean:g}: expected {low:g} to {high:g}"
            )
    elif at.prior == "log-uniform" and low <= 0:
        raise InputError(f"{where}.prior: log-uniform needs a positive low, got {low:g}")
