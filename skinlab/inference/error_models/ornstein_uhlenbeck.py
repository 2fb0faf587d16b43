"""Errors that last: tremor, breathing, creep of the tape. An Ornstein-Uhlenbeck process in time.

Its covariance size² exp(−|Δt|/time) is right for uneven and lost samples. Uhlenbeck and Ornstein
1930, Phys. Rev. 36:823; at even times it is an AR(1). Real traction records at 100 Hz have lag-one
correlations of 0.39 to 0.95.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from skinlab.inference.covariance import OrnsteinUhlenbeck
from skinlab.inference.error_models.base import Hyperparameter, Look, Part, Terms
from skinlab.inference.settings import KINDS

_SIZE = Hyperparameter("ou_um", 3.0, 0.6)
_TIME = Hyperparameter("ou_s", 0.7, 1.2)


@dataclass(frozen=True)
class Correlated:
    """Errors correlated in time."""

    name: str = "ou"
    meaning: str = (
        "lasting: an Ornstein-Uhlenbeck process in time, right for uneven and lost samples too"
    )
    prior: str = "3 µm, 0.6; 0.7 s, 1.2; as likely there as not"

    def part(self, look: Look) -> Part | None:
        """Return its part; a handful of samples cannot tell it from the skin."""
        if len(look.samples) < KINDS.fewest_lasting:
            return None

        def terms(values: Sequence[float]) -> Terms:
            return Terms(ou=OrnsteinUhlenbeck(1e-3 * values[0], values[1]))

        return Part(
            "ou", (_SIZE, _TIME), terms, math.log(KINDS.lasting_odds), lasting=True,
            why="residuals are correlated in time",
        )  # fmt: skip


ERROR_MODEL = Correlated()
