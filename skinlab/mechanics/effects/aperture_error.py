"""A probe's opening is not as wide as it is said to be."""

from __future__ import annotations

from dataclasses import replace

from skinlab.curves.apertures import APERTURES_MM
from skinlab.mechanics.effects.base import Effect, Parameter, Values
from skinlab.mechanics.fem.skin import SkinProblem

_USUAL_MM = 6.0
_TYPICAL_MM = 0.06  # a third of what is looked for at first: two tenths of a mm
_SIZE = "wear and glue at the rim: one or two tenths of a mm; no published size"


def _name(aperture_mm: float) -> str:
    return "ratio" if aperture_mm == _USUAL_MM else f"ratio{aperture_mm:g}"


class ApertureError(Effect):
    """See the module: each opening is a head of its own, and may be off by itself."""

    name = "aperture_error"
    meaning = "an opening is wider or narrower than stated"
    formula = "aperture = ratio × the stated one; `ratio2`, … where another opening differs"
    source = "dimensions of exchangeable heads: wear, glue and skin at the rim"
    physical = True
    form_of = "opening"
    needs_history = False
    parameters = tuple(
        Parameter(
            _name(a), "", f"true over stated of the {a:g} mm opening; 1 is right", 0.8, 1.25,
            1.0, 1.0 + _TYPICAL_MM / a, _SIZE,
            symbol="" if a == _USUAL_MM else f"ratio of {a:g} mm",
        )
        for a in sorted(APERTURES_MM, key=lambda a: a != _USUAL_MM)
    )  # fmt: skip

    def full(self, values: Values) -> dict[str, float]:
        """Return the values; openings that are not told of are as `ratio` says, right without it.

        Raises:
            InputError: a parameter is not known or out of bounds.
        """
        every = values.get("ratio", 1.0)
        return super().full({p.name: every for p in self.parameters} | dict(values))

    def change(self, problem: SkinProblem, values: Values, cycle: int) -> SkinProblem:
        """Widen."""
        stated = problem.geometry.aperture_mm
        ratio = values.get(_name(stated), values.get("ratio", 1.0))
        if ratio == 1.0:
            return problem
        return replace(problem, geometry=replace(problem.geometry, aperture_mm=stated * ratio))


EFFECT = ApertureError()
