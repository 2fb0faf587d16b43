"""The mechanical problem of a skin under the probe, with all that can differ from the plain one.

One layer of a law with a held rim is the plain problem. Besides, there may be layers of
other stiffness in it and under it, a stretch in its plane before the tape was put on, a rim that
slips, energy that the law lacks, tissue that is softer than at first, stress that relaxes, and a
dome that was there before the suction. What each of these means physically is told where it is
used: `skinlab/mechanics/effects/`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinlab.errors import InputError
from skinlab.mechanics.fem.assembly import Assembly
from skinlab.mechanics.fem.roots import brentq
from skinlab.mechanics.fem.suction import MESH_OF_RECORD, RIM_MM, Discretisation, Geometry
from skinlab.mechanics.materials import DEFAULT_LAW, Energy, Law, Potential, get_law
from skinlab.mechanics.materials.base import First, HasPotential
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.mechanics.materials.extended_neo_hookean import LAW as LAYERS_LAW
from skinlab.mechanics.materials.extended_neo_hookean import neo_hookean

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Skin:
    """A law, and values of its parameters in their order.

    Raises:
        InputError: there is no such law, or a value is out of its bounds.
    """

    values: tuple[float, ...]
    kappa: KappaConvention = "paper"
    law: str = DEFAULT_LAW

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        law = get_law(self.law)
        if len(self.values) != len(law.names):
            raise InputError(f"law {self.law!r} has the parameters {', '.join(law.names)}")
        for parameter, value in zip(law.parameters, self.values, strict=True):
            parameter.check(value)

    @property
    def named(self) -> dict[str, float]:
        """Values by name."""
        return get_law(self.law).named(self.values)

    @property
    def coefficients(self) -> dict[str, float]:
        """What the law's potential needs."""
        return get_law(self.law).coefficients(self.named, self.kappa)

    @cached_property
    def dilatation_ratio(self) -> float:
        """κ/(μ/2)."""
        return get_law(self.law).dilatation_ratio(self.named, self.kappa)


@dataclass(frozen=True)
class Layer:
    """Elastic, neo-Hookean tissue."""

    thickness_mm: float
    half_shear_mpa: float
    kappa_mpa: float


@dataclass(frozen=True)
class Term:
    """Energy that is added to the law's, with values of its own parameters (name, value)."""

    law: Energy
    parameters: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Prony:
    """A share g of the isochoric stress that relaxes with the time τ."""

    g: float
    tau_s: float


@dataclass(frozen=True)
class SkinProblem:
    """What is to be solved. Frozen and hashable: a key of caches.

    Raises:
        InputError: a value is out of its physical range.
    """

    geometry: Geometry  # the true thickness, surface layers included
    skin: Skin
    terms: tuple[Term, ...] = ()
    above: tuple[Layer, ...] = ()  # inside the thickness, from the top down
    below: tuple[Layer, ...] = ()  # under the skin; the lowest one's base is held
    stretch: float = 1.0  # in the plane, of the skin (not of what is below), before the tape
    slip_mm: float = 0.0  # the tape holds from R + slip on; the suction acts on r < R
    stiffness: float = 1.0  # factor of the skin's own energy (not of other layers')
    prony: tuple[Prony, ...] = ()  # of the skin's own law (not of other layers')
    preload_mbar: float = 0.0  # what has domed the skin, long before

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        # At once first: searches make thousands of problems.
        inf = math.inf
        if not (
            0 < self.stretch < inf and 0 <= self.slip_mm < inf
            and 0 < self.stiffness < inf and 0 <= self.preload_mbar < inf
        ):  # fmt: skip
            self._refuse()
        if self.above:
            inside = sum(layer.thickness_mm for layer in self.above)
            if inside >= self.geometry.thickness_mm:
                raise InputError(
                    f"layers of {inside:g} mm inside a skin of {self.geometry.thickness_mm:g} mm: "
                    "expected less than the skin"
                )
        if self.slip_mm:
            room = self.geometry.outer_radius_mm - self.geometry.radius_mm
            if self.slip_mm >= 0.5 * room:
                raise InputError(f"slip_mm {self.slip_mm:g}: expected less than {0.5 * room:g} mm")
        if self.prony and sum(term.g for term in self.prony) >= 1:
            raise InputError("the shares g of the stress that relaxes: expected a sum below 1")

    def _refuse(self) -> None:
        for name, least in (
            ("stretch", "positive"),
            ("slip_mm", "zero or more"),
            ("stiffness", "positive"),
            ("preload_mbar", "zero or more"),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0 and (value > 0 or least != "positive")):
                raise InputError(f"{name} {value:g}: expected a finite number, {least}")

    @property
    def elastic(self) -> SkinProblem:
        """The same skin without a memory: what it is in an instant."""
        return replace(self, prony=())


