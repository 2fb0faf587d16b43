"""The design of a mixed model: which rows share which levels, and what they tell of each effect.

statsmodels' MixedLM forms one dense matrix for crossed effects; here effects are worked out block
by block (a block is a person), so that cost grows with the number of curves and not with its cube.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from skinlab.studies.settings import COMPONENTS

Array = NDArray[np.float64]
Codes = NDArray[np.intp]

WITHIN = "within"
_TINY = 1e-9


@dataclass(frozen=True)
class Effect:
    """A random effect: the level (n,) of each row."""

    name: str
    codes: Codes

    @property
    def levels(self) -> int:
        """Number of levels."""
        return int(self.codes.max(initial=-1)) + 1


def effect(name: str, *labels: Sequence[object] | NDArray[np.generic]) -> Effect:
    """Return the effect whose levels are the combinations of these labels (n,)."""
    codes = np.zeros(len(labels[0]), dtype=np.intp)
    for one in labels:
        _, found = np.unique(np.asarray(one).astype(str), return_inverse=True)
        codes = codes * (int(found.max(initial=0)) + 1) + found.ravel()
        _, codes = np.unique(codes, return_inverse=True)
    return Effect(name, codes.ravel().astype(np.intp))


@dataclass(frozen=True, eq=False)
class Projection:
    """Onto the columns of some effects: a basis of each block, and one (n, r) across blocks."""

    bases: Sequence[Array]
    across: Array
    rows: Sequence[Codes]

    @property
    def rank(self) -> int:
        """Dimension of the space."""
        return int(sum(b.shape[1] for b in self.bases) + self.across.shape[1])

    def squares(self, y: Array) -> float:
        """Return the squared length of the projection of y (n,)."""
        inside = sum(
            float(np.square(b.T @ y[rows]).sum())
            for b, rows in zip(self.bases, self.rows, strict=True)
        )
        return inside + float(np.square(self.across.T @ y).sum())

    def trace(self, codes: Codes) -> float:
        """Return the trace of P Z Z' where Z is that of these levels (n,)."""
        total = 0.0
        for b, rows in zip(self.bases, self.rows, strict=True):
            if b.shape[1]:
                total += float(np.square(_sums(b, codes[rows])).sum())
        return total + float(np.square(_sums(self.across, codes)).sum())


def _sums(columns: Array, codes: Codes) -> Array:
    """Return the sums of rows (n, r) by level."""
    if not columns.shape[1]:
        return np.zeros((1, 0))
    order = np.argsort(codes, kind="stable")
    starts = np.flatnonzero(np.diff(codes[order], prepend=-1))
    return np.asarray(np.add.reduceat(columns[order], starts, axis=0))


