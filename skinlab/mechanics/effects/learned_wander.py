"""A zero that wanders in time, in each curve in another way."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from skinlab.mechanics.effects.base import Array, Parameter
from skinlab.mechanics.effects.learned_motion import LearnedMotion

_HARMONICS = 8
_SOURCE = "found in what repeats do not have in common"


class LearnedWander(LearnedMotion):
    """See the module. What lasts some time is a sum of sines over twice the longest curve."""

    name = "learned_wander"
    family = "time"
    meaning = "the zero wanders in time, in each curve in another way, as found from the data"
    source = "drift of probe, tape and skin; spectrum of an Ornstein-Uhlenbeck process"
    harmonics = _HARMONICS
    parameters: ClassVar[tuple[Parameter, ...]] = (
        *(
            Parameter(
                f"{letter}{k}_um", "µm", f"{what} of {k} times the frequency", -300.0, 300.0, 0.0,
                10.0 / k, _SOURCE,
            )
            for letter, what in (("s", "sine"), ("c", "cosine"))
            for k in range(1, _HARMONICS + 1)
        ),
        LearnedMotion.parameters[-1],
    )  # fmt: skip

    def sentence(self, x: Array, y: Array) -> str:
        """Say how far."""
        return (
            "depends on time, not on suction, and is another one in each curve: the zero wanders "
            f"by about {y.max():.2g} µm within {x[int(np.argmax(y))]:.2g} s"
        )


EFFECT = LearnedWander()
