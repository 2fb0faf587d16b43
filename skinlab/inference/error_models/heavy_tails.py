"""Heavy tails: the sensor's noise as Student's t, a mixture of Gaussians of many sizes.

λ ~ Gamma(ν/2, ν/2), e | λ ~ N(0, σ²/λ): Lange, Little and Taylor 1989, J. Am. Stat. Assoc. 84:881.
Weights E λ given the rest are found by iteration; the evidence is then a variational bound (Jordan
et al. 1999, Machine Learning 37:183), exact where there is nothing but white noise. Weights that
were found, taken as known, say more than the data do: the variances are stretched by (ν+3)/(ν+1),
so that they sum up to the Fisher information of Student's t.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from skinlab.inference.error_models.base import Array, Look, Part, Terms
from skinlab.inference.error_models.quantised import in_waves
from skinlab.inference.settings import KINDS


@dataclass(frozen=True)
class HeavyTails:
    """Student's t for the independent errors."""

    name: str = "heavy_tails"
    meaning: str = "Student's t in place of a Gaussian"
    prior: str = "odds 1 : 5"

    def part(self, look: Look) -> Part | None:
        """Return its part where the tails are heavier than Gaussian."""
        square = look.white_square
        if square is None or len(square) < KINDS.fewest_shapes or not square.mean() > 0.0:
            return None
        if in_waves(look):
            return None
        scaled = square / square.mean()
        if np.mean(scaled**2) < 3.0 + KINDS.tails_suspect * math.sqrt(96.0 / len(square)):
            return None
        found = [(float(bound(square, f).sum()), f) for f in KINDS.tails]
        freedom = max(found)[1]
        return student(square, freedom)


def student(square: Array, freedom: float) -> Part:
    """Return the part of so many degrees of freedom, above 2, given squares (u,) in units of σ²."""
    stretch = 1.0 / weights(square, freedom)

    def terms(values: Sequence[float]) -> Terms:
        del values
        return Terms(stretch=stretch)

    return Part(
        "heavy_tails", (), terms, math.log(KINDS.unusual_odds), stated={"freedom": freedom},
        why="residuals have heavy tails", bound=bound(square, freedom),
        spread=(freedom + 3.0) / (freedom + 1.0), tails=freedom / (freedom - 2.0),
        again=partial(student, freedom=freedom),
    )  # fmt: skip


def weights(square: Array, freedom: float) -> Array:
    """Return E λ (u,)."""
    return np.asarray((freedom + 1.0) / (freedom + square))


def bound(square: Array, freedom: float) -> Array:
    """Return what is to be added (u,) to the Gaussian log density with variances σ²/E λ.

    ½ (E log λ − log E λ) less the divergence of λ's distribution from its prior.
    """
    a, b = 0.5 * (freedom + 1.0), 0.5 * (freedom + square)
    a0 = b0 = 0.5 * freedom
    from scipy.special import digamma  # slow to import

    mean_log = digamma(a) - np.log(b)
    apart = (
        (a - a0) * digamma(a)
        - math.lgamma(a)
        + math.lgamma(a0)
        + a0 * np.log(b / b0)
        + a * (b0 - b) / b
    )
    return np.asarray(0.5 * (mean_log - np.log(a / b)) - apart)


ERROR_MODEL = HeavyTails()
