"""Does a fit leave more than noise, and where? What is left is looked at in many places at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc, ndtr

from skinlab.curves.settings import SUCTION
from skinlab.discrepancy.campaign_error_models import Rounding, walk_shapes
from skinlab.discrepancy.campaign_errors import Linearised
from skinlab.discrepancy.fit import Fit
from skinlab.discrepancy.records import Record, by_condition
from skinlab.discrepancy.settings import ERRORS, NAMES
from skinlab.inference.covariance import Covariance, block_diagonal

Array = NDArray[np.float64]

_LAGS = range(1, ERRORS.neighbours + 1)
_LOST = 3.5  # last samples without which a repeat is not cut short yet


@dataclass(frozen=True)
class Place:
    """A stretch of one curve and what is left there on average."""

    file: str
    phase: str
    pressure_mbar: tuple[float, float]
    time_s: tuple[float, float]
    mean_um: float
    noise_um: float
    p_value: float  # corrected for the number of places looked at


@dataclass(frozen=True, eq=False)
class Residual:
    """What a fit leaves."""

    p_value: float  # that errors alone leave as much structure
    places: tuple[Place, ...]  # the most significant first
    by_errors: float  # the same p value, whatever repeats say


def look(
    records: Sequence[Record], errors: Covariance, deflections_mm: Sequence[Array], unknowns: int
) -> Residual:
    """Return the structure in the residuals of fitted deflections, one array a record.

    Two tests: means over stretches of each phase (χ² of their squares), and the products of samples
    a few apart (white noise has none; what goes up and down does at all of these). The mesh's
    probable share is taken off first. Structure that errors alone hardly have counts where repeats
    have it in common: what each of them has for itself is no fault of the model, whatever it is.
    """
    chances = _chances(records, errors, deflections_mm, unknowns)
    return _residual(records, errors, deflections_mm, *chances)


def _left(
    records: Sequence[Record], errors: Covariance, deflections_mm: Sequence[Array]
) -> tuple[list[Array], list[Array]]:
    """Return what is left of each record, mm, and the same white by the errors."""
    both = zip(records, deflections_mm, strict=True)
    off = [r.straight_mm - w for r, w in both]
    return off, errors.split(errors.without_columns(np.concatenate(off)))


def _residual(
    records: Sequence[Record],
    errors: Covariance,
    deflections_mm: Sequence[Array],
    p_value: float,
    by_errors: float,
) -> Residual:
    """Return these p values, and all stretches, the most significant first."""
    places: list[tuple[float, Place]] = []
    off, left = _left(records, errors, deflections_mm)
    for record, z, raw in zip(records, left, off, strict=True):
        for begin, end in _stretches(record):
            score = abs(_score(z, begin, end))
            at = slice(begin, end)
            p, t = record.curve.pressure_mbar[at], record.curve.time_s[at]
            place = Place(
                record.name,
                str(record.curve.phase[begin]),
                (float(p.min()), float(p.max())),
                (float(t[0]), float(t[-1])),
                1e3 * float(raw[at].mean()),
                record.noise_um,
                2.0 * float(ndtr(-score)),
            )
            places.append((score, place))
    places.sort(key=lambda item: -item[0])
    corrected = (replace(p, p_value=min(1.0, p.p_value * len(places))) for _, p in places)
    return Residual(p_value, tuple(corrected), by_errors)


def _chances(
    records: Sequence[Record], errors: Covariance, deflections_mm: Sequence[Array], unknowns: int
) -> tuple[float, float]:
    """Return the p value that errors alone leave as much, and that whatever repeats say."""
    _, left = _left(records, errors, deflections_mm)
    pairs, scores = 0, []
    product = -sum(errors.expected_product(apart) for apart in _LAGS)
    for record, z in zip(records, left, strict=True):
        product += _neighbours(z)
        pairs += _pairs(z)
        scores += [_score(z, *at) for at in _stretches(record)]
    freedom = max(len(scores) - unknowns, 1)
    by_means = float(chdtrc(freedom, sum(score**2 for score in scores)))
    # Of very many samples a correlation that no effect makes is many deviations.
    by_neighbours = float(ndtr((ERRORS.neighbours_left * pairs - product) / np.sqrt(max(pairs, 1))))
    chance = by_errors = min(1.0, 2.0 * min(by_means, by_neighbours))
    if ERRORS.hardly <= by_errors < ERRORS.no_doubt:
        means, neighbours = _in_common(records, left, unknowns)
        chance = min(1.0, 2.0 * min(max(by_means, means), max(by_neighbours, neighbours)))
    return chance, by_errors


def _in_common(
    records: Sequence[Record], left: Sequence[Array], unknowns: int
) -> tuple[float, float]:
    """Return p values that repeats have no more structure in common than each for itself.

    Of the means of stretches (analysis of variance) and of the products of neighbours. `left` is
    white by the errors, a record each; both are 0 where nothing was repeated.
    """
    means, product, pairs, stretches = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    for members in by_condition(records):
        same = _same_moments(records, members, left)
        places = [at for at in _stretches(records[members[0]]) if at[1] <= same.shape[1]]
        common = np.sqrt(len(same)) * same.mean(axis=0)
        for kind, rows in enumerate((common[None], same - same.mean(axis=0))):
            more = 1 if kind == 0 else len(same) - 1
            product[kind] += sum(_neighbours(row) for row in rows)
            pairs[kind] += more * _pairs(common)
            means[kind] += sum(_score(row, *at) ** 2 for row in rows for at in places)
            stretches[kind] += more * len(places)
    if not stretches[1] or not pairs[1]:
        return 0.0, 0.0
    freedom = max(stretches[0] - unknowns, 1.0)
    ratio = (means[0] / freedom) / (means[1] / stretches[1])
    usual = product[1] / pairs[1]
    spread = np.sqrt(pairs[0] + pairs[0] ** 2 / pairs[1])
    return (
        float(fdtrc(freedom, stretches[1], ratio)),
        float(ndtr(-(product[0] - pairs[0] * usual) / spread)),
    )


def _same_moments(
    records: Sequence[Record], members: Sequence[int], left: Sequence[Array]
) -> Array:
    """Return what is left of repeats (repeats, n) at the first one's samples, while all go on."""
    times = [records[i].curve.time_s - records[i].curve.time_s[0] for i in members]
    lost = _LOST * float(np.median(np.diff(times[0])))
    first = times[0][times[0] <= min(time[-1] for time in times) + lost]
    rows = []
    for time, i in zip(times, members, strict=True):
        after = np.clip(np.searchsorted(time, first), 1, len(time) - 1)
        nearer = first - time[after - 1] < time[after] - first
        rows.append(left[i][np.where(nearer, after - 1, after)])
    return np.array(rows)


