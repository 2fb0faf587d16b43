"""What an inverse method is given and what it gives back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skinlab.parameters import ParameterSpace

Array = NDArray[np.float64]


class LeastSquares(Protocol):
    """Residuals whose squares are to be least, for many candidates at once."""

    def differences(self, parameters: Array) -> Array:
        """Return residuals (n, m) of candidates (n, p); NaN where there is no model."""
        ...

    def slopes(self, parameters: Array) -> Array:
        """Return the derivatives (n, m, p) of `differences`."""
        ...


class SquaredMisfit(LeastSquares, Protocol):
    """Σ (M − Ω)², mm², over the samples of the data that are fitted.

    Its `differences` leave out `rest`, the part that no candidate can take away.
    """

    @property
    def rest(self) -> float:
        """The part of the sum that no candidate can take away."""
        ...

    def __call__(self, parameters: Array) -> Array:
        """Return the sums (n,) of candidates (n, p); infinite where there is no model."""
        ...

    def residuals(self, parameters: Array) -> Array:
        """Return residuals of one candidate (m,), mm; their squares sum up to the misfit."""
        ...


@dataclass(frozen=True)
class Problem:
    """Find the parameters in `space` whose curve is nearest to the measured one."""

    space: ParameterSpace
    misfit: SquaredMisfit
    points: int  # u, the number of samples that are fitted

    def error_um(self, parameters: Array) -> Array:
        """Return the paper's E (n,) of candidates (n, k), µm: (1/u) sqrt(Σ d²), eq. (11)."""
        return np.asarray(1e3 * np.sqrt(self.misfit(parameters)) / self.points)


@dataclass(frozen=True)
class Options:
    """Arguments of the methods; each reads those that concern it."""

    samples: int = 1000  # N
    best: int = 20  # N_b
    tolerance_um: float = 1e-5  # C
    most_iterations: int = 500


@dataclass(frozen=True)
class Estimate:
    """A method's answer."""

    parameters: Array  # (k,)
    error_um: float
    iterations: int
    evaluations: int
    converged: bool
    minima: Array | None = (
        None  # (m, k) points of the unit cube, best first, where it found several
    )


class Method(Protocol):
    """An inverse method. Same problem, options and generator state: same bits."""

    def __call__(self, problem: Problem, options: Options, rng: np.random.Generator) -> Estimate:
        """Return the answer."""
        ...
