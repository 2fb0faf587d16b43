"""The likelihood of the skin's parameters with the errors' parameters integrated out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.covariance import products
from skinlab.inference.error_choice import ErrorChoice
from skinlab.inference.posterior import log_sum_exp
from skinlab.inference.samples import alike
from skinlab.tables.base import CurveModel

Array = NDArray[np.float64]

_FOR_BASIS = 200  # curves that the others are combinations of
_KEPT = 0.01  # of the least noise: components that move no curve by more are dropped
_AT_ONCE = 4_000_000  # numbers


@dataclass(eq=False)
class IntegratedLikelihood:
    """log Σⱼ wⱼ N(y; w(θ), Σⱼ) over the nodes of an error choice, of many θ at once.

    The curves of a posterior live in a handful of dimensions: in these each node's quadratic form
    is a small matrix, so that all nodes together are one matrix product.
    """

    models: Sequence[CurveModel]
    residual_mm: Array  # (u,) measured − model at the best fit, of the samples that are kept
    best_mm: Array  # (u,)
    kept: NDArray[np.bool_]  # (all samples,)
    choice: ErrorChoice
    _basis: Array | None = field(default=None, init=False)
    _forms: Array = field(init=False)

    def __call__(self, parameters: Array) -> Array:
        """Return log densities (n,); −∞ where there is no model."""
        found = np.full(len(parameters), -np.inf)
        if self._basis is None:
            self._prepare(parameters)
        assert self._basis is not None
        step = max(1, _AT_ONCE // len(self.kept))
        for begin in range(0, len(parameters), step):
            moved = self._moved(parameters[begin : begin + step])
            holds = np.isfinite(moved).all(axis=1)
            found[begin : begin + step][holds] = self._density(moved[holds] @ self._basis)
        return found

    def _moved(self, parameters: Array) -> Array:
        curves = [model.deflection_mm(parameters) for model in self.models]
        whole = curves[0] if len(curves) == 1 else np.hstack(curves)
        if not self.kept.all():
            whole = whole[:, self.kept]
        return np.asarray(whole - self.best_mm)

    def _prepare(self, parameters: Array) -> None:
        """Find the dimensions from some of these curves, and each node's form in them."""
        chosen = np.linspace(0, len(parameters) - 1, min(_FOR_BASIS, len(parameters))).astype(int)
        moved = self._moved(parameters[chosen])
        moved = moved[np.isfinite(moved).all(axis=1)]
        _, s, basis = np.linalg.svd(moved, full_matrices=False)
        least = min(float(node.covariance.variance_mm2.min()) for node in self.choice.nodes)
        rank = int((s > _KEPT * np.sqrt(least * max(len(moved), 1))).sum())
        self._basis = basis[:rank].T
        both = np.column_stack([self.residual_mm, self._basis])
        forms = np.empty((len(self.choice.nodes), 1 + rank + rank * (rank + 1) // 2))
        for members in alike([id(node.combination) for node in self.choice.nodes]):
            nodes = [self.choice.nodes[i] for i in members]
            gram, log_determinant = products([node.covariance for node in nodes], both)
            prior = np.array([node.log_prior for node in nodes])
            forms[members, 0] = gram[:, 0, 0] + log_determinant - 2.0 * prior
            forms[members, 1 : 1 + rank] = -2.0 * gram[:, 0, 1:]
            i, j = np.tril_indices(rank)
            forms[members, 1 + rank :] = gram[:, 1 + i, 1 + j]
        self._forms = -0.5 * forms.T

    def _density(self, at: Array) -> Array:
        i, j = np.tril_indices(at.shape[1])
        twice = np.where(i == j, 1.0, 2.0)
        features = np.column_stack([np.ones(len(at)), at, at[:, i] * at[:, j] * twice])
        return log_sum_exp(features @ self._forms)