class Design:
    """Which rows share which levels; all that does not depend on the values."""

    def __init__(self, X: Array, effects: Sequence[Effect], notes: Sequence[str] = ()) -> None:
        self.X = X
        self.effects = tuple(effects)
        self.notes = tuple(notes)
        n = len(X)
        blocks = self.effects[0].codes if self.effects else np.arange(n)
        self._rows: list[Codes] = [
            np.asarray(r, dtype=np.intp)
            for r in np.split(
                np.argsort(blocks, kind="stable"), np.cumsum(np.bincount(blocks))[:-1]
            )
        ]
        largest = max(len(r) for r in self._rows)
        if largest > COMPONENTS.largest_block:
            raise ValueError(
                f"{largest} curves of one {self.effects[0].name}; expected at most "
                f"{COMPONENTS.largest_block}"
            )
        self._local = [_nested(e.codes, blocks) for e in self.effects]
        self._projections: dict[frozenset[int], Projection] = {}

    @classmethod
    def of(cls, X: Array, effects: Sequence[Effect]) -> Design:
        """Return the design of effects that have something to tell: two levels, and not all one."""
        kept: list[Effect] = []
        notes: list[str] = []
        for one in effects:
            if one.levels < 2:
                continue
            same = next(
                (k for k in kept if _nested(k.codes, one.codes) and _nested(one.codes, k.codes)),
                None,
            )
            if same is not None:
                notes.append(
                    f"{one.name} cannot be separated from {same.name}: wherever one changes, so "
                    "does the other"
                )
            elif one.levels == len(X):
                notes.append(f"{one.name} cannot be separated from {WITHIN}: each has one curve")
            else:
                kept.append(one)
        return cls(X, kept, notes)

    def without(self, lost: Effect, why: str) -> Design:
        """Return the design without an effect."""
        return Design(self.X, [e for e in self.effects if e is not lost], (*self.notes, why))

    def lost(self) -> tuple[Effect, str] | None:
        """Return an effect that no degree of freedom tells, with a sentence; None where all are."""
        for one in reversed(self.effects):
            if self.freedom(one.name) < 1:
                return one, (
                    f"{one.name} cannot be estimated: nothing varies with it alone in this design"
                )
        return None

    # ---- sums of squares --------------------------------------------------------------------

    def projection(self, chosen: frozenset[int]) -> Projection:
        """Return the projection onto the fixed effects and these."""
        if chosen not in self._projections:
            local = [self.effects[k].codes for k in sorted(chosen) if self._local[k]]
            across = [self.X] + [
                np.eye(self.effects[k].levels)[self.effects[k].codes]
                for k in sorted(chosen)
                if not self._local[k]
            ]
            bases = [_basis_of_levels([c[rows] for c in local], len(rows)) for rows in self._rows]
            rest = np.hstack(across)
            if local:
                for b, rows in zip(bases, self._rows, strict=True):
                    rest[rows] -= b @ (b.T @ rest[rows])
            self._projections[chosen] = Projection(bases, _basis(rest), self._rows)
        return self._projections[chosen]

    def _pair(self, name: str) -> tuple[Projection | None, Projection]:
        """Return the projections whose difference is an effect's own space.

        None is that onto everything: the effect is the residual.
        """
        if name == WITHIN:
            return None, self.projection(frozenset(range(len(self.effects))))
        k = next(i for i, e in enumerate(self.effects) if e.name == name)
        own = self.effects[k].codes
        # What is nested in the effect would take all of it away.
        others = frozenset(
            i for i, e in enumerate(self.effects) if i != k and not _nested(e.codes, own)
        )
        return self.projection(others | {k}), self.projection(others)

    def freedom(self, name: str) -> int:
        """Return the degrees of freedom of an effect's own sum of squares."""
        whole, less = self._pair(name)
        return (len(self.X) if whole is None else whole.rank) - less.rank

    @cached_property
    def _expected(self) -> tuple[Array, Array]:
        """Coefficients (q, q) of the components in the mean squares, and the freedoms (q,)."""
        names = [*(e.name for e in self.effects), WITHIN]
        table = np.ones((len(names), len(names)))
        freedom = np.array([self.freedom(name) for name in names], dtype=float)
        for i, name in enumerate(names):
            whole, less = self._pair(name)
            for j, other in enumerate(self.effects):
                of_all = len(self.X) if whole is None else whole.trace(other.codes)
                table[i, j] = max(of_all - less.trace(other.codes), 0.0) / freedom[i]
        table[np.abs(table) < _TINY] = 0.0
        return table, freedom

    def mean_squares(self, y: Array) -> tuple[Array, Array]:
        """Return the mean squares (q,), that within last, and what solves them (q, q)."""
        table, freedom = self._expected
        squares = np.empty(len(freedom))
        for i, name in enumerate([*(e.name for e in self.effects), WITHIN]):
            whole, less = self._pair(name)
            of_all = float(y @ y) if whole is None else whole.squares(y)
            squares[i] = max(of_all - less.squares(y), 0.0) / freedom[i]
        return squares, np.asarray(np.linalg.inv(table))

    def draws(self, y: Array, rng: np.random.Generator) -> Array:
        """Return draws (m, q) of the variances, that within last."""
        squares, mixture = self.mean_squares(y)
        freedom = self._expected[1]
        seen = np.maximum(squares, _TINY)  # of values whose own variance is 1
        drawn = seen * freedom / rng.chisquare(freedom, (COMPONENTS.draws, len(freedom)))
        for k in reversed(range(len(squares))):
            # Where nearly all draws are below zero its mean square is taken for as much larger as
            # some need to be above: the upper end, which is theirs, is at its limit there.
            own = mixture[k, k] * drawn[:, k]
            if mixture[k, k] > 0:
                factor = np.quantile((own - drawn @ mixture[k]) / own, COMPONENTS.seen)
                drawn[:, k] *= max(float(factor), 1.0)
        return np.asarray(drawn @ mixture.T)

    # ---- restricted maximum likelihood ------------------------------------------------------

    def reml(self, y: Array) -> tuple[Array, Array]:
        """Return the variances (q,), that within last, and the fixed effects (p,)."""
        problem = _Reml(self, y)
        squares, mixture = self.mean_squares(y)
        moments = np.maximum(mixture @ squares, 0.0)
        starts = [np.full(len(self.effects), 0.5)]
        if moments[-1] > 0:
            starts.insert(0, np.sqrt(moments[:-1] / moments[-1]))
        best, least = starts[0], np.inf
        for start in starts:
            found = minimize(
                problem,
                np.clip(start, 0.02, COMPONENTS.most_ratio),
                jac=True,
                method="L-BFGS-B",
                bounds=[(0.0, COMPONENTS.most_ratio)] * len(start),
                options={"ftol": 1e-13, "gtol": 1e-7, "maxiter": 500},
            )
            if found.fun < least:
                best, least = np.asarray(found.x, dtype=float), float(found.fun)
        within, b = problem.solved(best)
        return np.asarray(np.append(within * np.square(best), within)), b


