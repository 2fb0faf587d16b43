"""Which errors do the samples have? Combinations of error models, weighed by their evidence.

Beginning with what is always there, each model is tried beside the best combination so far, and the
best is kept, until none gains. All combinations that were tried stay, with their evidence and their
odds: intervals average over the doubt. Within a combination the parameters are integrated out: the
marginal likelihood is explored from its mode by a Student distribution as wide as its curvature,
and by the prior (a defensive mixture: Hesterberg 1995, Technometrics 37:185).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.covariance import Covariance
from skinlab.inference.error_combination import Combination
from skinlab.inference.error_models import ERROR_MODELS, part_of
from skinlab.inference.error_models.base import ErrorModel, Look, Part
from skinlab.inference.error_quadrature import find_mode, log_student, normal_points, student_points
from skinlab.inference.likelihood import LinearModel
from skinlab.inference.noise import roughness
from skinlab.inference.settings import CHOICE, JUDGEMENT, KINDS, NOISE, POSTERIOR

Array = NDArray[np.float64]
Modes = Mapping[frozenset[str], Mapping[str, float]]  # logarithms, by the names of the parts

_log_evidence = attrgetter("log_evidence")


@dataclass(frozen=True, eq=False)
class Node:
    """One setting of the errors' parameters: part of a quadrature over all that is possible."""

    combination: Combination
    log_values: Array  # (d,)
    covariance: Covariance
    log_prior: float  # log weight without the data: prior and odds over the density it is from
    log_marginal: float  # of the linearised model
    log_spread: float = 0.0  # of `log_prior`: the weights are of variances without `Part.spread`

    @property
    def values(self) -> dict[str, float]:
        """What the errors' parameters are, those included that were found and not fitted."""
        values = np.exp(self.log_values).tolist()
        found = dict(zip(self.combination.parameters, values, strict=True))
        for part in self.combination.parts:
            found |= part.stated
        return found

    @cached_property
    def sizes_um(self) -> dict[str, float]:
        """Root mean square of each part's errors, µm, by its name."""
        return self.combination.sizes_um(self.log_values)

    def log_prior_of(self, kept: NDArray[np.bool_]) -> float:
        """Return `log_prior` where some samples (u,) are all that there are.

        A scale mixture's weights were found from all of them, and each has its own cost.
        """
        if not self.combination.is_mixture:
            return self.log_prior
        of_others = float(self.combination.bound[~kept].sum())
        return self.log_prior - of_others - self.log_spread * float(np.mean(~kept))

    @property
    def unrounded(self) -> Covariance | None:
        """The errors before readings are rounded; None where they are not."""
        unrounded = self.combination.unrounded
        return None if unrounded is None else unrounded.covariance(self.log_values)


