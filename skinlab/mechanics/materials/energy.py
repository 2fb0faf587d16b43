"""Energies and their derivatives, as the finite elements ask for them.

An installed law may answer anything: what it says goes through the `checked_` functions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from skinlab.mechanics.materials.checked import check_arrays, check_numbers, small_strains, told

Array = NDArray[np.float64]

KAPPA = "kappa_MPa"  # multiplies ½ (J − 1)², all that depends on J alone


# Energies of which the finite elements' compiled loops know the derivatives. J1 = J^(−2/3) I1 and
# J2 = J^(−4/3) I2.
TERMS = ("J1 − 3", "J2 − 3", "(J1 − 3)(J2 − 3)", "(J1 − 3)³", "½ (J − 1)²")  # the last: κ


@dataclass(frozen=True, slots=True)
class Potential:
    """Strain energy per reference volume and its derivatives by (I1, I2, J), in MPa.

    All arrays have the shape of the invariants that they were computed from. `I1` and `I2` are the
    first two invariants of C = FᵀF, `J` = det F; isotropy makes these three enough.
    """

    energy: Array
    d_i1: Array
    d_i2: Array
    d_j: Array
    d_i1_i1: Array
    d_i1_i2: Array
    d_i2_i2: Array
    d_i1_j: Array
    d_i2_j: Array
    d_j_j: Array

    def __add__(self, other: Potential) -> Potential:
        return Potential(*(getattr(self, f) + getattr(other, f) for f in self.__slots__))

    def named(self) -> list[tuple[str, Any]]:
        """Return the energy and its derivatives with their names."""
        return [(f, getattr(self, f)) for f in self.__slots__]

    def scaled(self, factor: Any) -> Potential:
        """Return the potential times a factor: a number, or an array that broadcasts."""
        return Potential(*(getattr(self, f) * factor for f in self.__slots__))


def potential_of_j1(
    i1: Array, j: Array, energy: Callable[[Array], tuple[Array, Array, Array]]
) -> Potential:
    """Return the potential of an energy that depends on J1 = I3^(−1/3) I1 alone.

    energy: gives W and its first and second derivative by J1, from J1 − 3.
    """
    a = j ** (-2.0 / 3.0)  # J1 = a I1
    value, first, second = energy(a * i1 - 3.0)
    a_j = -2.0 / 3.0 * a / j
    j1_j = a_j * i1
    j1_jj = -5.0 / 3.0 * j1_j / j
    nothing = 0.0 * i1
    return Potential(
        energy=value,
        d_i1=first * a,
        d_i2=nothing,
        d_j=first * j1_j,
        d_i1_i1=second * a * a,
        d_i1_i2=nothing,
        d_i2_i2=nothing,
        d_i1_j=second * a * j1_j + first * a_j,
        d_i2_j=nothing,
        d_j_j=second * j1_j * j1_j + first * j1_jj,
    )


First = tuple[Array, Array, Array]  # derivatives of an energy by I1, I2 and J
_FIRST = ("d_i1", "d_i2", "d_j")


class HasPotential(Protocol):
    """What the finite elements ask of an energy."""

    def potential(self, i1: Array, i2: Array, j: Array, parameters: Any) -> Potential:
        """Return energy and derivatives; the parameters are what this energy understands."""
        ...

    def first_derivatives(self, i1: Array, i2: Array, j: Array, parameters: Any) -> First:
        """Return ∂W/∂I1, ∂W/∂I2 and ∂W/∂J: all that forces need."""
        ...

    def form(self, parameters: Any) -> Array | None:
        """Return what multiplies TERMS (elements or 1, terms); None where W is no such sum."""
        ...


def _copies(
    i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]
) -> tuple[Array, Array, Array, dict[str, Any]]:
    """Return copies of what an installed law is given, which may change it in place."""
    return i1.copy(), i2.copy(), j.copy(), {n: copy(value) for n, value in parameters.items()}


class Energy(ABC):
    """An isotropic hyperelastic energy W = W_iso + κ/2 (J − 1)²; subclasses give W_iso.

    `potential` takes what is in `parameter_names`, in MPa or without unit.
    """

    name: ClassVar[str]
    source: ClassVar[str]
    linear: ClassVar[bool] = False  # W is a sum of parameters times functions of the invariants
    # Where W_iso is a sum of TERMS: the parameters by what they multiply
    multiplies: ClassVar[Mapping[str, str]] = {}
    parameter_names: tuple[str, ...]
    plugin: str | None = None  # how a sentence names an installed one, whose answers are checked

    def __init_subclass__(cls, **more: Any) -> None:
        """Who gives another W_iso says anew whether it is a sum."""
        super().__init_subclass__(**more)
        if "isochoric" in vars(cls) and "multiplies" not in vars(cls):
            cls.multiplies = {}

    @abstractmethod
    def isochoric(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        """Return W_iso and its derivatives. It may depend on its parameters in any way."""

    def isochoric_first(
        self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]
    ) -> First:
        """Return the first derivatives of W_iso. A law may have a shorter way to them."""
        found = self.checked_isochoric(i1, i2, j, parameters)
        return found.d_i1, found.d_i2, found.d_j

    def checked_isochoric(
        self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]
    ) -> Potential:
        """Return W_iso and its derivatives.

        Raises:
            BrokenPluginError: an installed law does not say them.
        """
        if self.plugin is None:
            return self.isochoric(i1, i2, j, parameters)
        with told(self.plugin):
            found: object = self.isochoric(*_copies(i1, i2, j, parameters))
            if not isinstance(found, Potential):
                raise TypeError(
                    f"isochoric returned a {type(found).__name__}; expected a Potential"
                )
            check_arrays(found.named(), (i1, i2, j), parameters)
        return found

    def checked_first(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> First:
        """Return the first derivatives of W_iso.

        Raises:
            BrokenPluginError: an installed law does not say them.
        """
        if self.plugin is None:
            return self.isochoric_first(i1, i2, j, parameters)
        with told(self.plugin):
            found: object = self.isochoric_first(*_copies(i1, i2, j, parameters))
            if not isinstance(found, tuple) or len(found) != 3:
                raise TypeError(
                    f"isochoric_first returned a {type(found).__name__}; expected three arrays"
                )
            check_arrays(zip(_FIRST, found, strict=True), (i1, i2, j), parameters)
        return found

    def check_small_strains(self, parameters: Mapping[str, Any]) -> None:
        """Check what an installed law says at rest and at small strains, of these parameters.

        Raises:
            BrokenPluginError: it is not finite there.
        """
        if self.plugin is None:
            return
        at = small_strains()
        found = self.checked_isochoric(*at, parameters)
        first = self.checked_first(*at, parameters)
        with told(self.plugin):
            check_numbers(found.named())
            check_numbers(zip(_FIRST, first, strict=True))

    def first_derivatives(
        self,
        i1: Array,
        i2: Array,
        j: Array,
        parameters: Mapping[str, Any],
        isochoric: Any = 1.0,
    ) -> First:
        """Return ∂W/∂I1, ∂W/∂I2 and ∂W/∂J, W_iso times a factor."""
        d_i1, d_i2, d_j = self.checked_first(i1, i2, j, parameters)
        if not (isinstance(isochoric, float) and isochoric == 1.0):
            d_i1, d_i2, d_j = isochoric * d_i1, isochoric * d_i2, isochoric * d_j
        kappa = parameters.get(KAPPA)
        return d_i1, d_i2, d_j if kappa is None else d_j + kappa * (j - 1.0)

    def potential(
        self,
        i1: Array,
        i2: Array,
        j: Array,
        parameters: Mapping[str, Any],
        isochoric: Any = 1.0,
    ) -> Potential:
        """Return energy and derivatives, W_iso times a factor.

        Parameters and the factor are floats, or arrays that broadcast against the invariants.
        """
        iso = self.checked_isochoric(i1, i2, j, parameters)
        if not (isinstance(isochoric, float) and isochoric == 1.0):
            iso = iso.scaled(isochoric)
        kappa = parameters.get(KAPPA)
        if kappa is None:
            return iso
        change = j - 1.0
        return Potential(
            iso.energy + 0.5 * kappa * change**2, iso.d_i1, iso.d_i2, iso.d_j + kappa * change,
            iso.d_i1_i1, iso.d_i1_i2, iso.d_i2_i2, iso.d_i1_j, iso.d_i2_j, iso.d_j_j + kappa,
        )  # fmt: skip

    def form(self, parameters: Mapping[str, Any], isochoric: float = 1.0) -> Array | None:
        """See `HasPotential`; W_iso times a factor. What is installed is asked, and checked."""
        if not self.multiplies or self.plugin is not None:
            return None
        parts = [(TERMS.index(t), isochoric * parameters[n]) for n, t in self.multiplies.items()]
        parts.append((len(TERMS) - 1, parameters.get(KAPPA, 0.0)))
        found = np.zeros((max(np.size(value) for _, value in parts), len(TERMS)))
        for term, value in parts:
            found[:, term] = np.ravel(value)
        return found
