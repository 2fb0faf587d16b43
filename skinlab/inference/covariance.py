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
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinlab.inference import bidiagonal

Array = NDArray[np.float64]

_AT_ONCE = 2_000_000  # numbers


@dataclass(frozen=True)
class OrnsteinUhlenbeck:
    """Errors with the covariance size² exp(−|t − t'|/time) within a curve."""

    size_mm: float
    time_s: float


@dataclass(frozen=True, eq=False)
class Covariance:
    """Σ over samples (u,) of one or several curves, end to end, times increasing in each.

    `variance_mm2` (u,) is D; V are `shapes_mm` (u, m), which covariances may share, times `scale`
    (m,), if there is one. `ends` are the ends of the curves; `time_s`
    (u,) is needed where there is an Ornstein-Uhlenbeck process.
    """

    variance_mm2: Array
    shapes_mm: Array
    ends: tuple[int, ...]
    ou: OrnsteinUhlenbeck | None = None
    time_s: Array | None = None
    scale: Array | None = None

    @cached_property
    def columns_mm(self) -> Array:
        """V (u, m): columns, each as large as its standard deviation."""
        return self.shapes_mm if self.scale is None else self.shapes_mm * self.scale

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
        return bidiagonal.factorise(diagonal, -phi[1:] * d[:-1])

    def whiten_without_columns(self, values_mm: Array) -> Array:
        """Return W r (u, …) with WᵀW = (D + B)⁻¹."""
        flat = values_mm.reshape(self.count, -1)
        if self.ou is None:
            return np.asarray((flat / self.sigma_mm[:, None]).reshape(values_mm.shape))
        rough = flat.copy()
        rough[1:] -= self._decay[1:, None] * flat[:-1]
        d, below = self._factor
        found = bidiagonal.solve(below, rough) / np.sqrt(d)[:, None]
        return np.asarray(found.reshape(values_mm.shape))

    def transposed_without_columns(self, white: Array) -> Array:
        """Return Wᵀ z (u, m) of the W of `whiten_without_columns`."""
        if self.ou is None:
            return white / self.sigma_mm[:, None]
        d, below = self._factor
        smooth = bidiagonal.solve(below, white / np.sqrt(d)[:, None], trans="T")
        found = smooth.copy()
        found[:-1] -= self._decay[1:, None] * smooth[1:]
        return found

    def _colour_without_columns(self, white: Array) -> Array:
        if self.ou is None:
            return white * self.sigma_mm[:, None]
        d, below = self._factor
        scaled = white * np.sqrt(d)[:, None]
        rough = scaled.copy()
        rough[1:] += below[:, None] * scaled[:-1]
        return bidiagonal.solve(-self._decay[1:], rough)

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
            shapes_mm=self.shapes_mm[kept],
            ends=tuple(int(c) for c in counts),
            time_s=None if self.time_s is None else self.time_s[kept],
        )

    def split(self, values: NDArray[Any]) -> list[NDArray[Any]]:
        """Return values (u, …) by curve."""
        return np.split(values, self.ends[:-1])