@dataclass(frozen=True, eq=False)
class ErrorChoice:
    """What the samples say of their errors. `nodes` with the heaviest first."""

    nodes: tuple[Node, ...]
    mode: Covariance  # of the best combination
    weight: Array = field(repr=False)  # (nodes,) sums up to 1, by the linearised model
    unrounded: Covariance | None = None  # `mode` before readings are rounded, where they are
    modes: Modes = field(default_factory=dict, repr=False)

    @cached_property
    def best(self) -> Combination:
        """The combination with most weight."""
        return max(self._weights, key=lambda each: each[1])[0]

    @property
    def told(self) -> Combination:
        """The combination to tell of: of those that are about as likely as the best the simplest.

        A part that is as likely there as not would else be told of by a hair.
        """
        least = JUDGEMENT.told * max(weight for _, weight in self._weights)
        likely = [each for each in self._weights if each[1] >= least]
        return min(likely, key=lambda each: (len(each[0].parts), -each[1]))[0]

    @cached_property
    def _weights(self) -> list[tuple[Combination, float]]:
        total: dict[int, tuple[Combination, float]] = {}
        for node, w in zip(self.nodes, self.weight, strict=True):
            one = node.combination
            total[id(one)] = one, total.get(id(one), (one, 0.0))[1] + float(w)
        return list(total.values())

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

    def roughly(self, linear: LinearModel) -> float:
        """Return Laplace's log evidence of another model by errors like the best, learned anew.

        What is not always there may be what the other model explains: without it as well. Heavy
        tails stay, which no model explains.
        """
        best = self.best
        values = next(n.log_values for n in self.nodes if n.combination is best)
        starts = dict(zip(best.parameters, values.tolist(), strict=True))
        kept = tuple(part for part in best.parts if part.always or part.again is not None)
        plain = replace(best, parts=kept)
        tried = [best, plain] if len(plain.parts) < len(best.parts) else [best]
        return max(
            _at_mode(c, linear, np.array([starts[n] for n in c.parameters])).log_evidence
            for c in tried
        )

    def quantile_of(self, values: Array, share: float) -> float:
        """Return a weighted quantile of values (nodes,)."""
        return _weighted_quantile(values, self.weight, share)

    def parameters(self) -> dict[str, float]:
        """Return medians of the parameters of what is told, and what was found with them."""
        told = self.told
        own = np.array([node.combination is told for node in self.nodes])
        weight = self.weight[own] / self.weight[own].sum()
        values = np.array([n.log_values for n in self.nodes if n.combination is told])
        found: dict[str, float] = {}
        for i, name in enumerate(told.parameters):
            found[name] = float(np.exp(_weighted_quantile(values[:, i], weight, 0.5)))
        for part in told.parts:
            found.update(part.stated)
        return found


def _weighted_quantile(values: Array, weight: Array, share: float) -> float:
    """Return the quantile of values (n,) whose weights (n,) sum up to 1."""
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weight[order]) - 0.5 * weight[order]
    return float(np.interp(share, below, values[order]))


def choose_errors(
    look: Look,
    linear: LinearModel,
    fixed_mm: Array,
    fixed_mm2: Array,
    models: Sequence[ErrorModel] | None = None,
    before: ErrorChoice | None = None,
) -> ErrorChoice:
    """Return what errors these samples have.

    `linear` is the model about its fit; `fixed_mm` (u, m) and `fixed_mm2` (u,) are columns and
    variances of errors that are known beforehand: the mesh's; columns far below the noise are left
    out. `models` are those to choose from, all that there are if it is None. Modes are looked for
    from where those of `before` are: of the same samples beside another model. Of several processes
    in time, those that are always there included, the evidence chooses one: the sum of two is not
    Markovian, and a curve hardly tells them apart.
    """
    least = POSTERIOR.small * max(roughness(look.residual_mm), NOISE.least_mm)
    fixed_mm = fixed_mm[:, np.sqrt(np.square(fixed_mm).sum(axis=0)) > least]
    models = ERROR_MODELS.all() if models is None else models
    modes = {} if before is None else before.modes
    search = _Search(look, linear, fixed_mm, fixed_mm2, models, modes)
    best = search.with_more(search.what_is_always_there())
    best = search.with_what_shows_below(best)
    if look.samples.curves > 1:
        best = search.with_motion_in_place_of_processes(best)
    best = search.without_what_is_needless(best)
    mixture = _scale_mixture(look, linear, best, search.combine, models)
    if mixture is not None:
        search.tried.append(mixture)
        best = max(best, mixture, key=_log_evidence)
    return _collect([_again(e, linear) if _is_coarse(e, best) else e for e in search.tried], best)


