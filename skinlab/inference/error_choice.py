"""Which errors do the samples have? Combinations of error models, weighed by their evidence.

Beginning with what is always there, each model is tried beside the best combination so far, and the
best is kept, until none gains. All combinations that were tried stay, with their evidence and their
odds: intervals average over the doubt. Within a combination the parameters are integrated out: the
marginal likelihood is explored from its mode by a Student distribution as wide as its curvature,
and by the prior (a defensive mixture: Hesterberg 1995, Technometrics 37:185).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.covariance import Covariance, OrnsteinUhlenbeck
from skinlab.inference.error_models import ERROR_MODELS
from skinlab.inference.error_models.base import ErrorModel, Look, Part, Terms
from skinlab.inference.likelihood import LinearModel

Array = NDArray[np.float64]

_STEP = 0.05  # of a logarithm, for derivatives
_MOST_STEPS = 6
_SHORTER = 0.3 ** np.arange(4)  # steps that are tried
_HOPELESS = 7.0  # in log evidence: a combination so much worse is not integrated over
_FAR = 1.5  # the longest step in a logarithm
_LEAST_CURVATURE = 0.4  # of the log density: wider than 1.6 in a logarithm is left to the prior
_SETTLED = 0.05  # of the log density
_WIDER = 1.2
_FREEDOM = 6.0  # of the Student distribution
_NODES = {0: 1, 1: 10, 2: 24, 3: 40}  # by the number of parameters
_MOST_NODES = 64
_FEW = 2  # parameters: the nodes of the first round will do
_WEIGHTY = 3.0  # in log evidence below the best: those have a second round
_AS_MODE = 6.0  # nodes that the curvature at the mode counts as, beside them
_FROM_PRIOR = 0.2  # of the nodes
_NO_GAIN = 0.0  # of the log evidence with odds: below, no more models are added
_MOST_MODELS = 4  # beside those that are always there
_NEGLIGIBLE = 1e-3  # of all weight: nodes that carry less are dropped
_MIXTURE_ROUNDS = 6
POINTS = Path(__file__).parents[1] / "data" / "sobol.npz"  # tests/unit/inference/test_sobol.py


@dataclass(frozen=True, eq=False)
class Combination:
    """Error models together."""

    parts: tuple[Part, ...]
    samples_time_s: Array
    ends: tuple[int, ...]
    fixed_mm: Array  # (u, m) columns that are there whatever the parameters
    fixed_mm2: Array  # (u,) variances, likewise
    _last: list[tuple[Array, ...]] = field(default_factory=list, init=False, repr=False)

    @property
    def name(self) -> str:
        """Names of the parts."""
        return "+".join(part.name for part in self.parts)

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of the parts, in no order."""
        return frozenset(part.name for part in self.parts)

    @cached_property
    def scales(self) -> Array:
        """How far the parameters' logarithms (d,) go in one step of a search."""
        return np.array([p.scale for part in self.parts for p in part.parameters])

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(p.name for part in self.parts for p in part.parameters)

    @cached_property
    def lasting(self) -> frozenset[str]:
        """Names of the parts that are correlated in time."""
        return frozenset(part.name for part in self.parts if part.lasting)

    @property
    def log_odds(self) -> float:
        """Before the data, against the parts that are always there."""
        return sum(part.log_odds for part in self.parts)

    @property
    def bound(self) -> float:
        """What the parts that are scale mixtures add to the log evidence."""
        return sum(part.bound for part in self.parts)

    def log_priors(self, log_values: Array) -> Array:
        """Return the log prior densities (n,) of the parameters' logarithms (n, d)."""
        each = [p for part in self.parts for p in part.parameters]
        found = np.zeros(len(log_values))
        for parameter, values in zip(each, log_values.T, strict=True):
            found += parameter.log_prior(values)
        return found

    def sizes_um(self, log_values: Array) -> dict[str, float]:
        """Return the root mean square over samples of each part's errors, µm, by its name."""
        values, found = np.exp(log_values).tolist(), dict(self._constant_um)
        for part, own in zip(self.parts, self._own, strict=True):
            if part.parameters:
                found[part.name] = _size_um(part.terms(values[own]))
        return found

    @cached_property
    def _constant_um(self) -> dict[str, float]:
        return {p.name: _size_um(p.terms(())) for p in self.parts if not p.parameters}

    def covariances(self, log_values: Array, *, spread: bool = True) -> list[Covariance]:
        """Return the covariances (n,) at logarithms (n, d)."""
        n, values = len(log_values), np.exp(log_values)
        variance, stretch = self.fixed_mm2, np.ones(1)
        processes: list[OrnsteinUhlenbeck | None] = [None] * n
        columns = [[self.fixed_mm] * n]
        for part, own in zip(self.parts, self._own, strict=True):
            if part.variances is not None:
                variance = variance + part.variances(values[:, own])
                continue
            settings = values[:, own].tolist() if part.parameters else [()]
            each = [part.terms(setting) for setting in settings]
            own_mm2 = np.array([terms.variance_mm2 for terms in each], dtype=float)
            variance = variance + own_mm2.reshape(len(each), -1)
            if len(each) < n:
                each = each * n  # it has no parameters
            processes = [terms.ou or ou for terms, ou in zip(each, processes, strict=True)]
            some = [terms.columns_mm for terms in each if terms.columns_mm is not None]
            if len(some) == n:
                columns.append(some)
            if each[0].stretch is not None:
                stretched = [1.0 if terms.stretch is None else terms.stretch for terms in each]
                stretch = stretch * np.array(stretched) * (part.spread if spread else 1.0)
        variance = np.broadcast_to(variance * stretch, (n, len(self.fixed_mm2)))
        whole = columns[0] if len(columns) == 1 else self._side_by_side(columns)
        return [
            Covariance(d, v, self.ends, ou, self.samples_time_s)
            for d, v, ou in zip(variance, whole, processes, strict=True)
        ]

    def covariance(self, log_values: Array, *, spread: bool = True) -> Covariance:
        """Return the covariance at these logarithms (d,)."""
        return self.covariances(log_values[None], spread=spread)[0]

    @cached_property
    def _own(self) -> list[slice]:
        """Where each part's parameters are among all."""
        ends = np.cumsum([len(part.parameters) for part in self.parts]).tolist()
        return [slice(e - len(p.parameters), e) for e, p in zip(ends, self.parts, strict=True)]

    def _side_by_side(self, columns: list[list[Array]]) -> list[Array]:
        """Return columns (u, m) side by side; the same array where they are the same arrays."""
        found: list[Array] = []
        for blocks in zip(*columns, strict=True):
            if not self._last or not _same(self._last[0], blocks):
                self._last[:] = [blocks, (np.hstack(blocks),)]
            found.append(self._last[1][0])
        return found