class _Reml:
    """Minus twice the profiled restricted likelihood, of ratios of deviations to that within.

    Blocks are padded to one size and worked out together; what crosses blocks comes in by
    Woodbury's identity.
    """

    def __init__(self, design: Design, y: Array) -> None:
        rows = design._rows
        size = max(len(r) for r in rows)
        self._n, self._p = design.X.shape
        local = [k for k, is_local in enumerate(design._local) if is_local]
        across = [k for k, is_local in enumerate(design._local) if not is_local]
        self._local, self._across = local, across
        columns = [design.X] + [
            np.eye(design.effects[k].levels)[design.effects[k].codes] for k in across
        ]
        self._which = np.concatenate(
            [np.full(design.effects[k].levels, k) for k in across] or [np.empty(0)]
        ).astype(int)
        right = np.column_stack([columns[0], y, *columns[1:]])
        self._right = np.zeros((len(rows), size, right.shape[1]))
        self._same = np.zeros((len(local), len(rows), size, size))
        for b, r in enumerate(rows):
            self._right[b, : len(r)] = right[r]
            for i, k in enumerate(local):
                codes = design.effects[k].codes[r]
                self._same[i, b, : len(r), : len(r)] = codes[:, None] == codes[None]
        self._eye = np.eye(size)

    def _parts(self, ratio: Array) -> tuple[Array, Array, Array, float, Array, Array, Array]:
        squares = np.square(ratio[self._local])
        V = self._eye + np.tensordot(squares, self._same, axes=1)
        root = np.linalg.cholesky(V)
        inverse = np.linalg.solve(V, self._right)
        M = np.einsum("bmi,bmj->ij", self._right, inverse)
        log_det = 2.0 * float(np.log(np.einsum("bmm->bm", root)).sum())
        f, d = self._p + 1, ratio[self._which]
        inner = np.eye(len(d)) + d[:, None] * M[f:, f:] * d
        C = d[:, None] * M[f:, :f]
        back = np.linalg.solve(inner, C)
        log_det += float(np.linalg.slogdet(inner)[1])
        return V, inverse, M, log_det, M[:f, :f] - C.T @ back, inner, back

    def __call__(self, ratio: Array) -> tuple[float, Array]:
        """Return the value and its gradient (effects,)."""
        V, inverse, M, log_det, H, inner, back = self._parts(ratio)
        p, n = self._p, self._n
        XX, Xy, yy = H[:p, :p], H[:p, p], H[p, p]
        b = np.linalg.solve(XX, Xy)
        rss = max(float(yy - Xy @ b), 1e-300)
        value = log_det + float(np.linalg.slogdet(XX)[1]) + (n - p) * np.log(rss)
        # With P = V^-1 - V^-1 X (X'V^-1 X)^-1 X'V^-1 the slope by a component's square is
        # tr(P Z Z') - (n - p) / rss |Z' P y|^2.
        f, d = p + 1, ratio[self._which]
        # Rows of the whole V^-1 [X y], the effects across blocks included.
        whole = inverse[:, :, :f] - inverse[:, :, f:] @ (d[:, None] * back)
        K = np.linalg.inv(inner)
        WX = whole[:, :, :p]
        Py = whole[:, :, p] - WX @ b
        XXi = np.linalg.inv(XX)
        gradient = np.zeros(len(ratio))
        if self._local:
            Vi = np.linalg.inv(V)
        for i, k in enumerate(self._local):
            same = self._same[i]
            trace = float(np.einsum("bij,bij->", Vi, same))
            if len(d):
                G = inverse[:, :, f:] * d
                trace -= float(np.einsum("bmi,ij,bnj,bmn->", G, K, G, same, optimize=True))
            trace -= float(np.einsum("bmi,ij,bnj,bmn->", WX, XXi, WX, same, optimize=True))
            fit = float(np.einsum("bm,bmn,bn->", Py, same, Py, optimize=True))
            gradient[k] = 2.0 * ratio[k] * (trace - (n - p) / rss * fit)
        if len(d):
            Z = self._right[:, :, f:]
            core = M[f:, f:] - (M[f:, f:] * d) @ K @ (d[:, None] * M[f:, f:])
            ZX = np.einsum("bmi,bmj->ij", Z, WX)
            diagonal = np.diag(core) - np.einsum("ij,jk,ik->i", ZX, XXi, ZX)
            ZPy = np.einsum("bmi,bm->i", Z, Py)
            each = diagonal - (n - p) / rss * np.square(ZPy)
            for k in self._across:
                gradient[k] = 2.0 * ratio[k] * float(each[self._which == k].sum())
        return value, gradient

    def solved(self, ratio: Array) -> tuple[float, Array]:
        """Return the variance within, and the fixed effects (p,)."""
        H = self._parts(ratio)[4]
        p = self._p
        b = np.asarray(np.linalg.solve(H[:p, :p], H[:p, p]), dtype=float)
        return float(H[p, p] - H[:p, p] @ b) / (self._n - p), b