@dataclass(frozen=True, eq=False)
class Body:
    """The energy of a skin: its law and what is added to that, and of other layers beside it.

    Its `potential` takes `{"own": (…), "isochoric": factor, "layers": {…}}`: parameters of the law
    and of the terms, what multiplies their isochoric part, and those of the other layers.
    """

    law: Law
    terms: tuple[Energy, ...]
    own: NDArray[np.bool_] | None  # (m,) elements of the skin's own tissue; None: all

    def potential(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        """Return energy and derivatives at invariants (m, q)."""
        own = self.own
        if own is None:
            return self._skin(i1, i2, j, parameters)
        skin = self._skin(i1[own], i2[own], j[own], parameters)
        other = LAYERS_LAW.potential(i1[~own], i2[~own], j[~own], parameters["layers"])
        together = []
        for field in fields(Potential):
            values = np.empty_like(j)
            values[own], values[~own] = getattr(skin, field.name), getattr(other, field.name)
            together.append(values)
        return Potential(*together)

    def first_derivatives(
        self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]
    ) -> First:
        """Return first derivatives at invariants (m, q)."""
        own = self.own
        if own is None:
            return self._skin_first(i1, i2, j, parameters)
        skin = self._skin_first(i1[own], i2[own], j[own], parameters)
        other = LAYERS_LAW.first_derivatives(i1[~own], i2[~own], j[~own], parameters["layers"])
        together = np.empty((3, *j.shape))
        for values, mine, theirs in zip(together, skin, other, strict=True):
            values[own], values[~own] = mine, theirs
        return together[0], together[1], together[2]

    def form(self, parameters: Mapping[str, Any]) -> Array | None:
        """See `HasPotential`; found once where parameters have a place for it, `"form"`."""
        if "form" in parameters:
            known: Array | None = parameters["form"]
            return known
        each = zip((self.law, *self.terms), parameters["own"], strict=True)
        skin = [energy.form(own, parameters["isochoric"]) for energy, own in each]
        if any(part is None for part in skin):
            return None
        total = np.asarray(sum(part for part in skin if part is not None))
        if self.own is None:
            return total
        other = LAYERS_LAW.form(parameters["layers"])
        if other is None:
            return None
        whole = np.empty((len(self.own), total.shape[1]))
        whole[self.own], whole[~self.own] = total, other
        return whole

    def rises(
        self, ends: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]], *, at_once: bool
    ) -> list[list[tuple[float, Mapping[str, Any]]]]:
        """Return sums of a factor times an energy of parameters: W(up) − W(down) of each pair.

        With `at_once` those of a linear energy are one sum, its parameters arrays (k, 1, 1), and
        those with a form one of k forms.
        """
        forms = [(up["form"], down["form"]) for up, down in ends]
        if at_once and forms and all(form is not None for pair in forms for form in pair):
            return [[(1.0, {"form": np.stack([up - down for up, down in forms])})]]
        each = [self._rise(up, down) for up, down in ends]
        factors = {r[0][1]["isochoric"] for r in each}
        linear = all(len(r) == 1 for r in each)
        if not (at_once and linear and len(factors) == 1 and self.own is None):
            return each
        rows = [r[0][1]["own"] for r in each]
        own = tuple(
            {name: np.array([one[name] for one in energy])[:, None, None] for name in energy[0]}
            for energy in zip(*rows, strict=True)
        )
        return [[(1.0, {**ends[0][0], "own": own})]]

    def _rise(
        self, up: Mapping[str, Any], down: Mapping[str, Any]
    ) -> list[tuple[float, Mapping[str, Any]]]:
        linear = self.law.linear and all(term.linear for term in self.terms)
        if not linear or up["isochoric"] != down["isochoric"]:
            return [(1.0, up), (-1.0, down)]

        def less(one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
            return {name: one[name] - other[name] for name in one}

        own = tuple(map(less, up["own"], down["own"]))
        layers = less(up["layers"], down["layers"])
        return [(1.0, {**up, "own": own, "layers": layers})]

    def isochoric_first(
        self, i1: Array, i2: Array, j: Array, own: Sequence[Mapping[str, float]]
    ) -> First:
        """Return first derivatives of the isochoric energy of the skin's own tissue."""
        total = self.law.checked_first(i1, i2, j, own[0])
        for term, parameters in zip(self.terms, own[1:], strict=True):
            x, y, z = term.checked_first(i1, i2, j, parameters)
            total = total[0] + x, total[1] + y, total[2] + z
        return total

    def _skin_first(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> First:
        own, factor = parameters["own"], parameters["isochoric"]
        total = self.law.first_derivatives(i1, i2, j, own[0], factor)
        for term, each in zip(self.terms, own[1:], strict=True):
            x, y, z = term.first_derivatives(i1, i2, j, each, factor)
            total = total[0] + x, total[1] + y, total[2] + z
        return total

    def _skin(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        own, factor = parameters["own"], parameters["isochoric"]
        found = self.law.potential(i1, i2, j, own[0], factor)
        for term, each in zip(self.terms, own[1:], strict=True):
            found = found + term.potential(i1, i2, j, each, factor)
        return found


@dataclass(frozen=True, eq=False)
class Prepared:
    """A problem on its mesh: what Newton's method is given."""

    assembly: Assembly
    apex: int  # the unknown that is the apex deflection
    body: Body
    _own: tuple[Mapping[str, float], ...]
    _layers: Mapping[str, Array]

    def parameters(self, isochoric: float = 1.0) -> dict[str, Any]:
        """Return what the body's energy needs, the skin's isochoric energy times a factor."""
        whole = None
        if self._forms is not None:
            rest, own = self._forms
            whole = rest + isochoric * own
        return {**self._parts(isochoric), "form": whole}

    @cached_property
    def _forms(self) -> tuple[Array, Array] | None:
        """The form without the skin's isochoric energy, and what that adds to it."""
        rest, whole = (self.body.form(self._parts(isochoric)) for isochoric in (0.0, 1.0))
        return None if rest is None or whole is None else (rest, whole - rest)

    def _parts(self, isochoric: float) -> dict[str, Any]:
        return {"own": self._own, "isochoric": float(isochoric), "layers": self._layers}

    def isochoric_first(self, i1: Array, i2: Array, j: Array) -> First:
        """Return first derivatives of the isochoric energy (they are the skin's alone)."""
        return self.body.isochoric_first(i1, i2, j, self._own)


def prepare(
    problem: SkinProblem,
    discretisation: Discretisation = MESH_OF_RECORD,
    edge_mm: float | None = None,
) -> Prepared:
    """Return the problem on its mesh, or on that with elements of `edge_mm` at the tape's edge."""
    assembly, apex, body = _assembly(
        problem.geometry,
        discretisation,
        problem.skin.law,
        tuple(term.law for term in problem.terms),
        problem.slip_mm,
        tuple(layer.thickness_mm for layer in problem.above),
        tuple(layer.thickness_mm for layer in problem.below),
        edge_of(problem, discretisation) if edge_mm is None else edge_mm,
    )
    layer, own_layer = assembly.mesh.layer, len(problem.above)
    own = (problem.skin.coefficients, *(dict(term.parameters) for term in problem.terms))
    body.law.check_small_strains(own[0])
    others = [
        neo_hookean(other.half_shear_mpa, other.kappa_mpa)
        for other in (*problem.above, *problem.below)
    ]
    layers: dict[str, Array] = {}
    if body.own is not None:
        place = layer[~body.own]
        place = np.where(place > own_layer, place - 1, place)  # the skin is none of the others
        layers = {name: np.array([of[name] for of in others])[place][:, None] for name in others[0]}
    if problem.stretch != 1.0 or problem.stiffness != 1.0:
        relaxed = 1.0 - sum(term.g for term in problem.prony)
        through, plane = np.ones(len(others) + 1), np.ones(len(others) + 1)
        plane[: own_layer + 1] = problem.stretch
        for k in range(own_layer):
            through[k] = through_thickness(problem.stretch, LAYERS_LAW, others[k])
        alone = replace(body, own=None)
        through[own_layer] = through_thickness(
            problem.stretch, alone, {"own": own, "isochoric": relaxed}
        )
        mine = np.ones(len(layer)) if body.own is None else body.own.astype(float)
        factor = 1.0 + (problem.stiffness - 1.0) * mine
        assembly = assembly.prestrained(np.stack([plane[layer], through[layer]]), factor)
    return Prepared(assembly, apex, body, own, layers)


def edge_of(problem: SkinProblem, discretisation: Discretisation) -> float:
    """Return the size in mm of the elements at the tape's edge; see `RIM_MM`.

    A layer that carries more than the skin does not crease, and needs to be resolved.
    """
    if not problem.above:
        return discretisation.edge_mm(problem.geometry)
    skin = problem.skin
    own = get_law(skin.law).checked_modulus(skin.named) * problem.geometry.thickness_mm
    carried = sum(layer.thickness_mm * layer.half_shear_mpa for layer in problem.above)
    rim_mm = RIM_MM / (1.0 + (carried / own) ** 2)
    above_mm = tuple(layer.thickness_mm for layer in problem.above)
    return float(discretisation.edge_mm(problem.geometry, above_mm, rim_mm))


def through_thickness(stretch: float, energy: HasPotential, parameters: Mapping[str, Any]) -> float:
    """Return the stretch through the thickness that leaves no stress there, under one in the plane.

    Raises:
        InputError: there is none between a fifth and five times.
    """
    if stretch == 1.0:
        return 1.0

    plane = stretch**2
    # A sum of `TERMS` is of our own laws: numbers go through these as arrays do, and faster.
    number: Any = float if energy.form(parameters) is not None else np.atleast_1d

    def stress(through: float) -> float:
        square = through**2
        i1, i2 = number(2 * plane + square), number(plane * (2 * square + plane))
        by_i1, by_i2, by_j = energy.first_derivatives(i1, i2, number(plane * through), parameters)
        return float(np.ravel(2 * through * (by_i1 + 2 * plane * by_i2) + plane * by_j)[0])

    try:
        return brentq(stress, 0.2, 5.0, xtol=1e-15, rtol=1e-14)
    except ValueError:
        raise InputError(f"stretch {stretch:g}: no equilibrium through the thickness") from None


@lru_cache(maxsize=32)
def _assembly(
    geometry: Geometry,
    discretisation: Discretisation,
    law_name: str,
    terms: tuple[Energy, ...],
    slip_mm: float,
    above_mm: tuple[float, ...],
    below_mm: tuple[float, ...],
    edge_mm: float,
) -> tuple[Assembly, int, Body]:
    mesh = discretisation.mesh(geometry, slip_mm, above_mm, below_mm, edge_mm)
    fixed = mesh.held
    if below_mm:
        fixed = np.union1d(fixed, [2 * mesh.bottom, 2 * mesh.bottom + 1])
    own = mesh.layer == len(above_mm) if above_mm or below_mm else None
    body = Body(get_law(law_name), terms, own)
    assembly = Assembly(mesh, discretisation.element, body, fixed)
    return assembly, int(assembly.equation[2 * mesh.apex + 1]), body
