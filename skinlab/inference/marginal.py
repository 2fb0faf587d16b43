"""The likelihood of the skin's parameters with the errors' parameters integrated out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.covariance import block_diagonal, products
from skinlab.inference.error_choice import ErrorChoice
from skinlab.inference.posterior import log_sum_exp
from skinlab.inference.samples import alike
from skinlab.tables.base import CurveModel

Array = NDArray[np.float64]

_FOR_BASIS = 200  # curves that the others are combinations of
_KEPT = 0.01  # of the least noise: components that move no curve by more are dropped
_AT_ONCE = 50_000  # numbers, which stay in a core's cache


@dataclass(frozen=True, eq=False)
class Locking:
    """How the mesh locks, which grows as θ goes towards incompressibility.

    `shapes_mm` (u, m) are what a size of 1 is, of the samples that are kept; `size` gives that of
    many θ (n, p), of which one, `assumed`, is among the columns of every node's covariance.
    """

    shapes_mm: Array
    size: Callable[[Array], Array]
    assumed: float


@dataclass(eq=False)
class IntegratedLikelihood:
    """log Σⱼ wⱼ N(y; w(θ), Σⱼ + (s²(θ) − s²) U Uᵀ) over the nodes of an error choice, of many θ.

    The curves of a posterior live in a handful of dimensions: in these each node's quadratic form
    is a small matrix, so that all nodes together are one matrix product. U are the shapes in which
    the mesh locks, s(θ) their size: where the data hardly tell ν, that of the best fit would be far
    too small for skins that are nearly incompressible.
    """

    models: Sequence[CurveModel]
    residual_mm: Array  # (u,) measured − model at the best fit, of the samples that are kept
    best: Array  # (p,) the best fit
    kept: NDArray[np.bool_]  # (all samples,)
    choice: ErrorChoice
    locking: Locking
    _turn: Array | None = field(default=None, init=False)  # (components, dimensions)
    _forms: Array = field(init=False)
    _along: Array = field(init=False)  # (m, 1 + dimensions, nodes) U turned, times Σ⁻¹ r
    _stretch: Array = field(init=False)  # (m, nodes) eigenvalues of Uᵀ Σ⁻¹ U

    def __call__(self, parameters: Array) -> Array:
        """Return log densities (n,); −∞ where there is no model."""
        moved = self._coordinates(parameters) - self._coordinates(self.best[None])
        holds = np.isfinite(moved).all(axis=1)
        found = np.full(len(parameters), -np.inf)
        if not holds.any():
            return found
        if self._turn is None:
            self._prepare(moved[holds])
        assert self._turn is not None
        at = moved[holds] @ self._turn
        more = np.square(self.locking.size(parameters[holds])) - self.locking.assumed**2
        step = max(8, _AT_ONCE // max(self._forms.shape))
        parts = [
            self._density(at[i : i + step], more[i : i + step]) for i in range(0, len(at), step)
        ]
        found[holds] = np.concatenate(parts)
        return found

    def _coordinates(self, parameters: Array) -> Array:
        each = [model.coordinates(parameters) for model in self.models]
        return each[0] if len(each) == 1 else np.hstack(each)

    def _prepare(self, moved: Array) -> None:
        """Find the dimensions from some of these curves, and each node's form in them."""
        chosen = np.linspace(0, len(moved) - 1, min(_FOR_BASIS, len(moved))).astype(int)
        whole, inner = np.linalg.qr(block_diagonal([m.basis for m in self.models])[self.kept])
        _, s, turn = np.linalg.svd(moved[chosen] @ inner.T, full_matrices=False)
        least = min(float(node.covariance.variance_mm2.min()) for node in self.choice.nodes)
        rank = int((s > _KEPT * np.sqrt(least * max(len(chosen), 1))).sum())
        self._turn = inner.T @ turn[:rank].T
        shapes = self.locking.shapes_mm
        both = np.column_stack([self.residual_mm, whole @ turn[:rank].T, shapes])
        count, m, first = len(self.choice.nodes), shapes.shape[1], 1 + rank
        forms = np.empty((count, first + rank * (rank + 1) // 2))
        stretch, along = np.empty((count, m)), np.empty((count, m, first))
        i, j = np.tril_indices(rank)
        for members in alike([id(node.combination) for node in self.choice.nodes]):
            nodes = [self.choice.nodes[i] for i in members]
            gram, log_determinant = products([node.covariance for node in nodes], both)
            prior = np.array([node.log_prior for node in nodes])
            forms[members, 0] = gram[:, 0, 0] + log_determinant - 2.0 * prior
            forms[members, 1:first] = -2.0 * gram[:, 0, 1:first]
            forms[members, first:] = gram[:, 1 + i, 1 + j] * np.where(i == j, 1.0, 2.0)
            stretch[members], own = np.linalg.eigh(gram[:, first:, first:])
            along[members] = own.transpose(0, 2, 1) @ gram[:, first:, :first]
        along[:, :, 1:] *= -1.0  # what a curve moves by is less residual
        self._forms, self._stretch = -0.5 * forms.T, stretch.T
        self._along = np.ascontiguousarray(along.transpose(1, 2, 0))

    def _density(self, at: Array, more: Array) -> Array:
        i, j = np.tril_indices(at.shape[1])
        features = np.column_stack([np.ones(len(at)), at, at[:, i] * at[:, j]])
        each = features @ self._forms
        if more.any():
            # Woodbury's identity and the determinant's lemma, shape by shape
            volume, line = np.ones(each.shape), features[:, : 1 + at.shape[1]]
            for stretch, along in zip(self._stretch, self._along, strict=True):
                longer = 1.0 + more[:, None] * stretch
                volume *= longer
                each += 0.5 * more[:, None] * np.square(line @ along) / longer
            each -= 0.5 * np.log(volume)
        return log_sum_exp(each)
