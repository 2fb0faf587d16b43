"""What an inverse method is given and what it gives back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skinlab.errors import InputError
from skinlab.parameters import ParameterSpace

Array = NDArray[np.float64]

MOST_SAMPLES = 1_000_000  # a draw of more is a slip of the pen, and does not fit into memory


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


@dataclass(frozen=True)
class Problem:
    """Find the parameters in `space` whose curve is nearest to the measured one."""

    space: ParameterSpace
    misfit: SquaredMisfit
    points: int  # u, the number of samples that are fitted

    def residuals(self, parameters: Array) -> Array:
        """Return residuals (m + 1,) of one candidate, mm; their squares sum up to the misfit."""
        return np.append(self.misfit.differences(parameters[None])[0], np.sqrt(self.misfit.rest))

    def error_um(self, parameters: Array) -> Array:
        """Return the paper's E (n,) of candidates (n, k), µm: (1/u) sqrt(Σ d²), eq. (11)."""
        return np.asarray(1e3 * np.sqrt(self.misfit(parameters)) / self.points)


@dataclass(frozen=True)
class Options:
    """Arguments of the methods; each reads those that concern it.

    `own` are a method's own, by name (`skinlab.inference.methods.base.Option`): those that are not
    there have their defaults.
    """

    samples: int = 1000  # N
    best: int = 20  # N_b
    tolerance_um: float = 1e-5  # C
    most_iterations: int = 500
    own: tuple[tuple[str, int | float | str], ...] = ()

    def having(self, **own: int | float | str) -> Options:
        """Return these with more of a method's own options."""
        return replace(self, own=tuple(sorted((dict(self.own) | own).items())))


def check(options: Options) -> None:
    """Refuse what all methods read and cannot work with.

    Raises:
        InputError: names the option and what was expected.
    """
    if not 2 <= options.samples <= MOST_SAMPLES:
        raise InputError(f"samples {options.samples}: expected 2 to {MOST_SAMPLES}")
    if not 2 <= options.best <= options.samples:
        raise InputError(
            f"best {options.best}: expected 2 to the number of samples, {options.samples}"
        )
    if not 0 <= options.tolerance_um < math.inf:  # no JSON of a session could hold it
        raise InputError(f"tolerance_um {options.tolerance_um}: expected zero or more, and finite")


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