def _neighbours(z: Array) -> float:
    return sum(float(z[apart:] @ z[:-apart]) for apart in _LAGS)


def _pairs(z: Array) -> int:
    return sum(len(z) - apart for apart in _LAGS)


def _score(z: Array, begin: int, end: int) -> float:
    return float(z[begin:end].mean() * np.sqrt(end - begin))


def judge(
    records: Sequence[Record],
    judged: Sequence[tuple[Covariance, float]],
    fit: Fit,
    errors: Covariance,
) -> Residual:
    """Return the structure in a fit's residuals where the errors are known by probabilities only.

    The p value is the mean over the settings of the errors (a posterior predictive one); places are
    those of the likeliest. The fit is that by `errors`. In doubt each setting looks at its own
    optimum, along the fit's slopes: where placements may differ by 3 % a fit ends 10 µm beside the
    curves, in common, of places which hardly differ, and that is no structure.
    """
    unknowns, likeliest = len(fit.unknowns), judged[0][0]
    first = _chances(records, likeliest, fit.deflections_mm, unknowns)
    if first[1] >= ERRORS.no_doubt:
        return _residual(records, likeliest, fit.deflections_mm, *first)
    linear = Linearised.of(fit, errors, np.concatenate([r.straight_mm for r in records]))
    here_mm = linear.explained_mm(errors)  # of a fit that ended early this is not all taken off

    def own_mm(setting: Covariance) -> list[Array]:
        moved = setting.split(linear.explained_mm(setting) - here_mm)
        return [w + m for w, m in zip(fit.deflections_mm, moved, strict=True)]

    each = [_chances(records, setting, own_mm(setting), unknowns) for setting, _ in judged]
    p_value, by_errors = np.dot([share for _, share in judged], each)
    return _residual(records, likeliest, own_mm(likeliest), float(p_value), float(by_errors))


class Steps(NamedTuple):
    """By how much a residual has steps that stay, in standard deviations of chance."""

    large: float  # of each step what is beyond its first µm
    every: float  # of all of it

    @property
    def sudden(self) -> bool:
        """Whether something has let go."""
        return self.large >= NAMES.steps

    @property
    def small(self) -> bool:
        """Whether something has that what moves in time alone may have taken for itself, nearly.

        Steps are then far from chance, and large ones are as chance has them: with little noise
        what a model is off by is many deviations, and never large.
        """
        return self.every >= NAMES.small_steps and self.large >= NAMES.no_fewer