def _size_um(terms: Terms) -> float:
    """Return the root mean square over samples, µm."""
    variance = np.asarray(terms.variance_mm2)
    total = float(np.add.reduce(variance, axis=None)) / variance.size
    if terms.ou is not None:
        total += terms.ou.size_mm**2
    if terms.columns_mm is not None and len(terms.columns_mm):
        columns = terms.columns_mm.ravel()
        total += float(columns @ columns) / len(terms.columns_mm)
    return 1e3 * math.sqrt(total)


def _same(some: Sequence[Array], others: Sequence[Array]) -> bool:
    return len(some) == len(others) and all(a is b for a, b in zip(some, others, strict=True))


@dataclass(frozen=True, eq=False)
class Node:
    """One setting of the errors' parameters: part of a quadrature over all that is possible."""

    combination: Combination
    log_values: Array  # (d,)
    covariance: Covariance
    log_prior: float  # log weight without the data: prior and odds over the density it is from
    log_marginal: float  # of the linearised model

    @cached_property
    def sizes_um(self) -> dict[str, float]:
        """Root mean square of each part's errors, µm, by its name."""
        return self.combination.sizes_um(self.log_values)


@dataclass(frozen=True, eq=False)
class ErrorChoice:
    """What the samples say of their errors. `nodes` with the heaviest first."""

    nodes: tuple[Node, ...]
    mode: Covariance  # of the best combination
    weight: Array = field(repr=False)  # (nodes,) sums up to 1, by the linearised model

    @cached_property
    def best(self) -> Combination:
        """The combination with most weight."""
        total: dict[int, float] = {}
        for node, w in zip(self.nodes, self.weight, strict=True):
            total[id(node.combination)] = total.get(id(node.combination), 0.0) + float(w)
        chosen = max(total, key=lambda key: total[key])
        return next(n.combination for n in self.nodes if id(n.combination) == chosen)

    def probability(self, name: str) -> float:
        """Return the probability that the errors have a part of this name."""
        return float(
            sum(
                w
                for node, w in zip(self.nodes, self.weight, strict=True)
                if any(part.name == name for part in node.combination.parts)
            )
        )

    def median(self, function: Callable[[Node], float]) -> float:
        """Return the weighted median of a function of the nodes."""
        return self.quantile(function, 0.5)

    def quantile(self, function: Callable[[Node], float], share: float) -> float:
        """Return a weighted quantile of a function of the nodes."""
        return self.quantile_of(np.array([function(node) for node in self.nodes]), share)

    def quantile_of(self, values: Array, share: float) -> float:
        """Return a weighted quantile of values (nodes,)."""
        order = np.argsort(values, kind="stable")
        below = np.cumsum(self.weight[order]) - 0.5 * self.weight[order]
        return float(np.interp(share, below, values[order]))

    def parameters(self) -> dict[str, float]:
        """Return medians of the best combination's parameters, and what was found with them."""
        best = self.best
        own = np.array([node.combination is best for node in self.nodes])
        weight = self.weight[own] / self.weight[own].sum()
        values = np.array([n.log_values for n in self.nodes if n.combination is best])
        found: dict[str, float] = {}
        for i, name in enumerate(best.parameters):
            order = np.argsort(values[:, i], kind="stable")
            below = np.cumsum(weight[order]) - 0.5 * weight[order]
            found[name] = float(np.exp(np.interp(0.5, below, values[order, i])))
        for part in best.parts:
            found.update(part.stated)
        return found


