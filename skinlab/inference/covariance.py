"""The covariance of the errors of samples, Σ = D + B + V Vᵀ, without n³ and without n² memory.

D: independent errors. B: an Ornstein-Uhlenbeck process in time, which begins anew with every curve.
V: columns, each as large as its standard deviation, in which all samples err together (the mesh's
shapes, breathing, how the probe was put on).

An Ornstein-Uhlenbeck process is Markovian: with φᵢ = exp(−Δtᵢ/τ) the differences rᵢ − φᵢ rᵢ₋₁ of
D + B have a tridiagonal covariance, for uneven times too. Its bidiagonal factor whitens in O(n).
V is added by Woodbury's identity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpttrf, dtbtrs

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OrnsteinUhlenbeck:
    """Errors with the covariance size² exp(−|t − t'|/time) within a curve."""

    size_mm: float
    time_s: float


@dataclass(frozen=True, eq=False)
class Covariance:
    """Σ over samples (u,) of one or several curves, end to end, times increasing in each.

    `variance_mm2` (u,) is D, `columns_mm` (u, m) V. `ends` are the ends of the curves; `time_s`
    (u,) is needed where there is an Ornstein-Uhlenbeck process.
    """

    variance_mm2: Array
    columns_mm: Array
    ends: tuple[int, ...]
    ou: OrnsteinUhlenbeck | None = None
    time_s: Array | None = None

    @property
    def count(self) -> int:
        """Number of samples."""
        return len(self.variance_mm2)

    @property
    def sigma_mm(self) -> Array:
        """Standard deviations (u,) of D."""
        return np.asarray(np.sqrt(self.variance_mm2))

    @property
    def total_sd_mm(self) -> Array:
        """Standard deviations (u,) of single samples, all parts together."""
        process = 0.0 if self.ou is None else self.ou.size_mm**2
        squares = np.square(self.columns_mm).sum(axis=1)
        return np.asarray(np.sqrt(self.variance_mm2 + process + squares))

    @cached_property
    def _decay(self) -> Array:
        """Return φ (u,), 0 where a curve begins."""
        assert self.ou is not None
        assert self.time_s is not None
        decay = np.zeros(self.count)
        decay[1:] = np.exp(-np.maximum(np.diff(self.time_s), 0.0) / self.ou.time_s)
        decay[[end for end in self.ends if end < self.count]] = 0.0
        return decay

    @cached_property
    def _factor(self) -> tuple[Array, Array]:
        """Return d (u,) and e (u − 1,): L diag(d) Lᵀ is the covariance of the differences."""
        assert self.ou is not None
        d, phi = self.variance_mm2, self._decay
        diagonal = d + self.ou.size_mm**2 * (1.0 - phi**2)
        diagonal[1:] += phi[1:] ** 2 * d[:-1]
        if self.count < 2:
            return diagonal, np.zeros(0)
        found, below, failed = dpttrf(diagonal, -phi[1:] * d[:-1])
        if failed:
            raise np.linalg.LinAlgError("the covariance of the errors is not positive definite")
        return found, below

    def whiten_without_columns(self, values_mm: Array) -> Array:
        """Return W r (u, …) with WᵀW = (D + B)⁻¹."""
        flat = values_mm.reshape(self.count, -1)
        if self.ou is None:
            return np.asarray((flat / self.sigma_mm[:, None]).reshape(values_mm.shape))
        rough = np.array(flat, order="F")
        rough[1:] -= self._decay[1:, None] * flat[:-1]
        d, below = self._factor
        found = _solve_bidiagonal(below, rough) / np.sqrt(d)[:, None]
        return np.asarray(found.reshape(values_mm.shape))

    def transposed_without_columns(self, white: Array) -> Array:
        """Return Wᵀ z (u, m) of the W of `whiten_without_columns`."""
        if self.ou is None:
            return white / self.sigma_mm[:, None]
        d, below = self._factor
        smooth = _solve_bidiagonal(below, np.asfortranarray(white / np.sqrt(d)[:, None]), trans="T")
        found = smooth.copy()
        found[:-1] -= self._decay[1:, None] * smooth[1:]
        return found

    def _colour_without_columns(self, white: Array) -> Array:
        if self.ou is None:
            return white * self.sigma_mm[:, None]
        d, below = self._factor
        scaled = white * np.sqrt(d)[:, None]
        rough = np.array(scaled, order="F")
        rough[1:] += below[:, None] * scaled[:-1]
        return _solve_bidiagonal(-self._decay[1:], rough)

    @cached_property
    def log_determinant_without_columns(self) -> float:
        """Log determinant of D + B."""
        return float(np.log(self.variance_mm2 if self.ou is None else self._factor[0]).sum())

    @cached_property
    def _columns(self) -> tuple[Array, Array]:
        """Return q (u, m), orthonormal, and s (m,) of the whitened columns."""
        white = self.whiten_without_columns(self.columns_mm)
        q, s, _ = np.linalg.svd(white, full_matrices=False)
        return q, s

    def whiten(self, curves_mm: Array) -> Array:
        """Return W r (u, …) with WᵀW = Σ⁻¹: independent, of variance 1."""
        flat = self.whiten_without_columns(curves_mm).reshape(self.count, -1)
        q, s = self._columns
        flat = flat + q @ ((1.0 / np.sqrt(1.0 + s**2) - 1.0)[:, None] * (q.T @ flat))
        return np.asarray(flat.reshape(curves_mm.shape))

    __call__ = whiten

    def colour(self, white: Array) -> Array:
        """Return what `whiten` made these (u, …) from, mm."""
        flat = white.reshape(self.count, -1)
        q, s = self._columns
        flat = flat + q @ ((np.sqrt(1.0 + s**2) - 1.0)[:, None] * (q.T @ flat))
        return np.asarray(self._colour_without_columns(flat).reshape(white.shape))

    @property
    def log_determinant(self) -> float:
        """Log determinant of Σ, of mm²."""
        return self.log_determinant_without_columns + float(np.log1p(self._columns[1] ** 2).sum())

    def products(self, values_mm: Array) -> tuple[Array, float]:
        """Return rᵀ Σ⁻¹ r (m, m) of values (u, m), and the log determinant of Σ.

        For a few values of many covariances: quicker than whitening.
        """
        m = values_mm.shape[1]
        white = self.whiten_without_columns(np.column_stack([values_mm, self.columns_mm]))
        gram = white.T @ white
        inner = gram[m:, m:] + np.eye(len(gram) - m)
        root = np.linalg.cholesky(inner)
        taken = np.linalg.solve(root, gram[m:, :m])
        log_inner = 2.0 * float(np.log(np.diag(root)).sum())
        return gram[:m, :m] - taken.T @ taken, self.log_determinant_without_columns + log_inner

    def log_density(self, residuals_mm: Array) -> float:
        """Return the Gaussian log density of residuals (u,), per mm."""
        z = self.whiten(residuals_mm)
        return -0.5 * float(z @ z + self.log_determinant + self.count * np.log(2.0 * np.pi))

    def sample(self, rng: np.random.Generator) -> Array:
        """Return errors (u,) drawn from N(0, Σ), mm."""
        return self.colour(rng.standard_normal(self.count))

    def without_columns(self, residuals_mm: Array) -> Array:
        """Return residuals (u,) in standard deviations, less what V's columns probably did."""
        z = self.whiten_without_columns(residuals_mm)
        q, s = self._columns
        return np.asarray(z - q @ (s**2 / (1.0 + s**2) * (q.T @ z)))

    def expected_product(self, apart: int) -> float:
        """Return what Σ itself lets the products of `without_columns` sum up to.

        Of values so many samples apart in the same curve: taking the columns off leaves some less
        than none, Cov = 1 − Q s²/(1+s²) Qᵀ.
        """
        q, s = self._columns
        share = s**2 / (1.0 + s**2)
        return -sum(
            float(np.einsum("um,um,m->", v[apart:], v[:-apart], share)) for v in self.split(q)
        )

    def only(self, kept: NDArray[np.bool_]) -> Covariance:
        """Return the covariance of some of the samples (u,) alone."""
        counts = np.cumsum([int(part.sum()) for part in self.split(kept)])
        return replace(
            self,
            variance_mm2=self.variance_mm2[kept],
            columns_mm=self.columns_mm[kept],
            ends=tuple(int(c) for c in counts),
            time_s=None if self.time_s is None else self.time_s[kept],
        )

    def split(self, values: NDArray[Any]) -> list[NDArray[Any]]:
        """Return values (u, …) by curve."""
        return np.split(values, self.ends[:-1])


def _solve_bidiagonal(below: Array, right: Array, trans: str = "N") -> Array:
    """Return x with x₀ = r₀ and xᵢ + belowᵢ₋₁ xᵢ₋₁ = rᵢ, for right sides (u, m).

    With `trans` "T" that of the transposed matrix.
    """
    if len(right) < 2 or not right.shape[1]:
        return right  # nothing to do, and LAPACK's wrapper does not bear it
    band = np.ones((2, len(right)))
    band[1, :-1] = below
    found, _ = dtbtrs(band, right, uplo="L", trans=trans, diag="U")
    return np.asarray(found)


def independent(sigma_mm: Array, columns_mm: Array | Sequence[Array] | None = None) -> Covariance:
    """Return the covariance of independent errors (u,) and a few common columns (u, m)."""
    columns = np.zeros((len(sigma_mm), 0)) if columns_mm is None else np.asarray(columns_mm)
    return Covariance(np.square(sigma_mm), columns, (len(sigma_mm),))


@dataclass(frozen=True, eq=False)
class OnKept:
    """Whitening of curves (u, …) by the covariance of those samples that are kept."""

    kept: NDArray[np.bool_]
    covariance: Covariance

    def __call__(self, curves_mm: Array) -> Array:
        """Return W applied to what is kept."""
        return self.covariance.whiten(curves_mm[self.kept])
