"""All curves of a campaign as functions of an explanation's unknowns, exact at the anchor.

A skin's problem has features that the dimensionless table answers exactly (other stiffness, other
thickness, a preload), and others (layers, pre-stretch, slip, added energy, relaxation) that it does
not. For these the finite elements are solved at one point, the anchor, and their ratio to the
table's answer there corrects the table nearby; the ratio's change with the unknowns is taken from
slopes or learnt from anchor to anchor. At the anchor itself the model is that of the finite
elements (space mapping: Bandler et al. 2004, IEEE Trans. Microw. Theory Tech. 52:337). Relaxation
is first approximated by letting the pressure of the dome relax as the stress would, which is too
much: the volume does not relax. The share by which it is so is what the finite elements tell there.

Nothing here asks which effect it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.pressure_path import PressurePath
from skinlab.discrepancy.corrections import (
    Course,
    Learnt,
    Points,
    between,
    going_on,
    share_and_rest,
)
from skinlab.discrepancy.problem_map import Key, ProblemMap, Problems, key_of
from skinlab.discrepancy.records import Record
from skinlab.discrepancy.settings import FITS
from skinlab.discrepancy.solid_ratios import SolidRatios, moved, steps_on
from skinlab.discrepancy.table_curves import TableCurves, read_at, recorded, relaxation_of
from skinlab.discrepancy.table_domes import (
    Domes,
    Relaxation,
    TableDomes,
    has_features,
)
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.effects.model import (
    Sensors,
    solve_skin,
)
from skinlab.mechanics.fem.admissibility import FOLDED
from skinlab.mechanics.fem.relaxation import SETTINGS as RELAXING
from skinlab.mechanics.fem.suction import (
    MESH_OF_RECORD,
    SCREENING_MESH,
    Discretisation,
)

Array = NDArray[np.float64]

_COMPARED, _ALIKE_S, _ALIKE_MBAR = 100, 0.3, 2.0  # points, length and suction of repeats
_CORNER = 1e-2  # of the highest suction: a corner so small changes no correction
# Beyond a crease: the folded branch differs between meshes by little, and hardly in the dome.
_FOLDED = replace(RELAXING, extrapolation_error=FITS.rough_steps, limits=FOLDED)
_CURVED = 0.2  # in typical sizes, and of that at the anchor: below it is straight
_LENGTH = 2.0  # of typical sizes: corrections are smooth over it
_SHARE_STEP = 0.025  # of the law's reaches, typical sizes: for slopes of what relaxes


@dataclass(eq=False)
class MappedModel:
    """Deflections of all records for given unknowns; NaN where there is no model."""

    records: Sequence[Record]
    unknowns: Unknowns
    domes: TableDomes
    discretisation: Discretisation = MESH_OF_RECORD
    _anchor: Array | None = None
    _ratios: dict[Key, tuple[Array, Learnt]] = field(default_factory=dict)
    _courses: dict[int, Course] = field(default_factory=dict)
    _offs: dict[Key, tuple[Array, Array]] = field(default_factory=dict)  # heights, of a coarse mesh
    _shares_sloped: bool = False
    # Further unknowns (k,) at which the ratios are known, and these, with slopes by the unknowns.
    _known: list[tuple[Array, dict[Key, tuple[Array, Learnt]]]] = field(default_factory=list)
    _points: Points | None = None
    # The same of what relaxes: how far off the anchor (k,), and what is added, by first of repeats.
    _shares: list[tuple[Array, dict[int, _Added]]] = field(default_factory=list)

    def exact(self) -> MappedModel:
        """Return the model on the mesh of record, without an anchor.

        How what relaxes changes with the unknowns is taken over: it is learnt already.
        """
        courses = {
            i: Course(replace(c.share), replace(c.rest_mm)) for i, c in self._courses.items()
        }
        return MappedModel(
            self.records,
            self.unknowns,
            self.domes,
            _courses=courses,
            _shares_sloped=self._shares_sloped,
        )

    def anew(self) -> MappedModel:
        """Return the same model without an anchor."""
        return MappedModel(
            self.records, self.unknowns, self.domes, self.discretisation, _offs=self._offs
        )

    @property
    def corrected(self) -> bool:
        """Whether the finite elements correct the table anywhere."""
        return bool(self._ratios or self._courses)

    @property
    def sloped(self) -> bool:
        """Whether all that corrects the table is known with its slopes: nothing relaxes."""
        return not self._courses

    @property
    def coarse(self) -> bool:
        """Whether the mesh is that which leads the way: its bottom is not that of the model."""
        return self.discretisation == SCREENING_MESH

    def needs_finite_elements(self, u: Array, *, memory: bool = True) -> bool:
        """Return whether the table alone does not tell the curves there, or the elastic ones."""
        candidate = self._problems.at(u)
        return candidate is not None and any(
            has_features(p) or (memory and p.prony) for p in candidate.problems.values()
        )

    @cached_property
    def _problems(self) -> ProblemMap:
        return ProblemMap(self.records, self.unknowns)

    @cached_property
    def _solids(self) -> SolidRatios:
        return SolidRatios(self._problems, self.domes, self.discretisation, self._offs)

    @property
    def _by_table(self) -> TableCurves:
        return TableCurves(self._problems, self._ratios)

    @cached_property
    def _twins(self) -> list[int]:
        """Return of each record the first one that no model can tell from it: repeats."""
        first: dict[tuple[object, ...], int] = {}
        return [
            first.setdefault(
                (key_of(r), r.path, r.curve.time_s.tobytes(), r.pressure_mbar.tobytes()), i
            )
            for i, r in enumerate(self.records)
        ]

    @cached_property
    def _by_key(self) -> dict[Key, list[int]]:
        """The records of each key, of repeats the first."""
        found: dict[Key, list[int]] = {}
        for i in sorted(set(self._twins)):
            found.setdefault(key_of(self.records[i]), []).append(i)
        return found

    @cached_property
    def _repeats(self) -> list[int]:
        """Return of each record the first one whose suction went about the same way.

        What the finite elements correct is small, and smooth along the way.
        """
        found: list[int] = []
        for i, record in enumerate(self.records):
            alike = (j for j in sorted(set(found)) if _about_alike(self.records[j], record))
            found.append(next(alike, i))
        return found

    def predict(self, u: Array) -> list[Array]:
        """Return the deflections (n,) of each record, mm."""
        return [w[0] for w in self.predict_many(u[None])]

    def predict_many(self, u: Array) -> list[Array]:
        """Return the deflections (candidates, n) of each record for unknowns (candidates, k)."""
        every = self._problems.at_many(u)
        some = [i for i, one in enumerate(every) if one is not None]
        candidates = [one for one in every if one is not None]
        off = self.from_anchor(u)
        domes = self._domes_of_all(candidates) if candidates else {}
        relaxations = {key: relaxation_of([c.problems[key] for c in candidates]) for key in domes}
        found = {i: np.full((len(u), len(self.records[i].curve)), np.nan) for i in set(self._twins)}
        for key, which in self._by_key.items() if candidates else ():
            at = (candidates, domes[key], off[some], relaxations[key])
            for i, w in zip(which, self._heights_in_time(which, *at), strict=True):
                found[i][some] = recorded(self.records[i], candidates, w)
        return [found[i] for i in self._twins]

    def from_anchor(self, u: Array) -> Array:
        """Return how far unknowns (n, k) are from the anchor, zero where there is none.

        Along a layer's valley its thickness trades for its stiffness, which is a logarithm: what
        they do together is straight where that of the thickness is taken too.
        """
        if self._anchor is None:
            return np.zeros_like(u)
        off = u - self._anchor
        for j in self._curved:
            at = self._anchor[j]
            if at > _CURVED:
                share = u[:, j] / at
                low = np.maximum(share, _CURVED)
                off[:, j] = at * (np.log(low) + (share - low) / _CURVED)
        return off

    def _stretch(self, u: Array) -> Array:
        """Return by how much (k,) `from_anchor` changes with unknowns (k,)."""
        assert self._anchor is not None
        found = np.ones(len(u))
        for j in self._curved:
            at = self._anchor[j]
            if at > _CURVED:
                found[j] = 1.0 / max(u[j] / at, _CURVED)
        return found

    @cached_property
    def _curved(self) -> list[int]:
        """Sizes of effects that bend with them."""
        return [
            j
            for j, axis in enumerate(self.unknowns.axes, self.unknowns.count)
            if get_effect(axis.effect).curved and axis.parameter.zero is not None
        ]

    def _domes_of_all(self, candidates: Sequence[Problems]) -> dict[Key, Domes]:
        """Return the domes of candidates for each key: asked for at once."""
        keys, n = list(candidates[0].problems), len(candidates)
        problems = [c.problems[key] for key in keys for c in candidates]
        known: dict[tuple[object, ...], float] = {}
        tops = []
        for key in keys:
            for c in candidates:
                problem = c.problems[key]
                name = (key, id(c.felt), problem.prony, problem.preload_mbar)
                if name not in known:
                    known[name] = self._problems.top_mbar(c, key)
                tops.append(known[name] / problem.stiffness)
        every = self.domes(problems, tops)
        return {key: every.some(slice(i * n, (i + 1) * n)) for i, key in enumerate(keys)}

    def _heights_in_time(
        self,
        which: Sequence[int],
        candidates: Sequence[Problems],
        domes: Domes,
        off: Array,
        relaxation: Relaxation | None,
    ) -> list[Array]:
        """Return the deflections (candidates, n) of some records of a key, before the sensors."""
        records = [self.records[i] for i in which]
        found = self._by_table(which, records, candidates, domes, off, relaxation)
        if not any(i in self._courses for i in which):
            return found
        elastic = self._by_table(which, records, candidates, domes, off, None)
        for k, (i, record) in enumerate(zip(which, records, strict=True)):
            if i not in self._courses:
                continue
            # What the table takes for relaxation is too much by a share that hardly changes.
            memory = found[k] - elastic[k]
            time, course = record.curve.time_s, self._courses[i]
            share, rest = course.share.at(off), course.rest_mm.at(off)
            if any(c.sensors.late for c in candidates):
                when = read_at(candidates, time)
                share, rest = (
                    np.array([np.interp(t, time, one) for t, one in zip(when, every, strict=True)])
                    for every in (share, rest)
                )
            found[k] = found[k] + share * memory + rest
        return found

    # ---- the finite elements ----

    def anchor(self, u: Array, *, slopes: bool = True, memory: bool = True) -> bool:
        """Solve the finite elements at u, so that the model is exact there.

        With `slopes` it is also known how what they correct changes around it; of what relaxes that
        is learnt from anchor to anchor, and on the mesh of record begun with slopes. Without
        `memory` relaxation stays approximate. Returns False where they do not hold over most of the
        pressures.
        """
        here = self._problems.at(u)
        if here is None:
            return False
        off = self.from_anchor(u[None])[0]
        ratios = self._solids.at(u, here, self._solids.keys_at(u, here), slopes=slopes)
        if ratios is None:
            return False
        last = self._anchor if slopes and self._ratios.keys() == ratios.keys() else None
        self._known = [] if last is None else [(last, self._ratios)]
        self._shares = []
        self._ratios, self._anchor = ratios, u.copy()
        self._smooth_ratios()
        if not memory or not self._anchor_courses(here, off):
            return not memory
        if slopes and self._courses and not self._shares_sloped and not self.coarse:
            self._slope_shares(u, here)
        return True

    @property
    def points(self) -> Points:
        """Where the corrections are known: those of what relaxes, if anything does."""
        points = self._anchor_alone if self._courses or self._points is None else self._points
        return points.also(np.array([off for off, _ in self._shares])) if self._shares else points

    @property
    def _anchor_alone(self) -> Points:
        reaches, effects = self.unknowns.reaches, np.ones(len(self.unknowns.axes))
        lengths = _LENGTH * np.concatenate([reaches, effects])
        return Points.anchor(lengths, sloped=self.sloped)

    def learn(self, others: Array) -> None:
        """Solve the finite elements at further points (p, k), where they hold.

        Between these and the anchor the corrections are smooth.
        """
        for u in others if self._ratios else ():
            here = self._problems.at(u)
            found = None if here is None else self._solids.at(u, here, list(self._ratios))
            if found is not None:
                self._known.append((u, found))
        self._smooth_ratios()
        for u in others if self._courses else ():
            here, off = self._problems.at(u), self.from_anchor(u[None])
            shares = None if here is None else self._shares_at(here, off)
            if shares is not None:
                self._shares.append((off[0], shares))
        for i, course in self._courses.items() if self._shares else ():
            none = np.zeros_like(course.share.slopes)
            every = [added[self._repeats[i]] for _, added in self._shares]
            course.share.passes(
                self.points, [Learnt(self._as_in(i, one.share), none) for one in every]
            )
            course.rest_mm.passes(
                self.points, [Learnt(self._as_in(i, one.rest_mm), none) for one in every]
            )

    def _shares_at(self, here: Problems, off: Array) -> dict[int, _Added] | None:
        """Return what is added to what relaxes, of repeats the first; None where it fails."""
        found: dict[int, _Added] = {}
        for first in dict.fromkeys(self._repeats[i] for i in self._courses):
            one = self._course(first, here, off)
            if one is None:
                return None
            found[first] = one
        return found

    def _as_in(self, i: int, values: Array) -> Array:
        """Return what is known of the first of a record's repeats, at the record's own times."""
        time, since = (self.records[j].curve.time_s for j in (i, self._repeats[i]))
        return np.asarray(np.interp(time - time[0], since - since[0], values))

    def _smooth_ratios(self) -> None:
        """Let the corrections of solids pass through all that is known of them."""
        self._points = replace(self._anchor_alone, sloped=True)
        if not self._known:
            return
        for u, _ in self._known:
            self._points = self._points.also(self.from_anchor(u[None]))
        for key, (nodes, learnt) in self._ratios.items():
            others = []
            for u, known in self._known:
                then, own = known[key]
                slopes = between(then, own.slopes.T, nodes[None]).T / self._stretch(u)
                others.append(Learnt(between(then, own.value[None], nodes[None])[0], slopes))
            learnt.passes(self._points, others)

    def _slope_shares(self, u: Array, here: Problems) -> None:
        """Take how what relaxes changes with all but stiffnesses, of a coarse mesh.

        A share hardly changes with the law's stiffnesses, and with how much relaxes.
        """
        rough = MappedModel(
            self.records, self.unknowns, self.domes, SCREENING_MESH, u, self._ratios
        )
        steps = self._share_steps(u, here)
        found: dict[int, Array | None] = {}
        for i, course in self._courses.items():
            first = self._repeats[i]
            if first not in found:
                found[first] = rough._slopes_of_share(first, here, u, steps)
            slopes = found[first]
            if slopes is None:
                continue
            course.share.slopes = course.share.slopes.copy()  # another model may have the same
            for j, column in zip(steps, slopes.T, strict=True):
                course.share.slopes[:, j] = self._as_in(i, column)
        self._shares_sloped = True

    def _slopes_of_share(
        self, i: int, here: Problems, u: Array, steps: Mapping[int, float]
    ) -> Array | None:
        """Return the derivatives (n, steps) of a curve's share, None where there are none.

        A crease may end one of two neighbours' curves: beyond it the slope stays as it was. Taken
        over it, it was 7 where 0.1 is right, and ν seemed to be known to 0.002 instead of 0.01.
        """
        base = self._course(i, here, np.zeros((1, len(u))))
        time = self.records[i].curve.time_s
        found = []
        for j, step in steps.items():
            beside = moved(u, j, step)
            there, off = self._problems.at(beside), self.from_anchor(beside[None])
            other = None if there is None else self._course(i, there, off)
            if base is None or other is None:
                return None
            both = base.held & other.held
            slope = (other.share - base.share)[both] / off[0, j]
            found.append(np.interp(time, time[both], slope))
        return np.array(found).reshape(len(steps), len(time)).T

    def _share_steps(self, u: Array, here: Problems) -> dict[int, float]:
        """Return the unknowns with which a share changes, and how far each is moved."""
        changing = set().union(*self._solids.changes(u, here.problems).values())
        count, high = self.unknowns.count, self.unknowns.bounds[1]
        linear = [t == "linear" for t in self.unknowns.space.transforms]
        found = {}
        for j in range(len(u)):
            own = linear[j] if j < count else j in changing
            if own:
                step = _SHARE_STEP * (self.unknowns.reaches[j] if j < count else 1.0)
                found[j] = step if u[j] + step <= high[j] else -step
        return found

    def _anchor_courses(self, here: Problems, off: Array) -> bool:
        """Correct what relaxes, curve by curve."""
        before, self._courses = self._courses, {}
        solved: dict[int, _Added] = {}  # of a repeat
        for i in sorted(set(self._twins)):
            if not here.problems[key_of(self.records[i])].prony:
                continue
            first = self._repeats[i]
            if first not in solved:
                found = self._course(first, here, np.zeros((1, len(off))))
                if found is None:
                    return False
                solved[first] = found
            one = solved[first]
            share, rest_mm = self._as_in(i, one.share), self._as_in(i, one.rest_mm)
            none = np.zeros((len(share), len(off)))
            if i in before:
                learnt = before[i].share
                learnt.move(share, off)
            else:
                learnt = Learnt(share, none)
            self._courses[i] = Course(learnt, Learnt(rest_mm, none))
        return True

    def _course(self, i: int, here: Problems, off: Array) -> _Added | None:
        """Return what the finite elements add to a curve; None where they do not hold.

        `off` (1, k) is how far that is from the anchor.
        """
        record = self.records[i]
        key = key_of(record)
        problem, top = here.problems[key], self._problems.top_mbar(here, key)
        domes = self.domes([problem], [top / problem.stiffness])
        if not domes.hold[0]:
            return None
        time, path = record.curve.time_s, _simpler(here.felt[i])
        # The coarse mesh, which leads the way, goes on beyond a crease: neighbours end elsewhere.
        limits = FOLDED if self.coarse else RELAXING.limits
        steps = replace(steps_on(RELAXING, self.discretisation), limits=limits)
        exact = solve_skin(problem, path, self.discretisation, steps).at(time, path(time))
        exact = exact * np.exp(-self._solids.off(problem, key, top, exact))
        whole = held = np.isfinite(exact)
        if not held.all():
            rough = solve_skin(problem, path, SCREENING_MESH, _FOLDED).at(time, path(time))
            exact = going_on(exact, rough)
            held = np.isfinite(exact)  # beyond, what they add stays as it was
        if path(time)[held].max(initial=0.0) < FITS.least_held * path.top_mbar:
            return None
        plain = replace(record, path=path, pressure_mbar=path(time))
        unread = replace(here, sensors=Sensors(()), felt=[path] * len(here.felt), felt_more=())
        at = ([i], [plain], [unread], domes, off)
        relaxed, elastic = (self._by_table(*at, r)[0][0] for r in (relaxation_of([problem]), None))
        added = np.interp(time, time[held], (exact - relaxed)[held])
        return _Added(*share_and_rest(added, relaxed - elastic), whole)


def _simpler(path: PressurePath) -> PressurePath:
    """Return nearly the same path with fewer corners: each costs steps of the finite elements."""
    return PressurePath.of_samples(
        np.array(path.time_s), np.array(path.pressure_mbar), _CORNER * max(path.top_mbar, 1.0)
    )


def _about_alike(one: Record, other: Record) -> bool:
    """Return whether two curves are of one condition, and their suctions nearly the same."""
    if key_of(one) != key_of(other):
        return False
    begin, end = one.curve.time_s[0], one.curve.time_s[-1]
    t = np.linspace(0.0, end - begin, _COMPARED)
    lasts = other.curve.time_s[-1] - other.curve.time_s[0]
    off = np.abs(one.path(begin + t) - other.path(other.curve.time_s[0] + t)).max()
    return bool(abs(lasts - (end - begin)) <= _ALIKE_S and off <= _ALIKE_MBAR)


@dataclass(frozen=True, eq=False)
class _Added:
    """What the finite elements add to a curve that relaxes, by what the table takes for it."""

    share: Array  # (n,) of that,
    rest_mm: Array  # (n,) and what is no share of it
    held: NDArray[np.bool_]  # (n,) where they have a dome themselves
