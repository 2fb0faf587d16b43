"""The likelihood of errors' parameters, with the skin's unknowns integrated out.

Near a fit the model is linear: r = J δ + e, with a Gaussian (all but flat) prior of δ. Integrating
δ and the columns of V out leaves a marginal likelihood of the covariance's own parameters, as in
restricted maximum likelihood (Patterson and Thompson 1971, Biometrika 58:545).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.covariance import (
    Covariance,
    gram_matrices,
    integrated_gram_matrices,
)

Array = NDArray[np.float64]

_LOG_2PI = float(np.log(2.0 * np.pi))
_DENSE = 250  # samples of which a dense inverse is kept at once,
_MARGIN = 50  # and how many beside them it is taken of: what is farther says nothing


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Residuals (u,) of a fit, slopes (u, k) of its model, and the prior precision (k, k) of δ."""

    residual_mm: Array
    slopes_mm: Array
    precision: Array

    @cached_property
    def _log_prior(self) -> float:
        return float(np.linalg.slogdet(self.precision)[1]) if len(self.precision) else 0.0

    def log_marginals(self, covariances: Sequence[Covariance]) -> Array:
        """Return log p(r) (n,) with δ and the covariances' columns integrated out.

        −∞ where one is not positive definite. They are alike, as `gram_matrices` has it.
        """
        values = np.column_stack([self.residual_mm, self.slopes_mm])
        try:
            gram, log_base = integrated_gram_matrices(covariances, values)
            # With the residual in the last row the factor's tells χ², without solving for it. One
            # more, since χ² may be none: of a curve that the model meets exactly.
            self._information(gram)
            gram[:, 0, 0] += 1.0
            root = np.linalg.cholesky(gram[:, ::-1, ::-1])
        except np.linalg.LinAlgError:
            if len(covariances) == 1:
                return np.array([-np.inf])
            return np.concatenate([self.log_marginals([one]) for one in covariances])
        diagonal = np.einsum("nii->ni", root)
        chi2 = np.square(diagonal[:, -1]) - 1.0
        log_det = 2.0 * np.log(diagonal[:, :-1]).sum(axis=1)
        u = len(self.residual_mm)
        return np.asarray(-0.5 * (u * _LOG_2PI + log_base + log_det - self._log_prior + chi2))

    def _information(self, gram: Array) -> Array:
        """Return that of the effects (…, k + m, k + m), in place of their Gram matrices.

        They stand behind the residual's row and column, which stay.
        """
        k = self.slopes_mm.shape[1]
        found = gram[..., 1:, 1:]
        found[..., :k, :k] += self.precision
        rest = np.arange(k, found.shape[-1])
        found[..., rest, rest] += 1.0
        return found

    def shares(self, covariance: Covariance, pull: Array | float = 0.0) -> Array:
        """Return what each of the covariance's columns probably did (u, m), mm.

        `pull` (k,) is that of priors whose means are not at the fit.
        """
        columns, k = covariance.columns_mm, self.slopes_mm.shape[1]
        values = np.column_stack([self.residual_mm, self.slopes_mm, columns])
        white = covariance.whiten_without_columns(values)
        gram = white.T @ white
        right = gram[1:, 0].copy()
        right[:k] -= pull
        return np.asarray(columns * np.linalg.solve(self._information(gram), right)[k:])

    def left_out(self, covariance: Covariance) -> tuple[Array, Array]:
        """Return each sample's deviation (u,) from what all others predict, and its variance.

        r_i − E(r_i | the others) = (S⁻¹ r)_i / (S⁻¹)_ii with S all of the covariance, that of the
        unknowns included.
        """
        score, diagonal = self.scores(covariance)
        return score / diagonal, 1.0 / diagonal

    def scores(self, covariance: Covariance) -> tuple[Array, Array]:
        """Return S⁻¹ r (u,) and the diagonal (u,) of S⁻¹."""
        values = np.column_stack([self.residual_mm, self.slopes_mm])
        gram = gram_matrices([covariance], values)[0][0]
        whole = self._information(gram)
        effects = np.column_stack([self.slopes_mm, covariance.columns_mm])
        shift = np.linalg.solve(whole, gram[1:, 0])
        inner = _inverse_times(covariance, np.column_stack([self.residual_mm, effects]))
        score = inner[:, 0] - inner[:, 1:] @ shift
        taken = (inner[:, 1:] @ np.linalg.inv(whole) * inner[:, 1:]).sum(axis=1)
        diagonal = _inverse_diagonal(covariance) - taken
        return score, np.maximum(diagonal, 1e-12 * diagonal.max())

    def white_square(self, covariance: Covariance) -> Array:
        """Return E e² (u,) of the independent part of the errors, in its own variances."""
        score, diagonal = self.scores(covariance)
        d = covariance.variance_mm2
        return np.asarray(d * score**2 + 1.0 - d * diagonal)


def _inverse_times(covariance: Covariance, values: Array) -> Array:
    """Return (D + B)⁻¹ r (u, m): the whitening, and its transpose by turning time around."""
    if covariance.ou is None:
        return np.asarray(values / covariance.variance_mm2[:, None])
    return covariance.transposed_without_columns(covariance.whiten_without_columns(values))


def _inverse_diagonal(covariance: Covariance) -> Array:
    """Return the diagonal (u,) of (D + B)⁻¹; piece by piece, since what is far says nothing."""
    if covariance.ou is None:
        return 1.0 / covariance.variance_mm2
    count, found = covariance.count, np.empty(covariance.count)
    for begin in range(0, count, _DENSE):
        end = min(begin + _DENSE, count)
        first = max(begin - _MARGIN, 0)
        here = np.zeros(count, dtype=bool)
        here[first : end + _MARGIN] = True
        part = covariance.only(here)
        ones = np.eye(part.count)[:, begin - first : end - first]
        found[begin:end] = np.square(part.whiten_without_columns(ones)).sum(axis=0)
    return found