def steps(
    records: Sequence[Record],
    errors: Covariance,
    residual_mm: Array,
    unrounded: Covariance | None = None,
) -> Steps:
    """Return by how much a residual (u,) has steps that stay.

    Of each curve the one step that takes most off χ², all curves added up, against the same of
    errors that are drawn, and rounded as the readings are: where rounding is among the errors,
    those without (`unrounded`). Tape that lets go does this; what is smooth, and what wanders as
    the errors or as zeros do, does not: most of a long curve's walk looks like one step. Of what is
    left of a step its first µm is no tape's, but what a model may be off by: with little noise that
    is many deviations. Nor does tape let go before anything pulls: there the suction is known to a
    share of a millibar, for which a soft skin moves by 20 µm.
    """
    errors = _with_walks(records, errors)
    rng = np.random.default_rng(0)
    white = rng.standard_normal((errors.count, ERRORS.drawn))
    drawn = errors.colour(white)
    before = drawn if unrounded is None else _with_walks(records, unrounded).colour(white)
    model = np.concatenate([r.at_pressure_mm for r in records]) - residual_mm
    parts = (errors.split(values) for values in (drawn, before, model))
    for record, part, read, own in zip(records, *parts, strict=True):
        rounding = Rounding.of(record)
        if rounding.step_mm > 0.0:
            part[:] = _rounded(record, rounding, own, read, rng)
    every = np.column_stack([residual_mm, drawn])
    score = errors.transposed_without_columns(errors.without_columns(every))
    large, every_step, chance = 0.0, 0.0, np.zeros(ERRORS.drawn)
    side = ERRORS.step_side
    for record, part in zip(records, errors.split(score), strict=True):
        pulled = np.flatnonzero(record.pressure_mbar > SUCTION.about_zero_mbar)
        begin = max(side, int(pulled[0])) if len(pulled) else len(part)
        if len(part) <= begin + side:
            continue
        since = np.cumsum(part[::-1], axis=0)[::-1][begin:-side]  # of steps there
        usual = np.square(since[:, 1:]).mean(axis=1, keepdims=True)  # a step's information, too
        gains = np.square(since) / usual
        every_step += float(gains[:, 0].max())
        chance += gains[:, 1:].max(axis=0)
        beyond = np.abs(since[:, 0]) - 1e-3 * NAMES.practical_um * usual[:, 0]
        large += float((np.square(np.maximum(beyond, 0.0)) / usual[:, 0]).max())
    mean, sd = float(chance.mean()), max(float(chance.std()), 1e-9)
    return Steps((large - mean) / sd, (every_step - mean) / sd)


def _rounded(
    record: Record, rounding: Rounding, own_mm: Array, errors_mm: Array, rng: np.random.Generator
) -> Array:
    """Return errors (n, m) as the rounding of each reading leaves them, averaged as these were.

    On a hold the mean of two readings jumps by half a step: rounded itself it would not.
    """
    count = record.coarse
    alone = rounding.before_mm * rng.standard_normal((count, *errors_mm.shape))
    alone -= alone.mean(axis=0)
    span = np.gradient(own_mm) if len(own_mm) > 1 else np.zeros_like(own_mm)
    apart = (np.arange(count) - 0.5 * (count - 1)) / count
    true_mm = own_mm + apart[:, None] * span  # (count, n)
    read_mm = true_mm[:, :, None] + errors_mm + alone
    return np.asarray(
        (rounding.step_mm * np.round(read_mm / rounding.step_mm)).mean(axis=0) - own_mm[:, None]
    )


def _with_walks(records: Sequence[Record], errors: Covariance) -> Covariance:
    walks = block_diagonal([walk_shapes(r.curve.time_s) for r in records])
    walks *= 1e-3 * ERRORS.wander_most
    return replace(errors, shapes_mm=np.hstack([errors.columns_mm, walks]), sizes=None)


def _stretches(record: Record) -> list[tuple[int, int]]:
    """Return begin and end of stretches: each phase in parts of about equal length."""
    phase = record.curve.phase
    edges = [0, *(np.flatnonzero(phase[1:] != phase[:-1]) + 1).tolist(), len(phase)]
    found = []
    for begin, end in pairwise(edges):
        parts = min(ERRORS.bins, (end - begin) // ERRORS.bin_fewest)
        if parts < 1:
            continue
        cuts = np.linspace(begin, end, parts + 1).astype(int).tolist()
        found += list(pairwise(cuts))
    return found
