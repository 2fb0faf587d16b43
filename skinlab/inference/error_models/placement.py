"""How the probe was put on: each placement has a stiffness and a zero of its own.

Contact force, tilt and tension make the skin look stiffer or softer by some per cent: published
reproducibilities are 6 to 12 % (Diridollou 2000). A change of log stiffness by s moves the curve by
−s p dw/dp; the zero is off by a few µm. Both are random effects, one of each per placement, whose
scales are learned where there are several placements. Where a deviation of the thickness is stated,
each placement has a thickness of its own too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skinlab.inference.error_models.base import Hyperparameter, Look, Part, Terms

_SCATTER = Hyperparameter("placement_scatter", 0.095, 0.7)  # of published 6.4, 9.5 and 12.4 %
# Zeros published for contact differ by 3 to 10 µm: smaller ones are as likely as they were, but a
# scatter of 25 µm is no scatter. With as long a tail above, an offset of 25 µm in all of two curves
# was as probable a scatter as an effect (docs/decisions/0042-advice-and-speed.md).
_OFFSET = Hyperparameter("placement_offset_um", 4.0, 0.7, log_sd_above=0.45)


def expected_sizes(stated_scatter: float | None) -> tuple[float, float]:
    """Return the scatter of log stiffness and the zero's, in mm, that are expected before data.

    `stated_scatter` is that which a user states; 0: placements do not differ.
    """
    if stated_scatter == 0.0:
        return 0.0, 0.0
    return stated_scatter or _SCATTER.median, 1e-3 * _OFFSET.median


@dataclass(frozen=True)
class Placement:
    """Random effects of stiffness and zero, common to all samples of a placement.

    `absent` is the share of their priors with which placements hardly differ. With `lone_zero` the
    zero of a curve alone is off as well (its stiffness is the skin's, as far as it can tell).
    """

    absent: float = 0.0
    lone_zero: bool = False
    name: str = "placement"
    meaning: str = (
        "how each putting-on of the probe differs: a stiffness, a zero and, where its deviation "
        "is stated, a thickness, of curves together"
    )
    prior: str = "9.5 %, 0.7; 4 µm, 0.7 below and 0.45 above; always there"

    def part(self, look: Look) -> Part | None:
        """Return its part for several curves together, unless there is said to be no scatter."""
        samples, stated = look.samples, look.placement_scatter
        alone = samples.curves < 2
        if stated == 0.0 or (alone and not self.lone_zero):
            return None
        if alone:
            zero = np.ones((len(samples), 1))

            def off(values: Sequence[float]) -> Terms:
                return Terms(columns_mm=zero, sizes=1e-3 * np.array(values))

            return Part("placement", (_OFFSET,), off, always=True)
        numbers = np.unique(samples.placement)
        one = (samples.placement[:, None] == numbers).astype(float)
        thickness = np.zeros((len(samples), 0))
        if look.thickness_error_mm is not None:
            thickness = look.thickness_error_mm[:, None] * one
        softer = look.softer_mm
        if softer is None:
            softer = samples.pressure_mbar * look.slope_mm_per_mbar
        stiffness = softer[:, None] * one
        columns = np.hstack([stiffness, one, thickness])
        counts = (len(numbers), len(numbers), thickness.shape[1])

        def terms(values: Sequence[float]) -> Terms:
            offset_um, *learned = values
            scatter = learned[0] if stated is None else stated
            sizes = np.repeat([scatter, 1e-3 * offset_um, 1.0], counts)
            return Terms(columns_mm=columns, sizes=sizes)

        both = (_OFFSET, _SCATTER) if stated is None else (_OFFSET,)
        parameters = tuple(replace(one, absent=self.absent) for one in both)
        known = {"placement_count": float(len(numbers))}
        if stated is not None:
            known["placement_scatter"] = stated
        return Part("placement", parameters, terms, always=True, stated=known)


ERROR_MODEL = Placement()
