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
from skinlab.mechanics.fem import kernel

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_AT_ONCE = 2_000_000  # numbers
WORTH_SHARING = 10_000  # numbers: of fewer a product costs less than looking for what it shares


@dataclass(frozen=True)
class OrnsteinUhlenbeck:
    """Errors with the covariance size² exp(−|t − t'|/time) within a curve."""

    size_mm: float
    time_s: float


@dataclass(frozen=True, eq=False)
class Covariance:
    """Σ over samples (u,) of one or several curves, end to end, times increasing in each.

    `variance_mm2` (u,) is D; `shapes_mm` (u, m), each times its `sizes` (m,) if there are any, is
    V. `ends` are the ends of the curves; `time_s` (u,) is needed where there is an
    Ornstein-Uhlenbeck process.
    """

    variance_mm2: Array
    shapes_mm: Array
    ends: tuple[int, ...]
    ou: OrnsteinUhlenbeck | None = None
    time_s: Array | None = None
    sizes: Array | None = None

    @cached_property
    def columns_mm(self) -> Array:
        """V (u, m)."""
        return self.shapes_mm if self.sizes is None else self.shapes_mm * self.sizes

    @property
    def count(self) -> int:
        """Number of samples."""
        return len(self.variance_mm2)

    @property
    def sigma_mm(self) -> Array:
        """Standard deviations (u,) of D."""
        return np.asarray(np.sqrt(self.variance_mm2))

    @property
    def noise_um(self) -> float:
        """Root mean square of the errors, what samples have in common apart, µm."""
        process = 0.0 if self.ou is None else self.ou.size_mm
        return 1e3 * float(np.sqrt(np.mean(self.variance_mm2) + process**2))

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
    def _axes(self) -> tuple[Array, Array]:
        """Return a (u, m), the whitened columns turned until orthogonal, and their squares (m,).

        Every function of W V Vᵀ Wᵀ is a f aᵀ. The squares by the product of the columns: that is a
        fraction of the work of their singular values, and f hardly depends on a small one.
        """
        white = self.whiten_without_columns(self.columns_mm)
        square, turn = np.linalg.eigh(white.T @ white)
        return white @ turn, np.maximum(square, 0.0)

    def whiten(self, curves_mm: Array) -> Array:
        """Return W r (u, …) with WᵀW = Σ⁻¹: independent, of variance 1."""
        flat = self.whiten_without_columns(curves_mm).reshape(self.count, -1)
        a, square = self._axes
        root = np.sqrt(1.0 + square)
        # (1/root − 1)/square. Of few curves flat.T @ a takes half as long as a.T @ flat.
        flat = flat - a @ ((flat.T @ a) / (root * (1.0 + root))).T
        return np.asarray(flat.reshape(curves_mm.shape))

    __call__ = whiten

    def colour(self, white: Array) -> Array:
        """Return what `whiten` made these (u, …) from, mm."""
        flat = white.reshape(self.count, -1)
        a, square = self._axes
        flat = flat + a @ ((a.T @ flat) / (1.0 + np.sqrt(1.0 + square))[:, None])
        return np.asarray(self._colour_without_columns(flat).reshape(white.shape))

    @property
    def log_determinant(self) -> float:
        """Log determinant of Σ, of mm²."""
        return self.log_determinant_without_columns + float(np.log1p(self._axes[1]).sum())

    def log_density(self, residuals_mm: Array) -> float:
        """Return the Gaussian log density of residuals (u,), per mm."""
        z = self.whiten(residuals_mm)
        return -0.5 * float(z @ z + self.log_determinant + self.count * np.log(2.0 * np.pi))

    def without_columns(self, residuals_mm: Array) -> Array:
        """Return residuals (u, …) in standard deviations, less what V's columns probably did."""
        z = self.whiten_without_columns(residuals_mm).reshape(self.count, -1)
        a, square = self._axes
        left = z - a @ ((a.T @ z) / (1.0 + square)[:, None])
        return np.asarray(left.reshape(residuals_mm.shape))

    def expected_product(self, apart: int) -> float:
        """Return what Σ itself lets the products of `without_columns` sum up to.

        Of values so many samples apart in the same curve: taking the columns off leaves some less
        than none, Cov = 1 − a aᵀ/(1 + a²).
        """
        if apart not in self._expected:
            a, square = self._axes
            share = 1.0 / (1.0 + square)
            self._expected[apart] = -sum(
                float(np.einsum("um,um,m->", v[apart:], v[:-apart], share)) for v in self.split(a)
            )
        return self._expected[apart]

    @cached_property
    def _expected(self) -> dict[int, float]:
        """What `expected_product` has found."""
        return {}

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
    many columns, and all or none of them have a process.

    Raises:
        numpy.linalg.LinAlgError: one is not positive definite.
    """
    return _summed(covariances, values_mm, np.ones(covariances[0].shapes_mm.shape[1], dtype=bool))


def integrated_gram_matrices(
    covariances: Sequence[Covariance], values_mm: Array
) -> tuple[Array, Array]:
    """Return `gram_matrices` of the values and of the columns that several curves have.

    What a curve has alone (a zero, a walk) is integrated out, exactly, curve by curve: that is far
    less work than with all of them together. The log determinants (n,) are with it.

    Raises:
        numpy.linalg.LinAlgError: one is not positive definite.
    """
    first = covariances[0]
    if len(first.ends) == 1:
        return gram_matrices(covariances, values_mm)
    shapes = list({id(c.shapes_mm): c.shapes_mm for c in covariances}.values())
    begins = [begin for begin, end in pairwise((0, *first.ends)) if begin < end]
    curves = [np.logical_or.reduceat(v != 0.0, begins, axis=0) for v in shapes]
    return _summed(covariances, values_mm, np.logical_or.reduce(curves).sum(axis=0) > 1)


def _summed(
    covariances: Sequence[Covariance], values_mm: Array, kept: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Return the Gram matrices summed up over curves, of all values and the columns kept (m,).

    The others are integrated out: each is of one curve. Where only the sizes of random effects
    differ, D + B and the shapes are the same: what these give is found once. Most columns are of
    one curve, and zero in the others.
    """
    m = values_mm.shape[1]
    different, which = _different(covariances)
    place = np.concatenate([np.arange(m), np.where(kept, m - 1 + np.cumsum(kept), -1)])
    sizes = None
    if any(one.sizes is not None for one in covariances):
        ones = np.ones(len(kept))
        sizes = np.array([ones if one.sizes is None else one.sizes for one in covariances])
    parts = kernel.Grams(
        values_mm,
        different[0].ends,
        [one.shapes_mm for one in different],
        np.array([one.variance_mm2 for one in different]),
        *_processes(different),
        which,
        sizes,
        place,
    )
    width = m + int(kept.sum())
    whole, log_base = np.zeros((len(covariances), width, width)), np.zeros(len(covariances))
    fine = kernel.grams(parts, whole, log_base)
    if fine is None:
        fine = _add(parts, whole, log_base)
    if not fine:
        raise np.linalg.LinAlgError("the covariance of the errors is not positive definite")
    return whole, log_base


