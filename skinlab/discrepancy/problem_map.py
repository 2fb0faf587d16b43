"""What an explanation's unknowns are for the mechanics: solids, and the suctions that they feel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.pressure_path import PressurePath
from skinlab.discrepancy.records import Record
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.errors import InputError
from skinlab.mechanics.effects.base import Effect
from skinlab.mechanics.effects.model import Chosen, Sensors, changed, chosen, felt_along
from skinlab.mechanics.fem.skin import SkinProblem
from skinlab.mechanics.fem.suction import Geometry

Array = NDArray[np.float64]
Key = tuple[Geometry, int]  # as stated; the first cycle, or a later one

_FELT_KNOWN = 16  # paths of so many settings of effects that change them


@dataclass(frozen=True, eq=False)
class Problems:
    """What one set of unknowns is for the mechanics; paths are those of the records."""

    problems: Mapping[Key, SkinProblem]
    sensors: Sensors
    felt: Sequence[PressurePath]
    felt_more: Sequence[PressurePath] = ()  # of 1 mbar more, where readings are bent


@dataclass(frozen=True, eq=False)
class ProblemMap:
    """The problems of all records, as functions of an explanation's unknowns."""

    records: Sequence[Record]
    unknowns: Unknowns
    _felt_known: dict[tuple[object, ...], list[PressurePath]] = field(
        default_factory=dict, repr=False
    )

    def at(self, u: Array) -> Problems | None:
        """Return what unknowns are for the mechanics, None for values that cannot be."""
        return self.at_many(u[None])[0]

    def at_many(self, u: Array) -> list[Problems | None]:
        """Return the same of unknowns (n, k): most of them differ in the law's alone."""
        keys = list(dict.fromkeys(key_of(record) for record in self.records))
        known: dict[bytes, tuple[Chosen, Problems] | None] = {}
        found: list[Problems | None] = []
        count = self.unknowns.count
        for row, law in zip(u, self.unknowns.space.from_coordinates(u[:, :count]), strict=True):
            name = row[count:].tobytes()
            try:
                if name not in known:
                    known[name] = None
                    effects = chosen(self.unknowns.values(row))
                    known[name] = effects, self._with(effects)
                own = known[name]
                if own is None:
                    found.append(None)
                    continue
                effects, like = own
                skin = self.unknowns.skin_of(law)
                problems = {key: changed(skin, effects, *key) for key in keys}
                found.append(Problems(problems, like.sensors, like.felt, like.felt_more))
            except InputError:  # a combination of values that cannot be
                found.append(None)
        return found

    def _with(self, effects: Chosen) -> Problems:
        """Return what effects are for the mechanics, whatever the skin."""
        more = self._felt(effects, 1.0) if any(e.bends for e, _ in effects) else ()
        return Problems({}, Sensors.among(effects), self._felt(effects), more)

    @cached_property
    def paths(self) -> list[int]:
        """Return of each record the first one with the same path."""
        first: dict[PressurePath, int] = {}
        return [first.setdefault(r.path, i) for i, r in enumerate(self.records)]

    @cached_property
    def measured(self) -> list[PressurePath]:
        """The paths as they were measured: what is felt where no effect changes it."""
        return [self.records[i].path for i in self.paths]

    def _felt(self, effects: Chosen, more_mbar: float = 0.0) -> list[PressurePath]:
        changing = [(e, v) for e, v in effects if type(e).felt is not Effect.felt]
        if not more_mbar and not changing:
            return self.measured
        # Most candidates differ in something else: the same paths are recognised as such.
        name = (more_mbar, *((e.name, tuple(v.values())) for e, v in changing))
        if name in self._felt_known:
            return self._felt_known[name]
        known: dict[int, PressurePath] = {}
        for i in sorted(set(self.paths)):
            path = self.records[i].path
            if more_mbar:
                higher = tuple(p + more_mbar for p in path.pressure_mbar)
                path = replace(path, pressure_mbar=higher)
            known[i] = felt_along(changing, path)
        found = [known[i] for i in self.paths]
        while len(self._felt_known) >= _FELT_KNOWN:
            del self._felt_known[next(iter(self._felt_known))]
        self._felt_known[name] = found
        return found

    def needed_mbar(self, candidate: Problems, key: Key) -> float:
        """Return the highest suction that is felt under this opening."""
        return max(candidate.felt[i].top_mbar for i in self._under[key[0]])

    @cached_property
    def _under(self) -> dict[Geometry, list[int]]:
        """The records under each opening."""
        found: dict[Geometry, list[int]] = {}
        for i, record in enumerate(self.records):
            found.setdefault(record.geometry, []).append(i)
        return found

    def top_mbar(self, candidate: Problems, key: Key) -> float:
        """Return the suction up to which it is solved: what has relaxed by the end is on top."""
        problem, terms = candidate.problems[key], candidate.problems[key].prony
        paths = [candidate.felt[i] for i in self._under[key[0]]]
        lasts_s = max(path.time_s[-1] - path.time_s[0] for path in paths)
        # Of the stress, as far as it can have relaxed by the end of a curve; before it, for good.
        share = -sum(term.g * math.expm1(-lasts_s / term.tau_s) for term in terms)
        before_mbar = problem.preload_mbar / (1.0 - sum(term.g for term in terms))
        # In coarse steps: what is solved is kept by it.
        wanted = 1.02 * self.needed_mbar(candidate, key) / (1.0 - share) + before_mbar
        return float(np.ceil(wanted / 20.0) * 20.0)


def key_of(record: Record) -> Key:
    """Return by what a record's solid differs from others of the same unknowns."""
    return record.geometry, record.curve.setup.cycle
