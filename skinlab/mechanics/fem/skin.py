"""The mechanical problem of a skin under the probe, with all that can differ from the plain one.

One layer of the paper's law with a held rim is the plain problem. Besides, there may be layers of
other stiffness in it and under it, a stretch in its plane before the tape was put on, a rim that
slips, energy that the law lacks, tissue that is softer than at first, stress that relaxes, and a
dome that was there before the suction. What each of these means physically is told where it is
used: `skinlab/mechanics/effects/`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from skinlab.errors import InputError
from skinlab.mechanics.fem.assembly import Assembly, stress_and_tangent
from skinlab.mechanics.fem.suction import MESH_OF_RECORD, Discretisation, Geometry
from skinlab.mechanics.materials import Law, get_law
from skinlab.mechanics.materials.compressibility import KappaConvention, kappa_ratio
from skinlab.mechanics.materials.total import Total

Array = NDArray[np.float64]

KAPPA = "kappa_MPa"  # all that depends on J alone, in every law: the rest is the isochoric part


@dataclass(frozen=True)
class Layer:
    """Elastic, neo-Hookean tissue: the paper's law with X2 = 0."""

    thickness_mm: float
    X1_MPa: float
    kappa_MPa: float


@dataclass(frozen=True)
class Term:
    """Energy that is added to the law's: a Law with values of its own parameters (name, value)."""

    law: Law
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
    X1_MPa: float
    X2_MPa: float
    nu: float
    kappa: KappaConvention = "paper"
    law: str = "extended_neo_hookean"
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
        for name, positive in (
            ("X1_MPa", True),
            ("X2_MPa", False),
            ("stretch", True),
            ("slip_mm", False),
            ("stiffness", True),
            ("preload_mbar", False),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0 and (value > 0 or not positive)):
                wanted = "positive" if positive else "zero or more"
                raise InputError(f"{name} {value:g}: expected a finite number, {wanted}")
        kappa_ratio(self.nu, self.kappa)
        if set(get_law(self.law).parameter_names) != {"X1_MPa", "X2_MPa", KAPPA}:
            raise InputError(f"law {self.law!r} is not a skin's; expected extended_neo_hookean")
        inside = sum(layer.thickness_mm for layer in self.above)
        if inside >= self.geometry.thickness_mm:
            raise InputError(
                f"layers of {inside:g} mm inside a skin of {self.geometry.thickness_mm:g} mm: "
                "expected less than the skin"
            )
        room = self.geometry.outer_radius_mm - self.geometry.radius_mm
        if self.slip_mm >= 0.5 * room:
            raise InputError(f"slip_mm {self.slip_mm:g}: expected less than {0.5 * room:g} mm")
        if sum(term.g for term in self.prony) >= 1:
            raise InputError("the shares g of the stress that relaxes: expected a sum below 1")

    @property
    def kappa_MPa(self) -> float:  # noqa: N802 -- the field's name
        """Compressibility constant of the skin."""
        return self.X1_MPa * float(kappa_ratio(self.nu, self.kappa))

    @property
    def elastic(self) -> SkinProblem:
        """The same skin without a memory: what it is in an instant."""
        return replace(self, prony=())


@dataclass(frozen=True)
class Prepared:
    """A problem on its mesh: what Newton's method is given."""

    assembly: Assembly
    apex: int  # the unknown that is the apex deflection
    own: Array  # (m, 1): 1 in the skin's own tissue, 0 in other layers
    _parameters: Mapping[str, Any]
    layered: bool

    def parameters(self, isochoric: float = 1.0) -> dict[str, Any]:
        """Return the law's parameters, the isochoric energy of the skin's own tissue scaled."""
        if isochoric == 1.0:
            return dict(self._parameters)
        factor = 1.0 - (1.0 - isochoric) * self.own if self.layered else isochoric
        return {k: v if k == KAPPA else v * factor for k, v in self._parameters.items()}

    def isochoric_parameters(self) -> dict[str, Any]:
        """Return the parameters of the isochoric energy alone."""
        return {k: 0.0 * v if k == KAPPA else v for k, v in self._parameters.items()}


