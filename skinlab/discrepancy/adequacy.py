"""Does a fit leave more than noise, and where? What is left is looked at in many places at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from skinlab.discrepancy.records import Record
from skinlab.inference.covariance import Covariance
from skinlab.inference.noise import roughness

Array = NDArray[np.float64]

_BINS = 6  # of a phase of a curve
_FEWEST = 6  # samples of a bin
_NEIGHBOURS = 3  # samples apart: beyond what chance does to one distance, within a heartbeat
_SIGMA_SD = 0.03  # relative uncertainty of a noise that was estimated from a whole campaign
_MOST_OFF = 0.15
ADEQUATE = 1e-3  # a fit whose residual is less likely than this leaves more than noise


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
    up to `_NEIGHBOURS` apart (white noise has none; what goes up and down does at all of these).
    The mesh's probable share is taken off first.
    """
    measured = [r.curve.deflection_mm for r in records]
    off = np.concatenate([m - w for m, w in zip(measured, deflections_mm, strict=True)])
    z_all = errors.without_columns(off)
    raw_all = off
    total, count, pairs = 0.0, 0, 0
    lags = range(1, _NEIGHBOURS + 1)
    product = -sum(errors.expected_product(apart) for apart in lags)
    places: list[tuple[float, Place]] = []
    scale = _noise_scale(records, errors.split(z_all))
    for record, z, raw in zip(
        records, errors.split(z_all / scale), errors.split(raw_all), strict=True
    ):
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
                        2.0 * float(norm.sf(abs(score))),
                    ),
                )
            )
    freedom = max(count - unknowns, 1)
    by_means = float(chi2.sf(total, freedom))
    by_neighbours = float(norm.sf(product / np.sqrt(max(pairs, 1))))
    places.sort(key=lambda item: -item[0])
    corrected = tuple(
        Place(**{**vars(p), "p_value": min(1.0, p.p_value * len(places))}) for _, p in places
    )
    return Residual(min(1.0, 2.0 * min(by_means, by_neighbours)), corrected)


def _noise_scale(records: Sequence[Record], z: Sequence[Array]) -> float:
    """Return by how much the noise may be larger than said, which must not look like structure.

    A stated noise is taken at its word; an estimated one is corrected by how rough the residuals
    are, as far as an estimate may be off.
    """
    if all(r.noise_is_stated for r in records):
        return 1.0
    rough = float(np.sqrt(np.average([roughness(v) ** 2 for v in z], weights=[len(v) for v in z])))
    return float(np.clip(rough, 1.0, 1.0 + _MOST_OFF)) * (1.0 + _SIGMA_SD)


def _stretches(record: Record) -> list[tuple[int, int]]:
    """Return begin and end of stretches: each phase in parts of about equal length."""
    phase = record.curve.phase
    edges = [0, *(np.flatnonzero(phase[1:] != phase[:-1]) + 1).tolist(), len(phase)]
    found = []
    for begin, end in pairwise(edges):
        parts = min(_BINS, (end - begin) // _FEWEST)
        if parts < 1:
            continue
        cuts = np.linspace(begin, end, parts + 1).astype(int).tolist()
        found += list(pairwise(cuts))
    return found