class _Search:
    """The combinations that were tried, and the ways from the best of them to a better one."""

    def __init__(
        self,
        look: Look,
        linear: LinearModel,
        fixed_mm: Array,
        fixed_mm2: Array,
        models: Sequence[ErrorModel],
        modes: Modes,
    ) -> None:
        self.tried: list[_Explored] = []
        self._look, self._linear, self._models, self._modes = look, linear, models, modes
        self._fixed = fixed_mm, fixed_mm2
        self._starts, self._slow = _starts(look, linear), _slow_starts(linear)
        offered = self._seen(look, set())
        self._always = sorted((p for p in offered if p.always), key=lambda p: p.name != "white")
        self._others = [p for p in offered if not p.always]
        self._offered = {part.name for part in offered}
        self._processes = {part.name for part in offered if part.is_process}

    def combine(self, parts: tuple[Part, ...]) -> Combination:
        """Return the combination of these parts, of these samples."""
        return Combination(parts, self._look.samples.time_s, self._look.samples.ends, *self._fixed)

    def what_is_always_there(self) -> _Explored:
        """Return the best combination of that alone, with one process in time of several."""
        rivals = [part for part in self._always if part.name in self._processes]
        plain = tuple(part for part in self._always if part.name not in self._processes)
        sets = [(*plain, rival) for rival in rivals] or [plain]
        self.tried += [self._explored(parts, {}) for parts in sets]
        return max(self.tried, key=_log_evidence)

    def with_more(self, best: _Explored) -> _Explored:
        """Return the best combination with one more part each time, until none gains."""
        for _ in range(CHOICE.most_models):
            names = best.combination.names
            taken = names | self._processes if names & self._processes else names
            more = [p for p in self._others if p.name not in taken]
            known = {e.combination.names for e in self.tried}
            leader = self._best_of(
                [(*best.combination.parts, p) for p in more if names | {p.name} not in known], best
            )
            if leader is best:
                break
            best = leader
        return best

    def with_what_shows_below(self, best: _Explored) -> _Explored:
        """Return the best combination with parts that are seen below the others alone, too."""
        later = self._seen(replace(self._look, covariance=best.mode_covariance), self._offered)
        if not later:
            return best
        self._others += later
        return self.with_more(best)

    def with_motion_in_place_of_processes(self, best: _Explored) -> _Explored:
        """Return the best combination with what processes in time hide, in their place.

        Below errors that last a breath hardly shows, for these follow it. Of one curve it was
        looked for before them.
        """
        rest = tuple(p for p in best.combination.parts if p.always or not p.is_process)
        if len(rest) == len(best.combination.parts):
            return best
        bare = self.combine(rest)
        at = np.array([best.mode[name] for name in bare.parameters])
        above = replace(self._look, covariance=bare.covariance(at))
        waves = self._seen(above, self._offered | best.combination.names)
        leader = self._best_of([(*rest, part) for part in waves], best)
        if leader is best:
            return best
        self._others += waves
        return self.with_more(leader)

    def without_what_is_needless(self, best: _Explored) -> _Explored:
        """Return the best combination without what came first and is needless beside the later.

        Lasting errors beside a sine are. Of one curve, what stays is looked at again: a walk beside
        these. Of several each try costs more.
        """
        early = [p for p in best.combination.parts if not p.always][:-1]
        while True:
            for part in early:
                fewer = tuple(p for p in best.combination.parts if p is not part)
                left = best.combination.names - {part.name}
                if all(left != e.combination.names for e in self.tried):
                    self.tried.append(self._explored(fewer, best.mode, best.log_evidence))
            last, best = best, max((e for e in self.tried if e.nodes), key=_log_evidence)
            if best is last or self._look.samples.curves > 1:
                return best
            early = [p for p in best.combination.parts if not p.always]

    def _seen(self, look: Look, known: Set[str]) -> list[Part]:
        """Return the parts of models that see something here, but for those of known names."""
        return [
            part
            for model in self._models
            if model.name not in known and (part := part_of(model, look)) is not None
        ]

    def _best_of(self, sets: Sequence[tuple[Part, ...]], best: _Explored) -> _Explored:
        """Return the best of these, tried from the mode of the best so far, and of that one."""
        found = [self._explored(parts, best.mode, best.log_evidence) for parts in sets]
        self.tried += found
        return max([best, *found], key=_log_evidence)

    def _explored(
        self, parts: tuple[Part, ...], beside: Mapping[str, float], rival: float = -math.inf
    ) -> _Explored:
        one = self.combine(parts)
        begin = self._modes.get(one.names) or {**self._starts, **beside}
        return _explore(one, self._linear, begin, self._slow, rival)


