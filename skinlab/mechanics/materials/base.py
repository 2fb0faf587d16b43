"""What a constitutive law is: its parameters, and the energy that the finite elements ask for.

A law of skin declares its own parameters; nothing outside of its file names them. The first is its
stiffness scale: the energy is that many MPa times a function of the others, where those in MPa
count by their ratio to it. So the dome depends on p/scale, on the ratios and on what has no unit.
Where a law has Poisson's ratio, its compressibility is κ = (μ/2) · ratio(ν), see
`compressibility.py`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from skinlab.errors import InputError
from skinlab.mechanics.materials.checked import check_modulus, told
from skinlab.mechanics.materials.compressibility import (
    KappaConvention,
    kappa_ratio,
    nu_consistent,
)
from skinlab.mechanics.materials.energy import (
    KAPPA,
    Array,
    Energy,
    First,
    HasPotential,
    Potential,
    potential_of_j1,
)
from skinlab.parameters import Parameter, Search, Space, check_declared
from skinlab.plugins import needs, texts

__all__ = [
    "DILATATION_SCALE", "KAPPA", "NU_CONSISTENT", "Array", "Energy", "First", "HasPotential", "Law",
    "Potential", "adopt_law", "check_law", "potential_of_j1", "search_of",
]  # fmt: skip

NU_CONSISTENT = "nu_consistent"  # the ν of linear elasticity
DILATATION_SCALE = "kappa_over_half_shear"  # the name of a table's axis along κ/(μ/2)


class Law(Energy):
    """A law of skin: an energy whose parameters users name, bound and identify."""

    formula: ClassVar[str]
    meaning: ClassVar[str] = ""  # of the parameters, in a clause for reports
    parameters: ClassVar[tuple[Parameter, ...]]
    poisson: ClassVar[str | None] = None  # the parameter that is Poisson's ratio
    dilatation_scale: ClassVar[str] = DILATATION_SCALE
    derived_names: ClassVar[tuple[str, ...]] = (NU_CONSISTENT, KAPPA)

    @abstractmethod
    def half_shear_modulus(self, values: Mapping[str, Any]) -> Any:
        """Return μ/2 at rest, MPa, from the parameters by name."""

    # ---- the same for all ----

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""
        return tuple(p.name for p in self.parameters)

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """What the potential needs: the parameters, κ in place of Poisson's ratio."""
        if self.poisson is None:
            return self.names
        return (*(name for name in self.names if name != self.poisson), KAPPA)

    @property
    def scale(self) -> str:
        """The parameter that the energy is proportional to."""
        return self.names[0]

    def parameter(self, name: str) -> Parameter:
        """Return the parameter of that name.

        Raises:
            InputError: there is none; lists those that there are.
        """
        for one in self.parameters:
            if one.name == name:
                return one
        raise InputError(f"{name} is not known; expected one of: {', '.join(self.names)}")

    def named(self, values: Sequence[float]) -> dict[str, float]:
        """Return values in the parameters' order by name."""
        return {name: float(v) for name, v in zip(self.names, values, strict=True)}

    def ordered(self, values: Mapping[str, float]) -> tuple[float, ...]:
        """Return values by name in the parameters' order, checked.

        Raises:
            InputError: one is not known, is missing or out of bounds.
        """
        for name in values:
            self.parameter(name)
        for one in self.parameters:
            if one.name not in values:
                raise InputError(f"{one.name} is missing; {self.name} has {', '.join(self.names)}")
            one.check(values[one.name])
        return tuple(float(values[name]) for name in self.names)

    def coefficients(
        self, values: Mapping[str, Any], convention: KappaConvention
    ) -> dict[str, Any]:
        """Return what the potential needs, from the parameters by name (floats or arrays).

        Raises:
            InputError: Poisson's ratio lies outside [0, 0.5).
        """
        if self.poisson is None:
            return dict(values)
        ratio = kappa_ratio(values[self.poisson], convention)
        return self.with_ratio({k: v for k, v in values.items() if k != self.poisson}, ratio)

    def with_ratio(self, values: Mapping[str, Any], ratio: Any) -> dict[str, Any]:
        """Return what the potential needs, given κ/(μ/2) in place of Poisson's ratio."""
        return {**values, KAPPA: self.checked_modulus(values) * ratio}

    def checked_modulus(self, values: Mapping[str, Any]) -> Any:
        """Return μ/2 at rest, MPa, from the parameters by name.

        Raises:
            BrokenPluginError: an installed law does not say it.
        """
        if self.plugin is None:
            return self.half_shear_modulus(values)
        with told(self.plugin):
            found = self.half_shear_modulus(values)
            check_modulus(found, values)
        return found

    def dilatation_ratio(self, values: Mapping[str, float], convention: KappaConvention) -> float:
        """Return κ/(μ/2) of the parameters by name.

        Without Poisson's ratio κ is what resists a change of volume at rest, however the law says
        it.
        """
        if self.poisson is not None:
            return float(kappa_ratio(values[self.poisson], convention))
        kappa = values[KAPPA] if KAPPA in values else self.bulk_modulus(values)
        return float(kappa / self.checked_modulus(values))

    def bulk_modulus(self, values: Mapping[str, Any]) -> float:
        """Return d²W/dJ² at rest, MPa, of what the potential takes: equal stretches in all ways."""
        three, one = np.array([3.0]), np.array([1.0])
        p = self.potential(three, three, one, values)
        # Along J, I1 = 3 J^(2/3) and I2 = 3 J^(4/3): slopes 2 and 4, curvatures −2/3 and 4/3
        second = p.d_j_j + 4.0 * p.d_i1_i1 + 16.0 * p.d_i2_i2 + 16.0 * p.d_i1_i2
        second = second + 4.0 * p.d_i1_j + 8.0 * p.d_i2_j
        return float((second - 2.0 / 3.0 * p.d_i1 + 4.0 / 3.0 * p.d_i2)[0])

    def derived(self, values: Mapping[str, float], convention: KappaConvention) -> dict[str, float]:
        """Return what a report shows besides: the ν of linear elasticity, and κ."""
        ratio = self.dilatation_ratio(values, convention)
        kappa = ratio * float(self.checked_modulus(values))
        return dict(zip(self.derived_names, (float(nu_consistent(ratio)), kappa), strict=True))

    @property
    def search(self) -> tuple[Search, ...]:
        """Where fits look for each parameter."""
        return tuple(search_of(p) for p in self.parameters)

    @cached_property
    def space(self) -> Space:
        """Where fits look, all parameters together."""
        each = self.search
        return Space(
            self.names,
            tuple(s.low for s in each),
            tuple(s.high for s in each),
            tuple(s.transform for s in each),
        )

    @cached_property
    def published_space(self) -> Space | None:
        """The box in which the source's own algorithms search; None where it has none."""
        nodes = [p.published for p in self.parameters]
        if not all(nodes):
            return None
        return Space.box(self.names, [n[0] for n in nodes], [n[-1] for n in nodes])


