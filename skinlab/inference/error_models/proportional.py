"""Errors in proportion to the deflection: speckle, optics. Independent from sample to sample."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinlab.inference.error_models.base import Hyperparameter, Look, Part, Terms

_SHARE = Hyperparameter("proportional_share", 0.01, 0.7)
_ODDS = 0.2
_FEWEST = 20


@dataclass(frozen=True)
class Proportional:
    """Independent errors, a share of the deflection."""

    name: str = "proportional"
    meaning: str = "a share of the deflection"
    prior: str = "1 %; 0.7; odds 1 : 5"

    def part(self, look: Look) -> Part | None:
        """Return its part, from some samples on."""
        if len(look.samples) < _FEWEST:
            return None
        squared = np.square(look.deflection_mm)

        def terms(values: Sequence[float]) -> Terms:
            return Terms(values[0] ** 2 * squared)

        return Part(
            "proportional", (_SHARE,), terms, math.log(_ODDS),
            why="residuals grow with the deflection",
        )  # fmt: skip


ERROR_MODEL = Proportional()
