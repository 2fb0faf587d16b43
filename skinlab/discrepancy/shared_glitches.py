"""Samples left out at the same moments of all repeats: what repeats share is no glitch of one.

A valve that clicks or a sensor that rings is off whenever the program turns. One curve alone would
call that a glitch, as it would a movement of the skin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.records import Record, by_condition
from skinlab.discrepancy.settings import ERRORS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SharedGlitches:
    """When samples of all repeats of one program were left out."""

    files: tuple[str, ...]
    time_s: tuple[float, ...]  # of the first repeat, one of a run


def shared_glitches(records: Sequence[Record]) -> list[SharedGlitches]:
    """Return them, of each program whose repeats share more moments than chance would give."""
    groups = [[records[i] for i in members] for members in by_condition(records)]
    found = [(group, _shared_s(group)) for group in groups if len(group) > 1]
    return [SharedGlitches(tuple(r.name for r in group), when) for group, when in found if when]


def _shared_s(repeats: Sequence[Record]) -> tuple[float, ...]:
    """Return the moments at which each repeat has samples left out, one sample off at most."""
    each = [np.array(r.left_out_s) for r in repeats]
    if not all(len(times) for times in each):
        return ()
    near = 1.5 * max(float(np.median(np.diff(r.curve.time_s))) / r.coarse for r in repeats)
    first, *others = [_one_of_a_run(times, near) for times in each]
    shared = first[np.all([_distance(first, times) <= near for times in others], axis=0)]
    lasts = max(float(np.ptp(r.curve.time_s)) for r in repeats)
    by_chance = len(first) * np.prod([min(1.0, 2.0 * near * len(o) / lasts) for o in others])
    from scipy.stats import poisson  # slow to import

    if poisson.sf(len(shared) - 1, by_chance) > ERRORS.by_chance:
        return ()
    return tuple(shared.tolist())


def _one_of_a_run(times: Array, near: float) -> Array:
    """Return the first time (m,) of each run of times (n,) that are neighbours."""
    ordered = np.sort(times)
    return ordered[np.diff(ordered, prepend=-np.inf) > near]


def _distance(times: Array, others: Array) -> Array:
    """Return how far times (n,) are from the nearest of some others (m,)."""
    return np.asarray(np.abs(times[:, None] - others).min(axis=1))
