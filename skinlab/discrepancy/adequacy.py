"""Does a fit leave more than noise, and where? What is left is looked at in many places at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtr

from skinlab.discrepancy.records import Record
from skinlab.discrepancy.settings import ERRORS
from skinlab.inference.covariance import Covariance
from skinlab.inference.error_models.quantised import step_um

Array = NDArray[np.float64]


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

    p_value: float  # that noise alone leaves as much structure
    places: tuple[Place, ...]  # the most significant first


def look(
    records: Sequence[Record], errors: Covariance, deflections_mm: Sequence[Array], unknowns: int
) -> Residual:
    """Return the structure in the residuals of fitted deflections, one array a record.

    Two tests: means over stretches of each phase (χ² of their squares), and the products of samples
    a few apart (white noise has none; what goes up and down does at all of these). The mesh's
    probable share is taken off first.
    """
    measured = [r.straight_mm for r in records]
    off = np.concatenate([m - w for m, w in zip(measured, deflections_mm, strict=True)])
    z_all = errors.without_columns(off)
    raw_all = off
    total, count, pairs = 0.0, 0, 0
    lags = range(1, ERRORS.neighbours + 1)
    product = -sum(errors.expected_product(apart) for apart in lags)
    places: list[tuple[float, Place]] = []
    for record, z, raw in zip(records, errors.split(z_all), errors.split(raw_all), strict=True):
        for apart in lags:
            product += float(z[apart:] @ z[:-apart])
            pairs += len(z) - apart
        for begin, end in _stretches(record):
            n = end - begin
            mean = float(z[begin:end].mean())
            score = mean * np.sqrt(n)
            total += score**2
            count += 1
            at = slice(begin, end)
            p, t = record.curve.pressure_mbar[at], record.curve.time_s[at]
            places.append(
                (
                    abs(score),
                    Place(
                        record.name,
                        str(record.curve.phase[begin]),
                        (float(p.min()), float(p.max())),
                        (float(t[0]), float(t[-1])),
                        1e3 * float(raw[at].mean()),
                        record.noise_um,
                        2.0 * float(ndtr(-abs(score))),
                    ),
                )
            )
    freedom = max(count - unknowns, 1)
    by_means = float(chdtrc(freedom, total))
    by_neighbours = float(ndtr(-product / np.sqrt(max(pairs, 1))))
    places.sort(key=lambda item: -item[0])
    corrected = tuple(
        Place(**{**vars(p), "p_value": min(1.0, p.p_value * len(places))}) for _, p in places
    )
    return Residual(min(1.0, 2.0 * min(by_means, by_neighbours)), corrected)


def judge(
    records: Sequence[Record],
    judged: Sequence[tuple[Covariance, float]],
    deflections_mm: Sequence[Array],
    unknowns: int,
) -> Residual:
    """Return the structure in residuals where the errors are known by their probabilities only.

    The p value is the mean over the settings of the errors (a posterior predictive one); places are
    those of the likeliest.
    """
    first = look(records, judged[0][0], deflections_mm, unknowns)
    if first.p_value >= ERRORS.no_doubt:
        return first
    p = judged[0][1] * first.p_value
    for errors, weight in judged[1:]:
        p += weight * look(records, errors, deflections_mm, unknowns).p_value
    return replace(first, p_value=p)


def steps(records: Sequence[Record], errors: Covariance, residual_mm: Array) -> float:
    """Return by how much a residual (u,) has steps that stay, in standard deviations of chance.

    Of each curve the one step that takes most off χ², all curves added up, against the same of
    errors that are drawn, and rounded as the readings are. Tape that lets go does this; what is
    smooth, and what wanders as the errors do, does not.
    """
    drawn = errors.colour(np.random.default_rng(0).standard_normal((errors.count, ERRORS.drawn)))
    model = np.concatenate([r.curve.deflection_mm for r in records]) - residual_mm
    for record, part, own in zip(records, errors.split(drawn), errors.split(model), strict=True):
        lattice = 1e-3 * step_um(record.curve.deflection_mm)
        if lattice > 0.0:
            part[:] = lattice * np.round((own[:, None] + part) / lattice) - own[:, None]
    every = np.column_stack([residual_mm, drawn])
    score = errors.transposed_without_columns(errors.without_columns(every))
    total, side = np.zeros(ERRORS.drawn + 1), ERRORS.step_side
    for part in errors.split(score):
        if len(part) <= 2 * side:
            continue
        since = np.cumsum(part[::-1], axis=0)[::-1][side:-side]  # of steps there
        usual = np.square(since[:, 1:]).mean(axis=1, keepdims=True)
        total += (np.square(since) / usual).max(axis=0)
    chance = total[1:]
    return float((total[0] - chance.mean()) / max(float(chance.std()), 1e-9))


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