def search_of(parameter: Parameter) -> Search:
    """Return where fits look for a parameter: all of its bounds, where it does not say."""
    if parameter.search is not None:
        return parameter.search
    log = parameter.spacing == "log"
    return Search(parameter.low, parameter.high, "log" if log else "linear")


def adopt_law(law: Law, who: str) -> None:
    """Note where an installed law comes from: what it says is checked, and errors name it."""
    law.plugin = who


_NOT_MPA = frozenset({"Pa", "hPa", "kPa", "GPa", "bar", "mbar", "mmHg", "psi", "N/m²", "N/mm²"})


def check_law(one: object) -> None:
    """Refuse what is no law, or one whose declaration cannot work.

    Raises:
        TypeError, ValueError: says what is wrong with it.
    """
    if not isinstance(one, Law):
        kind = one.__name__ if isinstance(one, type) else type(one).__name__
        made = "the class itself, " if isinstance(one, type) else "a "
        raise TypeError(
            f"it is {made}{kind}; expected an object of a subclass of "
            "skinlab.mechanics.materials.base.Law"
        )
    needs(one, "formula", "source")
    texts(one, "formula", "meaning", "source", "dilatation_scale")
    declared = getattr(one, "parameters", ())
    if not declared or not all(isinstance(p, Parameter) for p in declared):
        raise TypeError(
            "its parameters are not skinlab.parameters.Parameter; expected at least one, of which "
            "the first is the stiffness that the energy is proportional to"
        )
    check_declared(declared)
    derived: object = one.derived_names
    if not isinstance(derived, tuple) or [type(name) for name in derived] != [str, str]:
        raise ValueError(f"its derived_names are {derived!r}; expected two: of ν and κ")
    _check_parameters(one)


def _check_parameters(law: Law) -> None:
    for p in law.parameters:
        if p.unit in _NOT_MPA:
            raise ValueError(
                f"law {law.name!r}: {p.name} is in {p.unit}; expected MPa, as all stiffness is"
            )
    if law.poisson not in (None, *law.names):
        raise ValueError(
            f"law {law.name!r}: poisson is {law.poisson!r}; expected one of: "
            f"{', '.join(law.names)}, or None"
        )
    if len({name.lower() for name in law.names}) < len(law.names):
        raise ValueError(
            f"law {law.name!r}: two of its parameters differ in capitals alone, and have one "
            f"option: {', '.join(law.names)}"
        )
    unit = law.parameter(law.scale).unit
    if unit != "MPa":
        raise ValueError(
            f"law {law.name!r}: its first parameter, {law.scale}, is in {unit or 'no unit'}; "
            "expected MPa, because the energy is proportional to it"
        )
    for one in law.parameters:
        search = search_of(one)
        if search.transform == "log" and search.low <= 0.0:
            raise ValueError(
                f"law {law.name!r}: {one.name} is searched from {search.low:g} in its "
                "logarithm; expected a low, or a search, above 0"
            )
        if one.name == law.poisson and not (one.low >= 0.0 and one.high < 0.5):
            raise ValueError(
                f"law {law.name!r}: {one.name}, Poisson's ratio, is {one.low:g} to {one.high:g}; "
                "expected it in 0 to below 0.5"
            )
        if one.name == law.scale and search.transform != "log":
            raise ValueError(f"law {law.name!r}: the scale {one.name} is searched in its logarithm")
        if one.name not in (law.scale, law.poisson) and (
            (one.unit == unit) != (search.transform == "ratio")
        ):
            raise ValueError(
                f"law {law.name!r}: {one.name}: expected the transform ratio for what has the "
                f"scale's unit, {unit}, and for nothing else"
            )
