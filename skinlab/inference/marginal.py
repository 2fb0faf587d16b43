"""The likelihood of the skin's parameters with the errors' parameters integrated out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.covariance import block_diagonal, products
from skinlab.inference.error_choice import ErrorChoice
from skinlab.inference.posterior import log_sum_exp
from skinlab.inference.samples import alike
from skinlab.inference.settings import CHOICE
from skinlab.tables.base import CurveModel

Array = NDArray[np.float64]

_FOR_BASIS = 200  # curves that the others are combinations of
_AT_ONCE = 50_000  # numbers, which stay in a core's cache


@dataclass(eq=False)
class IntegratedErrors:
    """log Σⱼ wⱼ N(r − m; 0, Σⱼ) over the nodes of an error choice, of many changes m at once.

    The curves of a posterior live in a handful of dimensions: in these each node's quadratic form
    is a small matrix, so that all nodes together are one matrix product.
    """

    residual_mm: Array  # (u,) measured − model at the best fit
    choice: ErrorChoice
    basis: Array | None = None  # (u, components), orthonormal; None: changes are told by sample
    _turn: Array | None = field(default=None, init=False)  # (components, dimensions)
    _forms: Array = field(init=False)

    def __call__(self, moved: Array) -> Array:
        """Return log densities (n,) of changes (n, components) from the best fit.

        The dimensions are those of the changes of the first call.
        """
        if self._turn is None:
            self._prepare(moved)
        assert self._turn is not None
        at = moved @ self._turn
        step = max(8, _AT_ONCE // max(self._forms.shape))
        parts = [self._density(at[i : i + step]) for i in range(0, len(at), step)]
        return np.concatenate(parts)

    def _prepare(self, moved: Array) -> None:
        """Find the dimensions from some of these curves, and each node's form in them."""
        chosen = np.linspace(0, len(moved) - 1, min(_FOR_BASIS, len(moved))).astype(int)
        _, s, turn = np.linalg.svd(moved[chosen], full_matrices=False)
        least = min(float(node.covariance.variance_mm2.min()) for node in self.choice.nodes)
        rank = int((s > CHOICE.basis_kept * np.sqrt(least * max(len(chosen), 1))).sum())
        self._turn = turn[:rank].T
        curves = self._turn if self.basis is None else self.basis @ self._turn
        both = np.column_stack([self.residual_mm, curves])
        forms = np.empty((len(self.choice.nodes), 1 + rank + rank * (rank + 1) // 2))
        i, j = np.tril_indices(rank)
        for members in alike([id(node.combination) for node in self.choice.nodes]):
            nodes = [self.choice.nodes[i] for i in members]
            gram, log_determinant = products([node.covariance for node in nodes], both)
            prior = np.array([node.log_prior for node in nodes])
            forms[members, 0] = gram[:, 0, 0] + log_determinant - 2.0 * prior
            forms[members, 1 : 1 + rank] = -2.0 * gram[:, 0, 1:]
            forms[members, 1 + rank :] = gram[:, 1 + i, 1 + j] * np.where(i == j, 1.0, 2.0)
        self._forms = -0.5 * forms.T

    def _density(self, at: Array) -> Array:
        i, j = np.tril_indices(at.shape[1])
        features = np.column_stack([np.ones(len(at)), at, at[:, i] * at[:, j]])
        return log_sum_exp(features @ self._forms)


class IntegratedLikelihood:
    """`IntegratedErrors` of models of the table: of their parameters."""

    def __init__(
        self,
        models: Sequence[CurveModel],
        residual_mm: Array,
        best: Array,
        kept: NDArray[np.bool_],
        choice: ErrorChoice,
    ) -> None:
        """Take residuals (u,) of the samples that are kept, at the best parameters (p,)."""
        self._models = models
        self._best = self._coordinates(best[None])
        basis, self._inner = np.linalg.qr(block_diagonal([m.basis for m in models])[kept])
        self._errors = IntegratedErrors(residual_mm, choice, basis)

    def __call__(self, parameters: Array) -> Array:
        """Return log densities (n,); −∞ where there is no model."""
        moved = self._coordinates(parameters) - self._best
        holds = np.isfinite(moved).all(axis=1)
        found = np.full(len(parameters), -np.inf)
        if holds.any():
            found[holds] = self._errors(moved[holds] @ self._inner.T)
        return found

    def _coordinates(self, parameters: Array) -> Array:
        each = [model.coordinates(parameters) for model in self._models]
        return each[0] if len(each) == 1 else np.hstack(each)
