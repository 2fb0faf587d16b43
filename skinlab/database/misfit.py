"""The misfit of a curve, in the few dimensions in which a database's curves live."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class ComponentModel(Protocol):
    """A forward model that gives curves by their components."""

    def coordinates(self, parameters: Array) -> Array:
        """Return the components (n, k) of candidates; NaN where there is no model."""
        ...

    def coordinate_slopes(self, parameters: Array) -> Array:
        """Return derivatives (n, k, parameters) of the components."""
        ...


class Misfit:
    """Σ (M − Ω)² over a curve's samples, mm², for many candidates at once."""

    def __init__(self, model: ComponentModel, q: Array, measured_mm: Array) -> None:
        """Split the measured curve (u,) into what the components `q` (u, k) reach, and the rest."""
        self._model = model
        self._q, self._measured = q, measured_mm
        self._reachable = q.T @ measured_mm
        rest = measured_mm - q @ self._reachable
        self._rest = float(rest @ rest)

    def __call__(self, parameters: Array) -> Array:
        """Return the sums (n,) for candidates (n, k); infinite where there is no model."""
        difference = self._model.coordinates(parameters) - self._reachable
        total = self._rest + np.einsum("nk,nk->n", difference, difference)
        return np.where(np.isfinite(total), total, np.inf)

    def gradient(self, parameters: Array) -> Array:
        """Return the derivatives (n, parameters) of the sums; NaN where there is no model."""
        difference = self._model.coordinates(parameters) - self._reachable
        slopes = self._model.coordinate_slopes(parameters)
        return np.asarray(2.0 * np.einsum("nk,nkp->np", difference, slopes))

    def residuals(self, parameters: Array) -> Array:
        """Return residuals (k + 1,) of one candidate; their squares sum up to the misfit."""
        difference = self._model.coordinates(parameters[None])[0] - self._reachable
        return np.append(difference, np.sqrt(self._rest))

    def sample(self, parameters: Array, t: int) -> tuple[float, Array]:
        """Return M − Ω at sample t, mm, of one candidate (k,), and ∂Ω/∂parameters there (k,).

        For methods that take the samples one by one.
        """
        coordinates = self._model.coordinates(parameters[None])[0]
        slopes = self._model.coordinate_slopes(parameters[None])[0]
        return float(self._measured[t] - self._q[t] @ coordinates), self._q[t] @ slopes

    def jacobian(self, parameters: Array) -> Array:
        """Return the derivatives (k + 1, parameters) of `residuals`."""
        slopes = self._model.coordinate_slopes(parameters[None])[0]
        return np.vstack([slopes, np.zeros(slopes.shape[1])])
