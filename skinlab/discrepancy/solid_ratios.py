"""By what the finite elements correct the table, for solids with features that it knows not."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.corrections import Learnt, read_on
from skinlab.discrepancy.problem_map import Key, ProblemMap, Problems
from skinlab.discrepancy.settings import FITS
from skinlab.discrepancy.table_domes import TableDomes, has_features, plain_part
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.errors import InputError
from skinlab.mechanics.effects.model import Instant
from skinlab.mechanics.fem.admissibility import FOLDED
from skinlab.mechanics.fem.newton import StepSettings
from skinlab.mechanics.fem.sensitivity import Change, Slopes, solve_with_slopes
from skinlab.mechanics.fem.skin import SkinProblem
from skinlab.mechanics.fem.suction import MESH_OF_RECORD, SCREENING_MESH, Discretisation

Array = NDArray[np.float64]

_RATIO_NODES = 40
_SMALL = 1e-3  # of an unknown, for slopes: what is left out is its square
_EFFECT_STEP = 0.15  # of an effect's unknown, where the mesh changes and there is no slope


@dataclass(frozen=True, eq=False)
class SolidRatios:
    """Log of what finite elements say over what the table says, of elastic solids by the suction.

    `offs` are heights, and by how much a coarse mesh is off there, of each opening: found once.
    """

    problems: ProblemMap
    domes: TableDomes
    discretisation: Discretisation
    offs: dict[Key, tuple[Array, Array]] = field(default_factory=dict, repr=False)

    @property
    def unknowns(self) -> Unknowns:
        """Those of the explanation."""
        return self.problems.unknowns

    def keys_at(self, u: Array, here: Problems) -> list[Key]:
        """Return what the table does not answer there, or where each effect is something.

        Anchored where an effect is nothing the model would be the same for all of its sizes.
        """
        beside, effects = u.copy(), slice(self.unknowns.count, None)
        up = u + _EFFECT_STEP <= self.unknowns.bounds[1]
        beside[effects] += np.where(up, _EFFECT_STEP, -_EFFECT_STEP)[effects]
        problems = [p.problems for p in (here, self.problems.at(beside)) if p is not None]
        return [key for key in here.problems if any(has_features(p[key]) for p in problems)]

    def at(
        self, u: Array, here: Problems, keys: Collection[Key], *, slopes: bool = True
    ) -> dict[Key, tuple[Array, Learnt]] | None:
        """Return what the finite elements correct of solids, None where they do not hold."""
        found: dict[Key, tuple[Array, Learnt]] = {}
        for key, changes in self.changes(u, keys, slopes=slopes).items():
            one = self._ratio(u, here, key, changes)
            if one is None:
                return None
            found[key] = one
        return found

    def changes(
        self, u: Array, keys: Collection[Key], *, slopes: bool = True
    ) -> dict[Key, dict[int, Change]]:
        """Return how solids change with each unknown that moves them; without `slopes` nothing."""
        low, high = self.unknowns.bounds
        found: dict[Key, dict[int, Change]] = {key: {} for key in keys}
        for j in range(len(u)) if slopes and keys else ():
            up, down = min(_SMALL, high[j] - u[j]), min(_SMALL, u[j] - low[j])
            ends = [self.problems.at(moved(u, j, step)) for step in (up, -down)]
            if ends[0] is None or ends[1] is None or up + down <= 0.0:
                continue
            for key in keys:
                one, other = (bare(end.problems[key]) for end in ends if end is not None)
                if one != other:
                    found[key][j] = (one, other, float(up + down))
        return found

    def _ratio(
        self, u: Array, here: Problems, key: Key, changes: dict[int, Change]
    ) -> tuple[Array, Learnt] | None:
        """Return nodes (m,) and log w_FE / w_table there; None where either does not hold.

        With how it changes along the unknowns that are given a change.
        """
        problem, top = here.problems[key], self.problems.top_mbar(here, key)
        nodes = np.concatenate([[-5.0], top * np.linspace(0.02, 1.0, _RATIO_NODES) ** 1.5])
        try:
            solved = _solve(bare(problem), tuple(changes.values()), top, self.discretisation)
        except InputError:  # a change of the mesh's topology
            beside = {j: c for j, c in changes.items() if j >= self.unknowns.count}
            changes = {j: c for j, c in changes.items() if j not in beside}
            solved = _solve(bare(problem), tuple(changes.values()), top, self.discretisation)
        else:
            beside = {}
        needed = self.problems.needed_mbar(here, key)
        if solved.instant is None or solved.holds_to_mbar < FITS.least_held * needed:
            return None
        held = nodes <= min(solved.holds_to_mbar, top)
        w, plain = solved.instant(nodes), self._plain([problem], top, nodes)[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            value = np.log(w / plain) - self.off(problem, key, top, plain)
        if not np.isfinite(value[held]).all():
            return None
        learnt = Learnt(read_on(nodes, value, held), np.zeros((len(nodes), len(u))))
        by_parameter = solved.slopes(nodes) if changes else ()
        for (j, (up, down, width)), slope in zip(changes.items(), by_parameter, strict=True):
            ends = self._plain([up, down], top, nodes)
            with np.errstate(divide="ignore", invalid="ignore"):
                column = slope / w - np.log(ends[0] / ends[1]) / width
            there = held & np.isfinite(column)
            if there.any():
                learnt.slopes[:, j] = read_on(nodes, column, there)
        for j in beside:
            other = self._moved_ratio(u, j, key, nodes, needed)
            if other is not None:
                learnt.slopes[:, j] = (other[0] - learnt.value) / other[1]
        return nodes, learnt

    def _moved_ratio(
        self, u: Array, j: int, key: Key, nodes: Array, needed_mbar: float
    ) -> tuple[Array, float] | None:
        """Return the log ratio (m,) with an effect's unknown some way off, and how far."""
        step = _EFFECT_STEP if u[j] + _EFFECT_STEP <= self.unknowns.bounds[1][j] else -_EFFECT_STEP
        there = self.problems.at(moved(u, j, step))
        if there is None:
            return None
        problem, top = there.problems[key], float(nodes[-1])
        solved = _solve(bare(problem), (), top, self.discretisation)
        if solved.instant is None or solved.holds_to_mbar < FITS.least_held * needed_mbar:
            return None
        with np.errstate(divide="ignore", invalid="ignore"):
            plain = self._plain([problem], top, nodes)[0]
            value = np.log(solved.instant(nodes) / plain) - self.off(problem, key, top, plain)
        held = nodes <= min(solved.holds_to_mbar, top)
        if not np.isfinite(value[held]).all():
            return None
        return read_on(nodes, value, held), step

    def _plain(self, problems: Sequence[SkinProblem], top: float, nodes: Array) -> Array:
        """Return what the table answers (n, m)."""
        stiffness = np.array([[p.stiffness] for p in problems])
        domes = self.domes(problems, [top / p.stiffness for p in problems])
        return domes(nodes / stiffness)

    def off(self, problem: SkinProblem, key: Key, top: float, deflection_mm: Array) -> Array:
        """Return by how much this mesh is off at heights (m,), of their logarithm.

        It is that of the plain skin, which the table knows, where this model was anchored first: of
        a coarse mesh an effect is nearly right, the dome is not. The mesh of record made the table.
        """
        if self.discretisation == MESH_OF_RECORD:
            return np.zeros(len(deflection_mm))
        if key not in self.offs:
            plain, reach = plain_part(problem), 20.0 * np.ceil(0.05 * top / problem.stiffness)
            solved = _solve(plain, (), reach, self.discretisation)
            if solved.instant is None:
                return np.zeros(len(deflection_mm))
            held = min(solved.holds_to_mbar, reach)
            nodes = held * np.linspace(0.02, 1.0, _RATIO_NODES) ** 1.5
            known = self._plain([plain], reach, nodes)[0]
            with np.errstate(divide="ignore", invalid="ignore"):
                off = np.log(solved.instant(nodes) / known)
            there = np.isfinite(off)
            if not there.any():
                return np.zeros(len(deflection_mm))
            self.offs[key] = known[there], off[there]
        return np.interp(deflection_mm, *self.offs[key])


