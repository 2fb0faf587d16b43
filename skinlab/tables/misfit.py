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


class Whitening(Protocol):
    """A linear map W of curves with WᵀW the inverse of the covariance of their errors."""

    def __call__(self, curves_mm: Array) -> Array:
        """Return W applied to curves (u, …), without unit."""
        ...


class Misfit:
    """Σ (M − Ω)² over a curve's samples, for many candidates at once.

    In mm²; with a whitening (M − Ω)ᵀ Σ⁻¹ (M − Ω), without unit.
    """

    def __init__(
        self,
        model: ComponentModel,
        q: Array,
        measured_mm: Array,
        whitening: Whitening | None = None,
    ) -> None:
        """Split the measured curve (u,) into what the components `q` (u, k) reach, and the rest."""
        self._model = model
        self._q, self._measured = q, measured_mm
        self._turn: Array | None = None  # takes components to those of whitened curves
        if whitening is None:
            basis, target = q, measured_mm
        else:
            basis, self._turn = np.linalg.qr(whitening(q))
            target = whitening(measured_mm)
        self._reachable = basis.T @ target
        rest = target - basis @ self._reachable
        self._rest = float(rest @ rest)

    def __call__(self, parameters: Array) -> Array:
        """Return the sums (n,) for candidates (n, p); infinite where there is no model."""
        difference = self.differences(parameters)
        total = self._rest + np.einsum("nk,nk->n", difference, difference)
        return np.where(np.isfinite(total), total, np.inf)

    @property
    def rest(self) -> float:
        """The part of the sum that no candidate can take away."""
        return self._rest

    def differences(self, parameters: Array) -> Array:
        """Return Ω − M (n, k) of candidates, in components; the rest is not among them."""
        found = self._model.coordinates(parameters)
        if self._turn is not None:
            found = found @ self._turn.T
        return np.asarray(found - self._reachable)

    def slopes(self, parameters: Array) -> Array:
        """Return the derivatives (n, k, p) of `differences`; NaN where there is no model."""
        found = self._model.coordinate_slopes(parameters)
        if self._turn is not None:
            by = np.swapaxes(found, 1, 2)  # as they lie in memory: one product of all
            turned = by.reshape(-1, by.shape[2]) @ self._turn.T
            found = np.swapaxes(turned.reshape(*by.shape[:2], len(self._turn)), 1, 2)
        return found

    def sample(self, parameters: Array, t: int) -> tuple[float, Array]:
        """Return M − Ω at sample t, mm, of one candidate (p,), and ∂Ω/∂parameters there (p,).

        For methods that take the samples one by one.
        """
        coordinates = self._model.coordinates(parameters[None])[0]
        slopes = self._model.coordinate_slopes(parameters[None])[0]
        return float(self._measured[t] - self._q[t] @ coordinates), self._q[t] @ slopes