def _add(parts: kernel.Grams, whole: Array, log_base: Array) -> bool:
    """Do what the compiled kernel does; an error of LAPACK's stands for some of its failures."""
    for begin, end in pairwise((0, *parts.ends)):
        curve = slice(begin, end)
        at_once = max(1, _AT_ONCE // max((end - begin) * len(parts.place), 1))
        for i in range(0, len(parts.shapes) if begin < end else 0, at_once):
            some = slice(i, i + at_once)
            own = {id(v): v[curve] for v in parts.shapes[some]}
            several = {key: np.hstack([parts.values[curve], v]) for key, v in own.items()}
            nonzero = [(v != 0.0).any(axis=0) for v in several.values()]
            here = np.flatnonzero(np.logical_or.reduce(nonzero))
            x = np.array([several[id(v)].take(here, axis=1) for v in parts.shapes[some]])
            square = None if parts.square is None else parts.square[some]
            decay = None if parts.decay is None else parts.decay[some, curve]
            white, d = _whiten(x, parts.variance[some, curve], square, decay)
            if not (d > 0.0).all():
                return False
            members = np.flatnonzero((i <= parts.which) & (parts.which < i + at_once))
            which, at = parts.which[members] - i, parts.place[here]
            gram = (white.transpose(0, 2, 1) @ white)[which]
            if parts.sizes is not None:
                sizes = np.ones((len(members), len(parts.place)))
                sizes[:, parts.values.shape[1] :] = parts.sizes[members]
                gram *= sizes[:, here, None] * sizes[:, None, here]
            alone, rest = np.flatnonzero(at < 0), np.flatnonzero(at >= 0)
            root = np.linalg.cholesky(gram[:, alone[:, None], alone] + np.eye(len(alone)))
            taken = np.linalg.solve(root, gram[:, alone[:, None], rest])
            left = gram[:, rest[:, None], rest] - taken.transpose(0, 2, 1) @ taken
            whole[np.ix_(members, at[rest], at[rest])] += left
            log_base[members] += np.log(d).sum(axis=1)[which]
            log_base[members] += 2.0 * np.log(np.einsum("nii->ni", root)).sum(axis=1)
    return True


def _whiten(
    both: Array, d: Array, square: Array | None, decay: Array | None
) -> tuple[Array, Array]:
    """Return W r of one curve's values (n, u, m), and the pivots (n, u), of many at once.

    Their tridiagonal systems are solved end to end as one.
    """
    n, u = d.shape
    if square is not None and decay is not None:
        diagonal = d + square[:, None] * (1.0 - decay**2)
        diagonal[:, 1:] += decay[:, 1:] ** 2 * d[:, :-1]
        beside = np.zeros((n, u))
        beside[:, :-1] = -decay[:, 1:] * d[:, :-1]
        both[:, 1:] -= decay[:, 1:, None] * both[:, :-1]
        if n * u > 1:
            found, below = bidiagonal.factorise(diagonal.ravel(), beside.ravel()[:-1])
            both = bidiagonal.solve(below, both.reshape(n * u, -1)).reshape(n, u, -1)
            diagonal = found.reshape(n, u)
        d = diagonal
    return both / np.sqrt(np.where(d > 0.0, d, 1.0))[:, :, None], d


def _different(covariances: Sequence[Covariance]) -> tuple[Sequence[Covariance], Index]:
    """Return those that differ in more than sizes, and which of them each is."""
    if covariances[0].shapes_mm.size <= WORTH_SHARING:
        return covariances, np.arange(len(covariances))
    place: dict[tuple[bytes, OrnsteinUhlenbeck | None, int], int] = {}
    different: list[Covariance] = []
    which = []
    for one in covariances:
        key = (one.variance_mm2.tobytes(), one.ou, id(one.shapes_mm))
        if key not in place:
            place[key] = len(different)
            different.append(one)
        which.append(place[key])
    return different, np.array(which)


def _processes(covariances: Sequence[Covariance]) -> tuple[Array | None, Array | None]:
    """Return the variances (n,) of Ornstein-Uhlenbeck processes, and their φ (n, u), if any."""
    first = covariances[0]
    if first.ou is None:
        return None, None
    assert first.time_s is not None
    processes = [one.ou for one in covariances if one.ou is not None]
    times = np.array([[ou.time_s] for ou in processes])
    decay = np.zeros((len(covariances), first.count))
    decay[:, 1:] = np.exp(-np.maximum(np.diff(first.time_s), 0.0) / times)
    decay[:, [end for end in first.ends if end < first.count]] = 0.0
    return np.array([ou.size_mm**2 for ou in processes]), decay


def products(covariances: Sequence[Covariance], values_mm: Array) -> tuple[Array, Array]:
    """Return rᵀ Σ⁻¹ r (n, m, m) of values (u, m), and the log determinants (n,) of Σ."""
    return products_of(*integrated_gram_matrices(covariances, values_mm), values_mm.shape[1])


def products_of(gram: Array, log_base: Array, m: int) -> tuple[Array, Array]:
    """Return `products` of the first m columns out of `gram_matrices`."""
    root = np.linalg.cholesky(gram[:, m:, m:] + np.eye(gram.shape[1] - m))
    taken = np.linalg.solve(root, gram[:, m:, :m])
    log_inner = 2.0 * np.log(np.einsum("nii->ni", root)).sum(axis=1)
    return gram[:, :m, :m] - taken.transpose(0, 2, 1) @ taken, log_base + log_inner


def block_diagonal(blocks: Sequence[Array]) -> Array:
    """Return the matrix with these (u, m) along its diagonal."""
    if len(blocks) == 1:
        return blocks[0]
    whole = np.zeros((sum(len(b) for b in blocks), sum(b.shape[1] for b in blocks)))
    row = column = 0
    for b in blocks:
        whole[row : row + len(b), column : column + b.shape[1]] = b
        row, column = row + len(b), column + b.shape[1]
    return whole


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
