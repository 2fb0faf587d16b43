"""Errors in proportion to the deflection: speckle, optics. Independent from sample to sample."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinlab.inference.error_models.base import Array, Hyperparameter, Look, Part, Terms
from skinlab.inference.settings import KINDS

_SHARE = Hyperparameter("proportional_share", 0.01, 0.7)


@dataclass(frozen=True)
class Proportional:
    """Independent errors, a share of the deflection."""

    name: str = "proportional"
    meaning: str = "a share of the deflection"
    prior: str = "1 %; 0.7; odds 1 : 5"

    def part(self, look: Look) -> Part | None:
        """Return its part, from some samples on."""
        if len(look.samples) < KINDS.fewest_shapes:
            return None
        squared = np.square(look.deflection_mm)

        def variances(values: Array) -> Array:
            return np.asarray(values[..., :1] ** 2 * squared)

        def terms(values: Sequence[float]) -> Terms:
            return Terms(variances(np.array(values)))

        return Part(
            "proportional", (_SHARE,), terms, math.log(KINDS.unusual_odds),
            why="residuals grow with the deflection", variances=variances,
        )  # fmt: skip


ERROR_MODEL = Proportional()
