"""Curves of a campaign as the table tells them, corrected by what finite elements say of domes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.corrections import Learnt, between
from skinlab.discrepancy.problem_map import Key, ProblemMap, Problems, key_of
from skinlab.discrepancy.records import Record
from skinlab.discrepancy.table_domes import Domes, Relaxation
from skinlab.mechanics.fem.skin import SkinProblem

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TableCurves:
    """Deflections of records, of several candidates for a skin and what is missing at once.

    `ratios` are nodes (mbar), and log of what finite elements say over what the table says there.
    """

    problems: ProblemMap
    ratios: Mapping[Key, tuple[Array, Learnt]]

    def __call__(
        self,
        which: Sequence[int],
        records: Sequence[Record],
        candidates: Sequence[Problems],
        domes: Domes,
        off: Array,
        relaxation: Relaxation | None,
    ) -> list[Array]:
        """Return the deflections (candidates, n) as far as the table tells how they relax.

        Of records of one key, `which` of the model's they are like: asked for at once.
        """
        key = key_of(records[0])
        problems = [c.problems[key] for c in candidates]
        zero = np.array([p.preload_mbar for p in problems])
        if relaxation is not None:
            zero = zero / relaxation.rest
        unchanged = all(c.felt is self.problems.measured and not c.sensors.late for c in candidates)
        if unchanged and relaxation is None:
            pressure = np.hstack([r.on_path_mbar + r.off_path_mbar for r in records])[None]
        else:
            both = zip(which, records, strict=True)
            pressure = np.hstack([self._felt(i, r, candidates, relaxation) for i, r in both])
        pressure = pressure + (zero if zero.any() else zero[:1])[:, None]
        stiffness = np.array([[p.stiffness] for p in problems])
        if (stiffness == stiffness[0]).all():
            stiffness = stiffness[:1]
        w = self._height(pressure, stiffness, domes, key, off)
        if zero.any():
            w = w - self._height(zero[:, None], stiffness, domes, key, off)
        return np.split(w, np.cumsum([len(r.curve) for r in records])[:-1], axis=1)

    def _felt(
        self,
        i: int,
        record: Record,
        candidates: Sequence[Problems],
        relaxation: Relaxation | None,
    ) -> Array:
        """Return the suctions (candidates, n), without preload, that would dome a skin at once."""
        time = record.curve.time_s
        when = read_at(candidates, time)
        felt: dict[int, list[int]] = {}  # by what is felt: the candidates
        for j, c in enumerate(candidates):
            felt.setdefault(id(c.felt[i]), []).append(j)
        groups = [(candidates[rows[0]].felt[i], tuple(rows)) for rows in felt.values()]
        # A reading's own noise stays with its sample whatever lags: read between two samples it
        # would be less, and half a sample of lag look better than none.
        off_path = record.off_path_mbar
        if off_path.any() and any(c.felt_more for c in candidates):
            more = [
                c.felt_more[i](time) - c.felt[i](time) if c.felt_more else 1.0 for c in candidates
            ]
            off_path = off_path * np.array([np.broadcast_to(m, time.shape) for m in more])
        pressure = np.empty((len(candidates), len(time)))
        for path, rows in groups:
            at = when if len(when) == 1 else when[list(rows)]
            pressure[list(rows)] = path(at) if relaxation is None else relaxation(path, at, rows)
        if relaxation is not None:
            # It is worth what a smooth rise is: a skin that is stiff for an instant alone would
            # follow no noise, and be likelier than any other by that.
            off_path = off_path / (1.0 - relaxation.relaxed_share(record.path.rise_s))[:, None]
        return np.asarray(pressure + off_path)

    def _height(
        self, pressure: Array, stiffness: Array, domes: Domes, key: Key, off: Array
    ) -> Array:
        w = domes(pressure / stiffness)
        if key in self.ratios:
            nodes, learnt = self.ratios[key]
            w = w * np.exp(between(nodes, learnt.at(off), pressure))
        return w


def read_at(candidates: Sequence[Problems], time: Array) -> Array:
    """Return when each candidate's dome is read (candidates, n), or (1, n) for all."""
    if not any(c.sensors.late for c in candidates):
        return time[None]
    return np.array([c.sensors.when(time) for c in candidates])


def recorded(record: Record, candidates: Sequence[Problems], w: Array) -> Array:
    """Return what each candidate's sensors make (candidates, n) of deflections like these."""
    if not any(c.sensors.chain for c in candidates):
        return w
    time, p = record.curve.time_s, record.on_path_mbar
    rows = zip(candidates, w, strict=True)
    return np.array([c.sensors.read(time, p, row, record.began_s) for c, row in rows])


def relaxation_of(problems: Sequence[SkinProblem]) -> Relaxation | None:
    """Return how the suction of these skins relaxes, None where nothing does."""
    terms = [problem.prony for problem in problems]
    return Relaxation.of(terms) if any(terms) else None
