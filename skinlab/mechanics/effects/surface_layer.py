"""A thin stiff layer on top, the stratum corneum."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import Layer, SkinProblem
from skinlab.mechanics.materials.extended_neo_hookean import X1


class SurfaceLayer(Effect):
    """See the module."""

    name = "surface_layer"
    meaning = "a thin stiff layer on top (stratum corneum)"
    formula = "inside the stated thickness, neo-Hookean, ν of the base"
    source = "Sachs et al. 2021: layers above the dermis strongly influence suction"
    physical = True
    needs_history = False
    curved = True
    # What bends is a layer of another kind than what is stretched: the third power of thickness.
    tried: ClassVar[Mapping[str, tuple[float, ...]]] = {"thickness_um": (60.0,)}
    parameters = (
        Parameter(
            "thickness_um", "µm", "of the layer, inside that of the skin", 0.0, 200.0, 0.0, 20.0,
            "stratum corneum of 10–30 µm on the forearm",
        ),
        Parameter(
            X1, "MPa", "its stiffness", 0.001, 100.0, None, 1.0,
            "decades between wet and dry: a range to look in", "log",
        ),
    )  # fmt: skip

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Put it inside the skin, under what is on top already."""
        if values["thickness_um"] == 0.0:
            return problem
        x1 = values[X1]
        kappa = x1 * problem.skin.dilatation_ratio
        layer = Layer(1e-3 * values["thickness_um"], x1, kappa)
        return replace(problem, above=(*problem.above, layer))


EFFECT = SurfaceLayer()
