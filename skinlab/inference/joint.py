"""Several misfits as one: curves of one skin, with one set of parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.problem import SquaredMisfit

Array = NDArray[np.float64]


class JointMisfit:
    """The sum of misfits that share their parameters."""

    def __init__(self, misfits: Sequence[SquaredMisfit]) -> None:
        """Add up the misfits, which have to be in one unit."""
        self._misfits = tuple(misfits)

    @property
    def rest(self) -> float:
        """The part of the sum that no candidate can take away."""
        return float(sum(m.rest for m in self._misfits))

    def __call__(self, parameters: Array) -> Array:
        """Return the sums (n,) for candidates (n, p); infinite where there is no model."""
        return np.asarray(sum(misfit(parameters) for misfit in self._misfits))

    def differences(self, parameters: Array) -> Array:
        """Return residuals (n, m) of candidates, the rest not among them."""
        return np.concatenate([m.differences(parameters) for m in self._misfits], axis=1)

    def slopes(self, parameters: Array) -> Array:
        """Return the derivatives (n, m, p) of `differences`."""
        return np.concatenate([m.slopes(parameters) for m in self._misfits], axis=1)


@dataclass(frozen=True)
class GaussianPrior:
    """A prior as one more residual: parameter number `index` is `mean` ± `sd`."""

    index: int
    mean: float
    sd: float
    rest: float = 0.0

    def __call__(self, parameters: Array) -> Array:
        """Return the squared deviations (n,)."""
        return np.asarray(self.differences(parameters)[:, 0] ** 2)

    def differences(self, parameters: Array) -> Array:
        """Return the deviations (n, 1), in standard deviations."""
        return np.asarray((parameters[:, [self.index]] - self.mean) / self.sd)

    def slopes(self, parameters: Array) -> Array:
        """Return their derivatives (n, 1, p)."""
        slopes = np.zeros((len(parameters), 1, parameters.shape[1]))
        slopes[:, 0, self.index] = 1.0 / self.sd
        return slopes
