"""All curves of a campaign as functions of an explanation's unknowns, exact at the anchor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.pressure_path import PressurePath
from skinlab.discrepancy.records import Record
from skinlab.discrepancy.table_domes import (
    Dome,
    TableDomes,
    has_features,
    plain_part,
    relaxed_pressure,
)
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.errors import InputError
from skinlab.mechanics.effects.model import Effects, Sensors, felt_path, problem_of, solve_skin
from skinlab.mechanics.fem.skin import SkinProblem
from skinlab.mechanics.fem.suction import MESH_OF_RECORD, Discretisation, Geometry

Array = NDArray[np.float64]

_RATIO_NODES = 40
_EFFECT_STEP = 0.15  # of an effect's unknown
_LEAST_HELD = 0.7  # of the suction that is needed: a skin that creases before has no answer
_TREND = 5  # nodes from which a correction goes on beyond


@dataclass(eq=False)
class _Learnt:
    """A correction at the anchor, and how it changes with the unknowns."""

    value: Array  # (m,)
    slopes: Array  # (m, k)

    def at(self, off: Array) -> Array:
        """Return the correction (m,) off the anchor by (k,)."""
        return np.asarray(self.value + self.slopes @ off)

    def move(self, value: Array, off: Array) -> None:
        """Take the next anchor, and learn from it how the correction changes (Broyden 1965)."""
        length = float(off @ off)
        if length > 1e-12:
            self.slopes = self.slopes + np.outer((value - self.at(off)) / length, off)
        self.value = value


@dataclass(eq=False)
class MappedModel:
    """Deflections of all records for given unknowns; NaN arrays where there is no model."""

    records: Sequence[Record]
    unknowns: Unknowns
    domes: TableDomes
    discretisation: Discretisation = MESH_OF_RECORD
    _anchor: Array | None = None
    _ratios: dict[tuple[Geometry, int], tuple[Array, _Learnt]] = field(default_factory=dict)
    _courses: dict[int, _Learnt] = field(default_factory=dict)
    _felt: list[PressurePath] = field(default_factory=list)  # of each record, at the last unknowns

    def _feel(self, effects: Effects) -> None:
        """Take the suctions that the skin feels with these effects."""
        self._felt = [felt_path(effects, r.path) for r in self.records]

    @property
    def corrected(self) -> bool:
        """Whether the finite elements correct the table anywhere."""
        return bool(self._ratios or self._courses)

    def predict(self, u: Array) -> list[Array]:
        """Return the deflections (n,) of each record, mm."""
        skin, effects = self.unknowns.skin(u), self.unknowns.values(u)
        sensors = Sensors.of(effects)
        self._feel(effects)
        off = np.zeros(len(u)) if self._anchor is None else u - self._anchor
        known: dict[tuple[Geometry, int], tuple[SkinProblem, Dome | None]] = {}
        found = []
        for i, record in enumerate(self.records):
            cycle = record.curve.setup.cycle
            key = (record.geometry, cycle)
            if key not in known:
                try:
                    problem = problem_of(skin, effects, record.geometry, cycle)
                    known[key] = problem, self._dome(problem, record.geometry)
                except InputError:  # a combination of values that cannot be
                    return [np.full(len(r.curve), np.nan) for r in self.records]
            problem, dome = known[key]
            if dome is None:
                found.append(np.full(len(record.curve), np.nan))
                continue
            found.append(self._read(i, record, problem, dome, key, sensors, off))
        return found

    def _read(
        self,
        i: int,
        record: Record,
        problem: SkinProblem,
        dome: Dome,
        key: tuple[Geometry, int],
        sensors: Sensors,
        off: Array,
    ) -> Array:
        time, path = record.curve.time_s, self._felt[i]
        when = sensors.when(time)
        pressure = path(when)
        aside = record.pressure_mbar - record.path(time)
        if np.any(aside):
            pressure = pressure + (aside if when is time else np.interp(when, time, aside))
        zero = problem.preload_mbar
        if problem.prony:
            relaxed, zero = relaxed_pressure(problem.prony, path, when, problem.preload_mbar)
            pressure = relaxed + (pressure - path(when))
        else:
            pressure = pressure + zero
        w = self._height(pressure, problem, dome, key, off)
        if zero:
            w = w - self._height(np.array([zero]), problem, dome, key, off)[0]
        if problem.prony and i in self._courses:
            w = w + np.interp(when, time, self._courses[i].at(off))
        return sensors.read(time, w, float(time[0]))

    def _height(
        self,
        pressure: Array,
        problem: SkinProblem,
        dome: Dome,
        key: tuple[Geometry, int],
        off: Array,
    ) -> Array:
        w = dome(pressure / problem.stiffness)
        if key in self._ratios:
            nodes, learnt = self._ratios[key]
            w = w * np.exp(np.interp(pressure, nodes, learnt.at(off)))
        return w

    def _dome(self, problem: SkinProblem, stated: Geometry) -> Dome | None:
        top = self._top_mbar(problem, stated)
        return self.domes(problem, stated, top / problem.stiffness)

    def _top_mbar(self, problem: SkinProblem, stated: Geometry) -> float:
        share = sum(term.g for term in problem.prony)
        tops = [
            p.top_mbar
            for r, p in zip(self.records, self._felt, strict=True)
            if r.geometry == stated
        ]
        # In coarse steps: models of the table are kept by it.
        wanted = (1.02 * max(tops) + problem.preload_mbar) / (1.0 - share)
        return float(np.ceil(wanted / 20.0) * 20.0)

    # ---- the finite elements ----

    def anchor(self, u: Array, *, slopes: bool = True, afresh: bool = False) -> bool:
        """Solve the finite elements at u, so that the model is exact there.

        With `slopes` the first anchor also learns how the correction changes around it, and with
        `afresh` a later one does so again. Returns False where they do not hold over most of the
        pressures.
        """
        problems = self._problems(u)
        if problems is None:
            return False
        first = self._anchor is None
        off = np.zeros(len(u)) if self._anchor is None else u - self._anchor
        for key, (problem, _) in problems.items():
            if not has_features(problem):
                self._ratios.pop(key, None)
                continue
            top = self._top_mbar(problem, key[0])
            nodes = np.concatenate([[-5.0], top * np.linspace(0.02, 1.0, _RATIO_NODES) ** 1.5])
            value = self._ratio(problem, key[0], nodes)
            if value is None:
                return False
            if first or afresh or key not in self._ratios:
                changes = np.zeros((len(nodes), len(u)))
                if slopes:
                    changes = self._ratio_slopes(u, key, nodes, value)
                self._ratios[key] = (nodes, _Learnt(value, changes))
            else:
                old_nodes, learnt = self._ratios[key]
                if not np.array_equal(old_nodes, nodes):
                    change = [
                        np.interp(nodes, old_nodes, column)
                        for column in (learnt.value, *learnt.slopes.T)
                    ]
                    learnt.value, learnt.slopes = change[0], np.column_stack(change[1:])
                learnt.move(value, off)
                self._ratios[key] = (nodes, learnt)
        self._anchor = u.copy()
        return self._anchor_courses(u, problems, off)

    def _problems(self, u: Array) -> dict[tuple[Geometry, int], tuple[SkinProblem, int]] | None:
        skin, effects = self.unknowns.skin(u), self.unknowns.values(u)
        self._feel(effects)
        found = {}
        for record in self.records:
            cycle = record.curve.setup.cycle
            try:
                problem = problem_of(skin, effects, record.geometry, cycle)
            except InputError:
                return None
            found[record.geometry, cycle] = problem, cycle
        return found

    def _ratio(self, problem: SkinProblem, stated: Geometry, nodes: Array) -> Array | None:
        """Return log w_FE / w_table at the nodes (m,), None where either does not hold."""
        dome = self._dome(problem, stated)
        top = float(nodes[-1])
        path = PressurePath((0.0, 1.0), (0.0, top))
        elastic = replace(problem, prony=(), preload_mbar=0.0)
        solved = solve_skin(elastic, path, self.discretisation)
        instant = solved.instant
        needed = max(
            p.top_mbar
            for r, p in zip(self.records, self._felt, strict=True)
            if r.geometry == stated
        )
        if dome is None or instant is None or solved.holds_to_mbar < _LEAST_HELD * needed:
            return None
        plain = dome(nodes / problem.stiffness)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.log(instant(nodes) / plain)
        held = nodes <= min(solved.holds_to_mbar, top)
        if not np.isfinite(ratio[held]).all():
            return None
        return _read_on(nodes, ratio, held)

    def _ratio_slopes(
        self, u: Array, key: tuple[Geometry, int], nodes: Array, value: Array
    ) -> Array:
        """Return the derivatives (m, k) of the log ratio, by differences of finite elements."""
        slopes = np.zeros((len(nodes), len(u)))
        base = self._problems(u)
        high = self.unknowns.bounds[1]
        steps, count = self.unknowns.steps, self.unknowns.count
        for j in range(len(u)):
            step = float(steps[j]) if j < count else _EFFECT_STEP
            moved = u.copy()
            moved[j] += step if u[j] + step <= high[j] else -step
            problems = self._problems(moved)
            if problems is None or base is None:
                continue
            if j >= count and problems[key][0] == base[key][0]:
                continue  # this unknown leaves the solid alone
            if j >= count and _same_features(problems[key][0], base[key][0]):
                continue
            ratio = self._ratio(problems[key][0], key[0], nodes)
            if ratio is not None:
                slopes[:, j] = (ratio - value) / (moved[j] - u[j])
        return slopes

    def _anchor_courses(
        self,
        u: Array,
        problems: dict[tuple[Geometry, int], tuple[SkinProblem, int]],
        off: Array,
    ) -> bool:
        """Correct what relaxes, curve by curve."""
        none = np.zeros(len(u))
        for i, record in enumerate(self.records):
            key = (record.geometry, record.curve.setup.cycle)
            problem = problems[key][0]
            if not problem.prony:
                self._courses.pop(i, None)
                continue
            dome = self._dome(problem, record.geometry)
            if dome is None:
                return False
            time = record.curve.time_s
            path = self._felt[i]
            solved = solve_skin(problem, path, self.discretisation)
            exact = solved.at(time, path(time))
            if np.isfinite(exact).mean() < 0.9:
                return False
            plain = replace_path_pressure(record)
            before = self._courses.pop(i, None)
            at_anchor = self._read(i, plain, problem, dome, key, Sensors(()), none)
            correction = np.interp(
                time, time[np.isfinite(exact)], (exact - at_anchor)[np.isfinite(exact)]
            )
            if before is None:
                self._courses[i] = _Learnt(correction, np.zeros((len(time), len(u))))
            else:
                before.move(correction, off)
                self._courses[i] = before
        return True


def _read_on(nodes: Array, values: Array, held: NDArray[np.bool_]) -> Array:
    """Return values (m,) that go on straight beyond where they are held.

    Where a skin creases differs between two good meshes by a tenth and more; what the dome does on
    the way there tells more than where it ends.
    """
    beyond = ~held
    if not beyond.any():
        return values
    x, y = nodes[held][-_TREND:], values[held][-_TREND:]
    slope = np.polyfit(x, y, 1)[0]
    return np.where(held, values, y[-1] + slope * (nodes - x[-1]))


def replace_path_pressure(record: Record) -> Record:
    """Return the record with its pressures on the path."""
    return replace(record, pressure_mbar=record.path(record.curve.time_s))


def _same_features(one: SkinProblem, other: SkinProblem) -> bool:
    """Return whether two problems differ only in what the table and the stepping answer."""

    def bare(problem: SkinProblem) -> SkinProblem:
        return replace(problem, prony=(), preload_mbar=0.0)

    return bare(one) == bare(other) or plain_part(one) != plain_part(other)