def choose_errors(
    look: Look,
    linear: LinearModel,
    fixed_mm: Array,
    fixed_mm2: Array,
    models: Sequence[ErrorModel] | None = None,
) -> ErrorChoice:
    """Return what errors these samples have.

    `linear` is the model about its fit; `fixed_mm` (u, m) and `fixed_mm2` (u,) are columns and
    variances of errors that are known beforehand: the mesh's. `models` are those to choose from,
    all that there are if it is None. Of several processes in time, those that are always there
    included, the evidence chooses one: the sum of two is not Markovian, and a curve hardly tells
    them apart.
    """
    models = ERROR_MODELS.all() if models is None else models
    offered = [part for model in models if (part := model.part(look)) is not None]
    always = tuple(sorted((p for p in offered if p.always), key=lambda p: p.name != "white"))
    others = [p for p in offered if not p.always]
    processes = {part.name for part in offered if part.is_process}
    rivals = [part for part in always if part.name in processes]
    plain = tuple(part for part in always if part.name not in processes)

    def combine(parts: tuple[Part, ...]) -> Combination:
        return Combination(parts, look.samples.time_s, look.samples.ends, fixed_mm, fixed_mm2)

    starts = _starts(look, linear)
    sets = [(*plain, rival) for rival in rivals] or [plain]
    tried = [_explore(combine(parts), linear, starts) for parts in sets]
    best = max(tried, key=lambda e: e.log_evidence)
    for _ in range(_MOST_MODELS):
        names = best.combination.names
        taken = names | processes if names & processes else names
        more = [p for p in others if p.name not in taken]
        known = {e.combination.names for e in tried}
        found = [
            _explore(
                combine((*best.combination.parts, part)),
                linear,
                {**starts, **best.mode},
                best.log_evidence,
            )
            for part in more
            if names | {part.name} not in known
        ]
        tried += found
        if not found:
            break
        leader = max(found, key=lambda e: e.log_evidence)
        if leader.log_evidence <= best.log_evidence + _NO_GAIN:
            break
        best = leader
    # What came first may be needless beside what came later: lasting errors beside a sine.
    early = [p for p in best.combination.parts if not p.always]
    for part in early[:-1]:
        fewer = combine(tuple(p for p in best.combination.parts if p is not part))
        if all(fewer.names != e.combination.names for e in tried):
            tried.append(_explore(fewer, linear, {**starts, **best.mode}, best.log_evidence))
    best = max((e for e in tried if e.nodes), key=lambda e: e.log_evidence)
    mixture = _scale_mixture(look, linear, best, combine, models)
    if mixture is not None:
        tried.append(mixture)
        if mixture.log_evidence > best.log_evidence:
            best = mixture
    return _collect([_again(e, linear) if _is_coarse(e, best) else e for e in tried], best)


