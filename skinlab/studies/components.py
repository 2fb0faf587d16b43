"""Components of variance: what share of the scatter is people, sites, visits, operators, probes.

The model is y = X b + sum over effects of Z u + e with independent normal u and e. Values are of
restricted maximum likelihood (Patterson and Thompson 1971), as statsmodels and lme4 give them.

Intervals: each effect has a mean square, adjusted for all effects that are not nested in it, whose
expectation is a known mixture of the components. For single components, shares and ICC the mean
squares are drawn from their chi-squares and the mixture is solved, many times: generalised
confidence intervals (Weerahandi 1993; Burdick, Borror and Montgomery 2005). Two probes that agree
by luck would be given "0 to 0", as if they could not differ; so the upper end is taken among the
draws above zero (the CLs bound: Read 2002, J. Phys. G 28:2693), which is the usual end wherever a
component is seen. For sums of components, of which SEM and MDC are the root, these are too high
where one part is poorly known; there it is the modified large-sample interval (Ting, Burdick,
Graybill, Jeyaratnam and Lu 1990). Both hold with two operators as well, where the profile of the
likelihood and a bootstrap do not.

statsmodels' MixedLM forms one dense matrix for crossed effects and gives no intervals of variances;
here effects are worked out block by block (a block is a person), so that cost grows with the number
of curves and not with its cube.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import chi2
from scipy.stats import f as f_distribution

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


@dataclass(frozen=True)
class Component:
    """A variance with its interval, and its share of the total."""

    name: str
    variance: float
    low: float
    high: float
    share: float
    share_low: float
    share_high: float
    levels: int
    freedom: int  # degrees of freedom that tell it


@dataclass(frozen=True, eq=False)
class Components:
    """What was found.

    `draws` (m, effects) are of all variances, in the order of `parts`; some are below zero, which
    only sums may make good.
    """

    parts: tuple[Component, ...]
    mean: float
    count: int
    draws: Array
    notes: tuple[str, ...]  # which effects cannot be told apart, and why
    squares: Array  # (effects,) mean squares, in the order of `parts`
    mixture: Array  # (effects, effects): solves these for the components

    def sum_interval(self, weights: Mapping[str, float]) -> tuple[float, float]:
        """Return the interval of a sum of weighted components; those not there count as zero."""
        w = np.array([weights.get(p.name, 0.0) for p in self.parts])
        freedom = np.array([p.freedom for p in self.parts], dtype=float)
        return _large_sample(w @ self.mixture, self.squares, freedom)

    def variance(self, names: Sequence[str]) -> float:
        """Return the sum of these components; those that are not there count as zero."""
        return float(sum(p.variance for p in self.parts if p.name in names))

    def drawn(self, names: Sequence[str]) -> Array:
        """Return the draws (m,) of that sum."""
        chosen = [k for k, p in enumerate(self.parts) if p.name in names]
        return np.asarray(np.maximum(self.draws[:, chosen].sum(axis=1), 0.0))

    def has(self, name: str) -> bool:
        """Return whether the component could be estimated."""
        return any(p.name == name for p in self.parts)


def effect(name: str, *labels: Sequence[object] | NDArray[np.generic]) -> Effect:
    """Return the effect whose levels are the combinations of these labels (n,)."""
    codes = np.zeros(len(labels[0]), dtype=np.intp)
    for one in labels:
        _, found = np.unique(np.asarray(one).astype(str), return_inverse=True)
        codes = codes * (int(found.max(initial=0)) + 1) + found.ravel()
        _, codes = np.unique(codes, return_inverse=True)
    return Effect(name, codes.ravel().astype(np.intp))


def components(
    values: Array,
    effects: Sequence[Effect],
    fixed: Array | None = None,
    *,
    seed: int = 0,
) -> Components:
    """Return the components of variance of values (n,).

    `fixed` (n, p) are columns of fixed effects besides the mean. The first effect should be the one
    inside of which the others mostly repeat: people.

    Raises:
        ValueError: fewer than three values, all the same, or a block too large.
    """
    n = len(values)
    if n < 3 or not np.ptp(values) > 0:
        raise ValueError("fewer than three values, or all the same")
    X = np.column_stack([np.ones(n), *([] if fixed is None else [fixed])])
    design = Design.of(X, effects)
    while True:
        lost = design.lost()
        if lost is None:
            break
        design = design.without(*lost)
    if design.freedom(WITHIN) < 1:
        raise ValueError("there are not enough repeats to estimate any scatter")
    # In units of its own spread, so that no step of the search depends on the unit.
    scale = float(np.std(values))
    y = (values - values.mean()) / scale
    found, b = design.reml(y)
    draws = design.draws(y, np.random.default_rng(seed))
    names = [*(e.name for e in design.effects), WITHIN]
    positive = np.maximum(draws, 0.0)
    total, totals = found.sum(), positive.sum(axis=1)
    parts = []
    for k, name in enumerate(names):
        low, high = interval(positive[:, k], float(found[k]))
        share = float(found[k] / total)
        share_low, share_high = interval(positive[:, k] / totals, share)
        parts.append(
            Component(
                name,
                float(found[k]) * scale**2,
                low * scale**2,
                high * scale**2,
                share,
                share_low,
                share_high,
                n if name == WITHIN else design.effects[k].levels,
                design.freedom(name),
            )
        )
    mean = float(values.mean() + scale * b[0])
    squares, mixture = design.mean_squares(y)
    return Components(
        tuple(parts), mean, n, draws * scale**2, design.notes, squares * scale**2, mixture
    )


def _large_sample(q: Array, squares: Array, freedom: Array) -> tuple[float, float]:
    """Return the interval of the sum of q times mean squares (k,); zero is its least end.

    Ting et al. 1990, J. Stat. Comput. Simul. 35:135, equations as in Burdick and Graybill 1992.
    """
    tail = (1 - COMPONENTS.level) / 2
    value = float(q @ squares)
    size = np.abs(q) * squares
    up, down = q > 0, q < 0
    low = high = 0.0
    G = 1.0 - freedom / chi2.ppf(1 - tail, freedom)
    H = freedom / chi2.ppf(tail, freedom) - 1.0
    low += float(np.square(G[up] * size[up]).sum() + np.square(H[down] * size[down]).sum())
    high += float(np.square(H[up] * size[up]).sum() + np.square(G[down] * size[down]).sum())
    for i in np.flatnonzero(up):
        for j in np.flatnonzero(down):
            F = float(f_distribution.ppf(1 - tail, freedom[i], freedom[j]))
            low += float(((F - 1) ** 2 - (G[i] * F) ** 2 - H[j] ** 2) / F * size[i] * size[j])
            F = float(f_distribution.ppf(tail, freedom[i], freedom[j]))
            high += float(((1 - F) ** 2 - (H[i] * F) ** 2 - G[j] ** 2) / F * size[i] * size[j])
    return (
        max(value - float(np.sqrt(max(low, 0.0))), 0.0),
        max(value + float(np.sqrt(max(high, 0.0))), 0.0),
    )


def interval(draws: Array, value: float) -> tuple[float, float]:
    """Return the interval of draws (m,) that are zero or more, widened to hold the value.

    Its upper end is that of the draws above zero: never "0 to 0".
    """
    tail = (1 - COMPONENTS.level) / 2
    above = draws[draws > 0]
    high = float(np.quantile(above, 1 - tail)) if above.size else 0.0
    return min(float(np.quantile(draws, tail)), value), max(high, value)


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

    def _parts(self, ratio: Array) -> tuple[Array, Array, Array, float, Array]:
        squares = np.square(ratio[self._local])
        V = self._eye + np.tensordot(squares, self._same, axes=1)
        root = np.linalg.cholesky(V)
        inverse = np.linalg.solve(V, self._right)
        M = np.einsum("bmi,bmj->ij", self._right, inverse)
        log_det = 2.0 * float(np.log(np.einsum("bmm->bm", root)).sum())
        f = self._p + 1
        d = ratio[self._which] if len(self._which) else np.empty(0)
        if len(d):
            inner = np.eye(len(d)) + d[:, None] * M[f:, f:] * d
            C = d[:, None] * M[f:, :f]
            solved = np.linalg.solve(inner, C)
            H = M[:f, :f] - C.T @ solved
            log_det += float(np.linalg.slogdet(inner)[1])
        else:
            H = M[:f, :f]
        return V, inverse, M, log_det, H

    def __call__(self, ratio: Array) -> tuple[float, Array]:
        """Return the value and its gradient (effects,)."""
        V, inverse, M, log_det, H = self._parts(ratio)
        p, n = self._p, self._n
        XX, Xy, yy = H[:p, :p], H[:p, p], H[p, p]
        b = np.linalg.solve(XX, Xy)
        rss = max(float(yy - Xy @ b), 1e-300)
        value = log_det + float(np.linalg.slogdet(XX)[1]) + (n - p) * np.log(rss)
        # With P = V^-1 - V^-1 X (X'V^-1 X)^-1 X'V^-1 the slope by a component's square is
        # tr(P Z Z') - (n - p) / rss |Z' P y|^2.
        f = p + 1
        d = ratio[self._which] if len(self._which) else np.empty(0)
        if len(d):
            # Rows of the whole V^-1 [X y], the effects across blocks included.
            back = np.linalg.solve(
                np.eye(len(d)) + d[:, None] * M[f:, f:] * d, d[:, None] * M[f:, :f]
            )
            whole = inverse[:, :, :f] - inverse[:, :, f:] @ (d[:, None] * back)
        else:
            whole = inverse[:, :, :f]
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
                K = np.linalg.inv(np.eye(len(d)) + d[:, None] * M[f:, f:] * d)
                trace -= float(np.einsum("bmi,ij,bnj,bmn->", G, K, G, same, optimize=True))
            trace -= float(np.einsum("bmi,ij,bnj,bmn->", WX, XXi, WX, same, optimize=True))
            fit = float(np.einsum("bm,bmn,bn->", Py, same, Py, optimize=True))
            gradient[k] = 2.0 * ratio[k] * (trace - (n - p) / rss * fit)
        if len(d):
            Z = self._right[:, :, f:]
            K = np.linalg.inv(np.eye(len(d)) + d[:, None] * M[f:, f:] * d)
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