def _nested(fine: Codes, coarse: Codes) -> bool:
    """Return whether every level of `fine` (n,) lies in one level of `coarse` (n,)."""
    first = np.full(int(fine.max(initial=0)) + 1, -1, dtype=np.intp)
    first[fine] = coarse
    return bool((first[fine] == coarse).all())


def _basis_of_levels(codes: Sequence[Codes], n: int) -> Array:
    """Return an orthonormal basis (n, r) of the indicators of these levels."""
    if not codes:
        return np.zeros((n, 0))
    finest = [
        c
        for k, c in enumerate(codes)
        if not any(
            _nested(o, c) and (not _nested(c, o) or i < k) for i, o in enumerate(codes) if i != k
        )
    ]
    columns = []
    for c in finest:
        _, found = np.unique(c, return_inverse=True)
        indicator = np.eye(int(found.max()) + 1)[found.ravel()]
        columns.append(indicator / np.sqrt(indicator.sum(axis=0)))
    if len(columns) == 1:
        return np.asarray(columns[0])
    return _basis(np.hstack(columns))


def _basis(columns: Array) -> Array:
    """Return an orthonormal basis (n, r) of columns (n, k)."""
    if not columns.size:
        return np.zeros((len(columns), 0))
    norms = np.linalg.norm(columns, axis=0)
    kept = columns[:, norms > 1e-8 * max(1.0, float(np.sqrt(len(columns))))]
    if not kept.size:
        return np.zeros((len(columns), 0))
    u, s, _ = np.linalg.svd(kept / np.linalg.norm(kept, axis=0), full_matrices=False)
    return np.asarray(u[:, s > 1e-7 * s[0]])