def _is_coarse(one: _Explored, best: _Explored) -> bool:
    """Return whether the nodes of a combination are too few for what it weighs."""
    return (
        len(one.log_mode) > _FEW
        and len(one.nodes) > 0
        and one.log_evidence > best.log_evidence - _WEIGHTY
    )


def _again(one: _Explored, linear: LinearModel) -> _Explored:
    """Return the combination with nodes about where those before have their weight.

    A distribution about the mode alone leaves a dozen nodes that count, where sizes and times of
    errors that last trade for each other.
    """
    values = np.array([node.log_values for node in one.nodes])
    log_weight = np.array([node.log_prior + node.log_marginal for node in one.nodes])
    weight = np.exp(log_weight - np.logaddexp.reduce(log_weight))
    mean = weight @ values
    counts = 1.0 / float(np.square(weight).sum())
    spread = (values - mean).T @ ((values - mean) * weight[:, None])
    spread = (counts * spread + _AS_MODE * one.root @ one.root.T) / (counts + _AS_MODE)
    wide = _WIDER * np.linalg.cholesky(spread)
    points = mean + student_points(_MOST_NODES, len(mean)) @ wide.T
    return _integrated(one, points, _log_student(points - mean, wide), linear)


def _collect(tried: Sequence[_Explored], best: _Explored) -> ErrorChoice:
    nodes = [node for e in tried for node in e.nodes]
    log_weight = np.array([n.log_prior + n.log_marginal for n in nodes])
    weight = np.exp(log_weight - np.logaddexp.reduce(log_weight))
    order = np.argsort(-weight, kind="stable")
    order = order[np.cumsum(weight[order]) - weight[order] < 1.0 - _NEGLIGIBLE]
    kept = weight[order] / weight[order].sum()
    return ErrorChoice(tuple(nodes[i] for i in order), best.mode_covariance, kept)


@dataclass(frozen=True, eq=False)
class _Explored:
    """A combination at its mode, its nodes, and its evidence with the odds."""

    combination: Combination
    log_mode: Array
    root: Array  # (d, d) of the covariance of the parameters' logarithms there, and
    here: float  # the log density
    nodes: tuple[Node, ...]
    log_evidence: float

    @property
    def mode(self) -> dict[str, float]:
        return dict(zip(self.combination.parameters, self.log_mode.tolist(), strict=True))

    @property
    def mode_covariance(self) -> Covariance:
        return self.combination.covariance(self.log_mode)


def _starts(look: Look, linear: LinearModel) -> dict[str, float]:
    """Return logarithms to start from where the data say more than the prior."""
    freedom = max(len(look.samples) - linear.slopes_mm.shape[1], 1)
    left = linear.residual_mm
    size = 1e3 * math.sqrt(max(float(left @ left) / freedom, 1e-10))
    return {"white_um": math.log(size)}


def _explore(
    combination: Combination,
    linear: LinearModel,
    starts: dict[str, float],
    rival: float = -math.inf,
) -> _Explored:
    """Return the combination explored; from its mode alone if that is hopeless beside a rival."""
    each = [p for part in combination.parts for p in part.parameters]
    at = np.array([starts.get(p.name, math.log(p.start or p.median)) for p in each])
    mode, root, here = _mode(_density(combination, linear), at, combination.scales)
    roughly = here + 0.5 * len(mode) * math.log(2.0 * math.pi) + float(np.linalg.slogdet(root)[1])
    roughly += combination.log_odds
    if not combination.bound and roughly < rival - _HOPELESS:
        return _Explored(combination, mode, root, here, (), roughly)
    begun = _Explored(combination, mode, root, here, (), roughly)
    return _integrated(begun, *_draws(combination, mode, root), linear)