def prepare(problem: SkinProblem, discretisation: Discretisation = MESH_OF_RECORD) -> Prepared:
    """Return the problem on its mesh."""
    assembly, apex = _assembly(
        problem.geometry,
        discretisation,
        problem.law,
        tuple(term.law for term in problem.terms),
        problem.slip_mm,
        tuple(layer.thickness_mm for layer in problem.above),
        tuple(layer.thickness_mm for layer in problem.below),
    )
    layer = assembly.mesh.layer
    own_layer = len(problem.above)
    own = (layer == own_layer).astype(float)[:, None]
    skin = {"X1_MPa": problem.X1_MPa, "X2_MPa": problem.X2_MPa, KAPPA: problem.kappa_MPa}
    skin |= {name: value for term in problem.terms for name, value in term.parameters}
    others = [
        {"X1_MPa": other.X1_MPa, KAPPA: other.kappa_MPa}
        for other in (*problem.above, *problem.below)
    ]
    by_layer = [*others[:own_layer], skin, *others[own_layer:]]
    layered = len(by_layer) > 1
    parameters: dict[str, Any] = dict(skin)
    if layered:
        parameters = {
            name: np.array([of.get(name, 0.0) for of in by_layer])[layer][:, None] for name in skin
        }
    if problem.stretch != 1.0 or problem.stiffness != 1.0:
        relaxed = 1.0 - sum(term.g for term in problem.prony)
        through = np.ones(len(by_layer))
        plane = np.ones(len(by_layer))
        for k, of in enumerate(by_layer[: own_layer + 1]):
            scaled = of if k != own_layer else _scaled(of, relaxed)
            full = {name: scaled.get(name, 0.0) for name in skin}
            plane[k] = problem.stretch
            through[k] = through_thickness(problem.stretch, assembly.law, full)
        factor = 1.0 + (problem.stiffness - 1.0) * own[:, 0]
        assembly = assembly.prestrained(np.stack([plane[layer], through[layer]]), factor)
    return Prepared(assembly, apex, own, parameters, layered)


def through_thickness(stretch: float, law: Law, parameters: Mapping[str, float]) -> float:
    """Return the stretch through the thickness that leaves no stress there, under one in the plane.

    Raises:
        InputError: there is none between a fifth and five times.
    """
    if stretch == 1.0:
        return 1.0

    def stress(through: float) -> float:
        f = np.array([stretch, 0.0, 0.0, through, stretch])[:, None]
        return float(stress_and_tangent(f, law, parameters)[1][3, 0])

    try:
        return float(brentq(stress, 0.2, 5.0, xtol=1e-15, rtol=1e-14))
    except ValueError:
        raise InputError(f"stretch {stretch:g}: no equilibrium through the thickness") from None


def _scaled(parameters: Mapping[str, float], isochoric: float) -> dict[str, float]:
    return {k: v if k == KAPPA else v * isochoric for k, v in parameters.items()}


@lru_cache(maxsize=32)
def _assembly(
    geometry: Geometry,
    discretisation: Discretisation,
    law_name: str,
    terms: tuple[Law, ...],
    slip_mm: float,
    above_mm: tuple[float, ...],
    below_mm: tuple[float, ...],
) -> tuple[Assembly, int]:
    mesh = discretisation.mesh(geometry, slip_mm, above_mm, below_mm)
    fixed = [2 * mesh.axis, 2 * mesh.tape, 2 * mesh.tape + 1, 2 * mesh.outer]
    if below_mm:
        fixed += [2 * mesh.bottom, 2 * mesh.bottom + 1]
    law: Law = get_law(law_name)
    if terms:
        law = Total((law, *terms))
    assembly = Assembly(mesh, discretisation.element, law, np.unique(np.concatenate(fixed)))
    return assembly, int(assembly.equation[2 * mesh.apex + 1])