def _is_coarse(one: _Explored, best: _Explored) -> bool:
    """Return whether the nodes of a combination are too few for what it weighs."""
    return (
        len(one.log_mode) > CHOICE.few
        and len(one.nodes) > 0
        and one.log_evidence > best.log_evidence - CHOICE.weighty
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
    more = CHOICE.as_mode
    spread = (counts * spread + more * one.root @ one.root.T) / (counts + more)
    wide = CHOICE.wider * np.linalg.cholesky(spread)
    points = mean + student_points(CHOICE.most_nodes, len(mean)) @ wide.T
    return _integrated(one, points, log_student(points - mean, wide), linear)


def _collect(tried: Sequence[_Explored], best: _Explored) -> ErrorChoice:
    nodes = [node for e in tried for node in e.nodes]
    log_weight = np.array([n.log_prior + n.log_marginal for n in nodes])
    weight = np.exp(log_weight - np.logaddexp.reduce(log_weight))
    order = np.argsort(-weight, kind="stable")
    order = order[np.cumsum(weight[order]) - weight[order] < 1.0 - CHOICE.negligible]
    kept = weight[order] / weight[order].sum()
    plain = best.combination.unrounded
    unrounded = None if plain is None else plain.covariance(best.log_mode)
    modes = {e.combination.names: e.mode for e in tried}
    return ErrorChoice(tuple(nodes[i] for i in order), best.mode_covariance, kept, unrounded, modes)


@dataclass(frozen=True, eq=False)
class _Explored:
    """A combination at its mode, its nodes, and its evidence with the odds."""

    combination: Combination
    log_mode: Array
    root: Array  # (d, d) of the covariance of the parameters' logarithms there, and
    here: float  # the log density
    nodes: tuple[Node, ...]
    log_evidence: float  # by the nodes; without them Laplace's

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


def _slow_starts(linear: LinearModel) -> tuple[float, float] | None:
    """Return logarithms of a noise and of a process's size, µm, where a residual is smooth.

    From a noise as large as a smooth residual what lasts has no slope, and is not found.
    """
    left = linear.residual_mm
    rough = max(roughness(left), NOISE.least_mm) if len(left) > 2 else math.inf
    lasting = float(np.mean(np.square(left))) - rough**2
    if not lasting > (CHOICE.smooth * rough) ** 2:
        return None
    return math.log(1e3 * rough), 0.5 * math.log(1e6 * lasting)


def _explore(
    combination: Combination,
    linear: LinearModel,
    starts: Mapping[str, float],
    slow: tuple[float, float] | None,
    rival: float = -math.inf,
) -> _Explored:
    """Return the combination explored; from its mode alone if that is hopeless beside a rival.

    A process that `starts` know was found already: it is not begun elsewhere.
    """
    each = [p for part in combination.parts for p in part.parameters]
    at = np.array([starts.get(p.name, math.log(p.start or p.median)) for p in each])
    begun = _at_mode(combination, linear, at)
    lasting = [
        part.is_process and p.name.endswith("_um")
        for part in combination.parts
        for p in part.parameters
    ]
    found = all(p.name in starts for p, lasts in zip(each, lasting, strict=True) if lasts)
    if slow is not None and not found:
        at[lasting] = slow[1]
        at[[p.name == "white_um" for p in each]] = slow[0]
        other = _at_mode(combination, linear, at)
        begun = max(begun, other, key=lambda e: e.log_evidence)
    if not combination.is_mixture and begun.log_evidence < rival - CHOICE.hopeless:
        return begun
    return _integrated(begun, *_draws(combination, begun.log_mode, begun.root), linear)


def _at_mode(combination: Combination, linear: LinearModel, start: Array) -> _Explored:
    """Return the combination at its mode, without nodes, and Laplace's evidence."""
    mode, root, here = find_mode(_density(combination, linear), start, combination.scales)
    roughly = here + 0.5 * len(mode) * math.log(2.0 * math.pi) + float(np.linalg.slogdet(root)[1])
    roughly += combination.log_odds + float(combination.bound.sum())
    return _Explored(combination, mode, root, here, (), roughly)


def _integrated(one: _Explored, values: Array, log_drawn: Array, linear: LinearModel) -> _Explored:
    """Return the combination with nodes at logarithms (n, d) drawn with log densities (n,)."""
    combination = one.combination
    covariances = combination.covariances(values)
    log_prior = combination.log_priors(values)
    log_prior += combination.log_odds - math.log(len(values)) - log_drawn
    log_marginal = linear.log_marginals(covariances)
    log_spread = np.zeros(len(values))
    if combination.is_mixture:
        # Weights are those of the mixture's own variances; the nodes' are spread.
        own = linear.log_marginals(combination.covariances(values, spread=False))
        log_spread = own - log_marginal
        log_prior += log_spread + float(combination.bound.sum())
    evidence = float(np.logaddexp.reduce(log_prior + log_marginal))
    each = (log_prior.tolist(), log_marginal.tolist(), log_spread.tolist())
    nodes = tuple(Node(combination, *one) for one in zip(values, covariances, *each, strict=True))
    return replace(one, nodes=nodes, log_evidence=evidence)


def _density(combination: Combination, linear: LinearModel) -> Callable[[Array], Array]:
    """Return the log density (n,) of logarithms (n, d) of the errors' parameters."""

    def density(log_values: Array) -> Array:
        found = linear.log_marginals(combination.covariances(log_values, spread=False))
        return np.asarray(found + combination.log_priors(log_values))

    return density


def _draws(combination: Combination, mode: Array, root: Array) -> tuple[Array, Array]:
    """Return logarithms (n, d) to integrate over, and the log density (n,) that they are from."""
    d = len(mode)
    if not d:
        return np.zeros((1, 0)), np.zeros(1)
    each = [p for part in combination.parts for p in part.parameters]
    median, sd = np.log([p.median for p in each]), np.array([p.log_sd for p in each])
    count = CHOICE.nodes.get(d, CHOICE.most_nodes)
    first = round((1.0 - CHOICE.from_prior) * count) if d > 1 else count
    wide = CHOICE.wider * root
    values = mode + student_points(first, d) @ wide.T
    if first == count:
        return values, log_student(values - mode, wide)
    # As wide as the prior, except where the mode is narrow: of white noise all is known.
    sure = np.sqrt(np.square(root).sum(axis=1)) < 0.3 * sd
    own = 1.5 * np.sqrt(np.square(wide).sum(axis=1))
    far = [(np.where(sure, mode, median), np.where(sure, own, sd))]
    # And where there is hardly any of what may be absent: from afar no mode leads there.
    absent = np.array([p.absent > 0.0 for p in each]) & ~sure
    if absent.any():
        middle, width = far[0]
        hardly = median - math.log(KINDS.hardly)
        far.append((np.where(absent, hardly, middle), np.where(absent, KINDS.hardly_sd, width)))
    shares = np.array_split(np.arange(count - first), len(far))
    points = normal_points(count - first, d)
    for part, (middle, width) in zip(shares, far, strict=True):
        values = np.vstack([values, middle + width * points[part]])
    each_log = [math.log(first / count) + log_student(values - mode, wide)]
    for part, (middle, width) in zip(shares, far, strict=True):
        off = (values - middle) / width
        norm = np.log(width * math.sqrt(2.0 * math.pi)).sum()
        each_log.append(math.log(len(part) / count) - 0.5 * np.square(off).sum(axis=1) - norm)
    return values, np.logaddexp.reduce(each_log)


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
    mixtures = (part_of(model, seen) for model in models)
    part = next((p for p in mixtures if p is not None and p.again is not None), None)
    if part is None or part.again is None:
        return None
    for _ in range(CHOICE.mixture_rounds):
        combination = combine((*plain, part))
        at, _, _ = find_mode(_density(combination, linear), at, combination.scales)
        stretch = part.terms(()).stretch
        assert stretch is not None
        # White errors' squares by the variance that the weights are of: that without stretch.
        square = linear.white_square(combination.covariance(at, spread=False)) * stretch
        part = part.again(square)
        assert part.again is not None
    combination = combine((*plain, part))
    starts = dict(zip(combination.parameters, at.tolist(), strict=True))
    return _explore(combination, linear, starts, None)