def _integrated(one: _Explored, values: Array, log_drawn: Array, linear: LinearModel) -> _Explored:
    """Return the combination with nodes at logarithms (n, d) drawn with log densities (n,)."""
    combination = one.combination
    covariances = combination.covariances(values)
    log_prior = combination.log_priors(values)
    log_prior += combination.log_odds - math.log(len(values)) - log_drawn
    log_marginal = linear.log_marginals(covariances)
    evidence = float(np.logaddexp.reduce(log_prior + log_marginal))
    if combination.bound:
        # The evidence is that of the mixture's own variances; the nodes' are spread.
        spread = _density(combination, linear, spread=True)(one.log_mode[None])[0]
        right = one.here - float(spread) + combination.bound
        log_prior += right
        evidence += right
    nodes = tuple(
        Node(combination, *one)
        for one in zip(values, covariances, log_prior.tolist(), log_marginal.tolist(), strict=True)
    )
    return replace(one, nodes=nodes, log_evidence=evidence)


def _density(
    combination: Combination, linear: LinearModel, *, spread: bool = False
) -> Callable[[Array], Array]:
    """Return the log density (n,) of logarithms (n, d) of the errors' parameters."""

    def density(log_values: Array) -> Array:
        found = linear.log_marginals(combination.covariances(log_values, spread=spread))
        return np.asarray(found + combination.log_priors(log_values))

    return density


def _mode(
    density_of_logarithms: Callable[[Array], Array], start: Array, scales: Array
) -> tuple[Array, Array, float]:
    """Return the mode (d,) by Newton's method, a root (d, d) of the covariance, and the density.

    Steps are in units of `scales` (d,).
    """

    def density(scaled: Array) -> Array:
        return density_of_logarithms(scaled * scales)

    at, d = start / scales, len(start)
    values = np.eye(d)
    here, slope, curvature = _derivatives(density, at)
    for step_number in range(_MOST_STEPS if d else 0):
        if step_number:
            here, slope, curvature = _derivatives(density, at)
        curve, vectors = np.linalg.eigh(-curvature)
        curve = np.maximum(np.where(curve > 0, curve, -0.3 * curve), _LEAST_CURVATURE)
        values = vectors / np.sqrt(curve)
        step = values @ (values.T @ slope)
        step *= min(1.0, _FAR / max(float(np.abs(step).max()), 1e-12))
        if float(slope @ step) < _SETTLED:
            break
        trials = at + _SHORTER[:, None] * step
        there = density(trials)
        better = np.flatnonzero(there > here)
        if not len(better):
            break
        at, here = trials[better[0]], float(there[better[0]])
    return at * scales, values * scales[:, None], here


def _derivatives(density: Callable[[Array], Array], at: Array) -> tuple[float, Array, Array]:
    """Return the density at a point (d,), its slope (d,) and curvature (d, d)."""
    d, h = len(at), _STEP
    steps = h * np.eye(d)
    i, j = np.tril_indices(d, -1)
    found = density(at + np.vstack([np.zeros((1, d)), steps, -steps, steps[i] + steps[j]]))
    here, up, down, both = np.split(found, [1, 1 + d, 1 + 2 * d])
    slope = (up - down) / (2.0 * h)
    curvature = np.diag((up - 2.0 * here + down) / h**2)
    curvature[i, j] = curvature[j, i] = (both - up[i] - up[j] + here) / h**2
    return float(here[0]), slope, curvature


@lru_cache(maxsize=64)
def normal_points(count: int, d: int) -> Array:
    """Return normally distributed points (count, d), spread evenly: a fixed Sobol' sequence."""
    stored = _stored_points().get(f"normal{d}")
    if stored is not None and count <= len(stored):
        return stored[:count]
    from scipy.special import ndtri  # slow to import

    return np.asarray(ndtri(_even(count, d)))


@lru_cache(maxsize=64)
def student_points(count: int, d: int) -> Array:
    """Return Student distributed points (count, d), from one dimension more of the sequence."""
    stored = _stored_points().get(f"student{d}")
    if stored is not None and count <= len(stored):
        return stored[:count]
    from scipy.special import gammaincinv, ndtri  # slow to import

    points = _even(count, d + 1)
    chi_square = 2.0 * gammaincinv(0.5 * _FREEDOM, points[:, -1])
    return np.asarray(ndtri(points[:, :-1]) * np.sqrt(_FREEDOM / chi_square)[:, None])