def gram_matrices(covariances: Sequence[Covariance], values_mm: Array) -> tuple[Array, Array]:
    """Return (W [values, V])ᵀ (W [values, V]) (n, m, m), and log |D + B| (n,), of many at once.

    W is that of `whiten_without_columns`. The covariances are of the same samples, have equally
    many columns, and all or none of them have a process. Their tridiagonal systems are solved end
    to end as one.

    Raises:
        numpy.linalg.LinAlgError: one is not positive definite.
    """
    leaders, scales = _scaled_alike(covariances)
    if len(leaders) < len(covariances):
        gram, log_base = gram_matrices([covariances[i] for i in leaders], values_mm)
        place = {leader: i for i, leader in enumerate(leaders)}
        which = [place[leader] for leader, _ in scales]
        whole = np.ones((len(covariances), gram.shape[1]))
        whole[:, values_mm.shape[1] :] = [scale for _, scale in scales]
        return gram[which] * whole[:, :, None] * whole[:, None, :], log_base[which]
    first, m = covariances[0], values_mm.shape[1]
    n, width = len(covariances), m + first.shapes_mm.shape[1]
    shapes = list({id(c.shapes_mm): c.shapes_mm for c in covariances}.values())
    whole, log_base = np.zeros((n, width, width)), np.zeros(n)
    for begin, end in pairwise((0, *first.ends)):
        if begin == end:
            continue
        here = slice(begin, end)
        # Most columns are of one curve or a few, and zero in the others.
        seen = np.logical_or.reduce([v[here].any(axis=0) for v in shapes])
        own, of = np.flatnonzero(values_mm[here].any(axis=0)), np.flatnonzero(seen)
        both = np.concatenate([own, m + of])
        at_once = max(1, _AT_ONCE // max((end - begin) * len(both), 1))
        for i in range(0, n, at_once):
            some = slice(i, i + at_once)
            gram, log_determinant = _gram(covariances[some], values_mm[here][:, own], of, here)
            whole[some, both[:, None], both] += gram
            log_base[some] += log_determinant
    return whole, log_base


def _gram(
    covariances: Sequence[Covariance], values_mm: Array, of: NDArray[np.intp], here: slice
) -> tuple[Array, Array]:
    """Return `gram_matrices` of one curve's samples and of these of the columns."""
    first = covariances[0]
    n, (u, m) = len(covariances), values_mm.shape
    both = np.empty((n, u, m + len(of)))
    both[:, :, :m] = values_mm
    for i, one in enumerate(covariances):
        both[i, :, m:] = one.shapes_mm[here][:, of]
        if one.scale is not None:
            both[i, :, m:] *= one.scale[of]
    d = np.array([one.variance_mm2[here] for one in covariances])
    if first.ou is not None:
        assert first.time_s is not None
        processes = [one.ou for one in covariances if one.ou is not None]
        squares = np.array([[ou.size_mm**2] for ou in processes])
        times = np.array([[ou.time_s] for ou in processes])
        phi = np.zeros((n, u))
        phi[:, 1:] = np.exp(-np.maximum(np.diff(first.time_s[here]), 0.0) / times)
        diagonal = d + squares * (1.0 - phi**2)
        diagonal[:, 1:] += phi[:, 1:] ** 2 * d[:, :-1]
        beside = np.zeros((n, u))
        beside[:, :-1] = -phi[:, 1:] * d[:, :-1]
        both[:, 1:] -= phi[:, 1:, None] * both[:, :-1]
        if n * u > 1:
            found, below = bidiagonal.factorise(diagonal.ravel(), beside.ravel()[:-1])
            both = bidiagonal.solve(below, both.reshape(n * u, -1)).reshape(n, u, -1)
            diagonal = found.reshape(n, u)
        d = diagonal
    both /= np.sqrt(d)[:, :, None]
    return both.transpose(0, 2, 1) @ both, np.log(d).sum(axis=1)


def _scaled_alike(covariances: Sequence[Covariance]) -> tuple[list[int], list[tuple[int, Array]]]:
    """Return which covariances to compute, and of each its leader and its columns' scales (m,).

    Where only the sizes of random effects differ, D + B is the same and the columns are the
    leader's, each longer or shorter.
    """
    known: dict[tuple[bytes, OrnsteinUhlenbeck | None, int], tuple[int, Array]] = {}
    largest: dict[int, Array] = {}  # of each column
    leaders, found = [], []
    for i, one in enumerate(covariances):
        shapes, m = one.shapes_mm, one.shapes_mm.shape[1]
        if one.scale is not None:
            if id(shapes) not in largest:
                rows = np.abs(shapes).argmax(axis=0) if len(shapes) else np.zeros(0, dtype=np.intp)
                largest[id(shapes)] = shapes[rows, np.arange(m)]
            mine = largest[id(shapes)] * one.scale
            key = (one.variance_mm2.tobytes(), one.ou, id(shapes))
            if key in known:
                leader, its = known[key]
                found.append((leader, mine / its))
                continue
            known[key] = i, np.where(mine == 0.0, 1.0, mine)
        leaders.append(i)
        found.append((i, np.ones(m)))
    return leaders, found


def products(covariances: Sequence[Covariance], values_mm: Array) -> tuple[Array, Array]:
    """Return rᵀ Σ⁻¹ r (n, m, m) of values (u, m), and the log determinants (n,) of Σ."""
    m = values_mm.shape[1]
    gram, log_base = gram_matrices(covariances, values_mm)
    root = np.linalg.cholesky(gram[:, m:, m:] + np.eye(gram.shape[1] - m))
    taken = np.linalg.solve(root, gram[:, m:, :m])
    log_inner = 2.0 * np.log(np.einsum("nii->ni", root)).sum(axis=1)
    return gram[:, :m, :m] - taken.transpose(0, 2, 1) @ taken, log_base + log_inner


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
