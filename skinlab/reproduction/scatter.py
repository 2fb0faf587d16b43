"""What several random cases of one search say together, in numbers and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.reproduction.jobs import Found

Array = NDArray[np.float64]

NAMES = ("X1_MPa", "X2_MPa", "nu")
_DIGITS = (4, 3, 3)


@dataclass(frozen=True, eq=False)
class Scatter:
    """Answers (n, 3) and errors (n,), µm, of n random cases."""

    parameters: Array
    error_um: Array
    iterations: Array  # (n,)
    evaluations: Array  # (n,)

    @classmethod
    def of(cls, found: Sequence[Found]) -> Scatter:
        """Return the scatter of these answers."""
        return cls(
            np.array([f.parameters for f in found]),
            np.array([f.error_um for f in found]),
            np.array([f.iterations for f in found], dtype=float),
            np.array([f.evaluations for f in found], dtype=float),
        )

    @property
    def mean(self) -> Array:
        """Mean parameters (3,)."""
        return np.asarray(self.parameters.mean(axis=0))

    @property
    def sd(self) -> Array:
        """Their standard deviations (3,), of one case."""
        return np.asarray(self.parameters.std(axis=0, ddof=1))

    def holds(self, row: Sequence[float], rounding: Sequence[float]) -> bool:
        """Return whether a printed row lies within two standard deviations of the mean.

        `rounding` (3,) is the unit of the last digit that is printed.
        """
        allowed = 2.0 * self.sd + 0.5 * np.array(rounding)
        return bool((np.abs(np.array(row) - self.mean) <= allowed).all())

    def words(self) -> tuple[str, str, str]:
        """Return mean ± standard deviation of X1, X2 and ν."""
        x1, x2, nu = (
            f"{m:.{d}f} ± {s:.{d}f}" for m, s, d in zip(self.mean, self.sd, _DIGITS, strict=True)
        )
        return x1, x2, nu


def row_words(parameters: Sequence[float] | Array) -> tuple[str, str, str]:
    """Return X1, X2 and ν of one answer."""
    x1, x2, nu = (f"{v:.{d}f}" for v, d in zip(parameters, _DIGITS, strict=True))
    return x1, x2, nu