def _even(count: int, d: int) -> Array:
    """Return points (count, d) of the unit cube."""
    from scipy.stats import qmc  # slow to import

    sequence = qmc.Sobol(d, scramble=True, rng=np.random.default_rng(0))
    return np.clip(sequence.random(1 << max(count - 1, 1).bit_length())[:count], 1e-3, 1 - 1e-3)


@cache
def _stored_points() -> Mapping[str, Array]:
    """Return the first points of each dimension: scipy takes half a second to make them."""
    if not POINTS.exists():
        return {}
    with np.load(POINTS) as file:
        return dict(file)


def _draws(combination: Combination, mode: Array, root: Array) -> tuple[Array, Array]:
    """Return logarithms (n, d) to integrate over, and the log density (n,) that they are from."""
    d = len(mode)
    if not d:
        return np.zeros((1, 0)), np.zeros(1)
    each = [p for part in combination.parts for p in part.parameters]
    median, sd = np.log([p.median for p in each]), np.array([p.log_sd for p in each])
    count = _NODES.get(d, _MOST_NODES)
    first = round((1.0 - _FROM_PRIOR) * count) if d > 1 else count
    wide = _WIDER * root
    near = mode + student_points(first, d) @ wide.T
    values = near
    share = first / count
    if first < count:
        # As wide as the prior, except where the mode is narrow: of white noise all is known.
        sure = np.sqrt(np.square(root).sum(axis=1)) < 0.3 * sd
        middle, width = np.where(sure, mode, median), np.where(sure, 1.0, sd)
        other = normal_points(count - first, d) * width
        own = np.sqrt(np.square(wide).sum(axis=1))
        other = middle + np.where(sure, 1.5 * own * normal_points(count - first, d), other)
        values = np.vstack([near, other])
        width = np.where(sure, 1.5 * own, width)
    log_near = _log_student(values - mode, wide)
    if first == count:
        return values, log_near
    off = (values - middle) / width
    log_far = -0.5 * np.square(off).sum(axis=1) - np.log(width * math.sqrt(2 * math.pi)).sum()
    return values, np.logaddexp(math.log(share) + log_near, math.log(1.0 - share) + log_far)


def _log_student(off: Array, wide: Array) -> Array:
    """Return the log densities (n,) of a Student distribution, (n, d) off its middle."""
    d = off.shape[1]
    z = np.linalg.solve(wide, off.T).T
    return np.asarray(
        math.lgamma(0.5 * (_FREEDOM + d))
        - math.lgamma(0.5 * _FREEDOM)
        - 0.5 * d * math.log(_FREEDOM * math.pi)
        - float(np.linalg.slogdet(wide)[1])
        - 0.5 * (_FREEDOM + d) * np.log1p(np.square(z).sum(axis=1) / _FREEDOM)
    )


def _scale_mixture(
    look: Look,
    linear: LinearModel,
    best: _Explored,
    combine: Callable[[tuple[Part, ...]], Combination],
    models: Sequence[ErrorModel],
) -> _Explored | None:
    """Return the best combination with heavy tails; None where none are seen.

    The errors' sizes and the samples' weights are found by turns, each of the other's last.
    """
    plain, at = best.combination.parts, best.log_mode
    seen = replace(look, white_square=linear.white_square(best.mode_covariance))
    mixtures = (model.part(seen) for model in models)
    part = next((p for p in mixtures if p is not None and p.again is not None), None)
    if part is None or part.again is None:
        return None
    for _ in range(_MIXTURE_ROUNDS):
        combination = combine((*plain, part))
        at, _, _ = _mode(_density(combination, linear), at, combination.scales)
        stretch = part.terms(()).stretch
        assert stretch is not None
        # White errors' squares by the variance that the weights are of: that without stretch.
        square = linear.white_square(combination.covariance(at, spread=False)) * stretch
        part = part.again(square)
        assert part.again is not None
    combination = combine((*plain, part))
    starts = dict(zip(combination.parameters, at.tolist(), strict=True))
    return _explore(combination, linear, starts)
