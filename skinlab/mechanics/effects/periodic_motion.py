"""Probe and skin move against each other, again and again, from the beginning of a curve on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from skinlab.mechanics.effects.base import Array, Effect, Parameter, Values


class PeriodicMotion(Effect):
    """See the module.

    What moves by itself (breathing, a pulse) has another phase in every curve: the error models of
    these names. This one begins with the suction: a pump, a regulator that hunts, a held breath.
    """

    name = "periodic_motion"
    meaning = "the probe moves to and fro, in step with the beginning of the curve"
    formula = "w + amplitude sin(2π frequency (t − t of the first sample))"
    source = "vibration of pump and regulator; tremor"
    physical = False
    form_of = "periodic"
    tried: ClassVar[Mapping[str, tuple[float, ...]]] = {
        "frequency_hz": tuple(0.1 + 0.07 * i for i in range(85))  # closer than 1/10 s
    }
    parameters = (
        Parameter(
            "amplitude_um", "µm", "half of the way", -500.0, 500.0, 0.0, 10.0,
            "no published size: a range to look in",
        ),
        Parameter(
            "frequency_hz", "Hz", "how often in a second", 0.02, 20.0, None, 1.0,
            "tremor of 4–12 Hz, regulators of 0.1–5 Hz", "log",
        ),
    )  # fmt: skip

    def read(self, since_s: Array, deflection_mm: Array, values: Values) -> Array:
        """Add the motion."""
        angle = 2.0 * np.pi * values["frequency_hz"] * since_s
        return np.asarray(deflection_mm + 1e-3 * values["amplitude_um"] * np.sin(angle))

    def unseen(self, values: Values, longest_s: float) -> str:
        """Ask for one whole period: less of it is a drift that bends."""
        period_s = 1.0 / values["frequency_hz"]
        if period_s <= longest_s:
            return ""
        return f"a period of {period_s:.0f} s is longer than any curve ({longest_s:.0f} s)"


EFFECT = PeriodicMotion()