def moved(u: Array, j: int, step: float) -> Array:
    """Return unknowns (k,) with one of them so far off."""
    found = u.copy()
    found[j] += step
    return found


@dataclass(frozen=True, eq=False)
class _Solved:
    instant: Instant | None
    holds_to_mbar: float
    slopes: Slopes


@lru_cache(maxsize=256)
def _solve(
    problem: SkinProblem, changes: tuple[Change, ...], top: float, discretisation: Discretisation
) -> _Solved:
    """Return the elastic dome up to a suction, and how it changes; kept.

    Raises:
        InputError: a change alters the number of nodes.
    """
    steps = steps_on(StepSettings(), discretisation)
    curve, slopes = solve_with_slopes(problem, changes, top, discretisation, steps)
    there = len(curve.pressure_mbar) >= 2 and curve.holds_to_mbar > 0
    return _Solved(Instant(curve.spline, 0.0, 0.0) if there else None, curve.holds_to_mbar, slopes)


def steps_on(settings: StepSettings, discretisation: Discretisation) -> StepSettings:
    """Return the settings of steps on a mesh: on the coarse one, which leads the way, longer."""
    settings = replace(settings, limits=FOLDED, leaps_mbar=FITS.leaps_mbar)
    if discretisation != SCREENING_MESH:
        return settings
    return replace(settings, extrapolation_error=FITS.rough_steps)


def bare(problem: SkinProblem) -> SkinProblem:
    """Return the problem without what the stepping in time and the preload answer."""
    return replace(problem, prony=(), preload_mbar=0.0)
