"""The forward model with effects: from parameters, a pressure path and a cycle to a curve.

Solutions are kept (the last ones, by their mechanical problem): curves that differ in sensor
effects, in program or in repeat alone share one solution, and so does a second call.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.effects import EFFECTS, checked, get_effect
from skinlab.mechanics.effects.base import Effect, Effects
from skinlab.mechanics.effects.installed import check_path, check_problem, check_series
from skinlab.mechanics.fem.hermite import CubicHermite
from skinlab.mechanics.fem.newton import StepSettings
from skinlab.mechanics.fem.relaxation import SETTINGS as RELAXING
from skinlab.mechanics.fem.relaxation import RelaxingCurve, relax
from skinlab.mechanics.fem.skin import Skin, SkinProblem, prepare
from skinlab.mechanics.fem.suction import (
    BLUNT_MESHES,
    EXTENSION_ABOVE,
    EXTENSION_BELOW_MBAR,
    MESH_OF_RECORD,
    Discretisation,
    Geometry,
    trace,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Response:
    """A simulated curve: deflection (n,) in mm, NaN where the model does not hold.

    `stopped` says why it does not hold further than `holds_to_mbar`; empty where it does.
    """

    deflection_mm: Array
    holds_to_mbar: float
    stopped: str


@dataclass(frozen=True)
class Instant:
    """The dome without memory: deflection (mm) as a function of suction (mbar), above the preload.

    Beyond its ends it goes on as a straight line: whoever reads it there looks whether it holds.
    """

    spline: CubicHermite
    preload_mbar: float
    zero_mm: float  # deflection at the preload

    def __call__(self, pressure_mbar: Array) -> Array:
        """Return the deflection at these suctions."""
        p = pressure_mbar + self.preload_mbar
        low, high = self.spline.x[0] - EXTENSION_BELOW_MBAR, self.spline.x[-1]
        within = np.clip(p, low, high)
        w = self.spline(within) + (p - within) * self.spline(within, 1)
        return np.asarray(w - self.zero_mm)

    def inverse(self, deflection_mm: Array) -> Array:
        """Return the suctions at which it is this high, to a thousandth of its range."""
        top = self.spline.x[-1] - self.preload_mbar
        p = np.linspace(-EXTENSION_BELOW_MBAR, top, 1000)
        w = self(p)
        found = np.interp(deflection_mm, w, p)
        return np.asarray(
            found + np.maximum(deflection_mm - w[-1], 0.0) * (p[-1] - p[-2]) / (w[-1] - w[-2])
        )


@dataclass(frozen=True)
class _Elastic:
    instant: Instant | None
    holds_to_mbar: float  # above the preload
    stopped: str


def problem_of(skin: Skin, effects: Effects, geometry: Geometry, cycle: int = 1) -> SkinProblem:
    """Return the mechanical problem of this skin with the physical ones of these effects.

    Raises:
        InputError: a value is out of its range.
    """
    return changed(skin, chosen(effects), geometry, cycle)


Chosen = Sequence[tuple[Effect, Mapping[str, float]]]
"""Effects with all their values, checked, in the order of their names."""


def chosen(effects: Effects) -> Chosen:
    """Return the effects with all their values.

    Raises:
        InputError: an effect or a parameter is not known, missing or out of bounds.
    """
    return [(get_effect(name), values) for name, values in checked(effects).items()]


def changed(skin: Skin, effects: Chosen, geometry: Geometry, cycle: int) -> SkinProblem:
    """Return the mechanical problem of a skin with the physical ones of these effects.

    Raises:
        InputError: a value is out of its range.
    """
    problem = SkinProblem(geometry, skin)
    for effect, values in effects:
        if type(effect).change is not Effect.change:
            with EFFECTS.at_work(effect.name, refuses=True):
                found = effect.change(problem, dict(values), cycle)
                if EFFECTS.origin(effect.name) is not None:
                    check_problem(found)
                problem = found
    return problem


def felt_path(effects: Effects, path: PressurePath) -> PressurePath:
    """Return the suction that the skin feels along a measured path.

    Raises:
        InputError: an effect or a parameter is not known, missing or out of bounds.
    """
    return felt_along(chosen(effects), path)


def felt_along(effects: Chosen, path: PressurePath) -> PressurePath:
    """Return the same of effects that are checked."""
    for effect, values in sorted(effects, key=lambda pair: (pair[0].order, pair[0].name)):
        with EFFECTS.at_work(effect.name, refuses=True):
            found = effect.felt(path, dict(values))
            if EFFECTS.origin(effect.name) is not None:
                check_path(found)
            path = found
    return path


def is_physical(effects: Effects) -> bool:
    """Return whether any of the effects needs the finite elements."""
    return any(get_effect(name).physical for name in effects)


def response(
    skin: Skin,
    effects: Effects,
    geometry: Geometry,
    path: PressurePath,
    time_s: ArrayLike,
    pressure_mbar: ArrayLike | None = None,
    *,
    cycle: int = 1,
    discretisation: Discretisation = MESH_OF_RECORD,
) -> Response:
    """Return what is recorded at these times (n,), along this path of the pressure.

    `pressure_mbar` (n,) are the pressures there, where they are known to differ a little from the
    path's (default: the path's own): what the skin remembers is the path, and it answers a small
    deviation at once.

    Raises:
        InputError: a value is out of its range.
    """
    times = np.asarray(time_s, dtype=float)
    full = checked(effects)
    problem = problem_of(skin, effects, geometry, cycle)
    sensors = Sensors.of(full)
    when = sensors.when(times)
    felt = felt_path(full, path)
    pressure = felt(when)
    if pressure_mbar is not None:
        off = np.asarray(pressure_mbar, dtype=float) - path(times)
        pressure = pressure + (off if when is times else np.interp(when, times, off))
    curve = solve_skin(problem, felt, discretisation)
    first_s = float(times[0]) if len(times) else 0.0
    w = sensors.read(times, path(times), curve.at(when, pressure), first_s)
    return Response(w, curve.holds_to_mbar, curve.stopped)


@dataclass(frozen=True)
class GoneOn:
    """What is recorded, beyond a crease at the tape's edge too."""

    deflection_mm: Array  # (n,), NaN where a blunter edge does not go on either
    held: NDArray[np.bool_]  # (n,) where the mesh itself holds
    holds_to_mbar: float
    moved_mm: float  # the curve of the blunter edge, to meet the other; 0 where there is none


def going_on(
    skin: Skin,
    effects: Effects,
    geometry: Geometry,
    path: PressurePath,
    time_s: ArrayLike,
    pressure_mbar: ArrayLike | None = None,
    *,
    cycle: int = 1,
    discretisation: Discretisation = MESH_OF_RECORD,
) -> GoneOn:
    """Return what `response` says and, from where the skin creases, what a blunter edge gives.

    That is the first of `BLUNT_MESHES` that reaches the end, moved to meet the curve where that
    ends. A skin that does not hold for the first sample does not go on.

    Raises:
        InputError: a value is out of its range.
    """

    def along(mesh: Discretisation) -> Response:
        return response(
            skin, effects, geometry, path, time_s, pressure_mbar, cycle=cycle, discretisation=mesh
        )

    found = along(discretisation)
    held = np.isfinite(found.deflection_mm)
    end = int(np.argmin(held))
    if held.all() or end == 0:
        return GoneOn(found.deflection_mm, held, found.holds_to_mbar, 0.0)
    for mesh in BLUNT_MESHES:
        blunt = along(mesh).deflection_mm
        if np.isfinite(blunt).all():
            break
    moved = float(found.deflection_mm[end - 1] - blunt[end - 1])
    if not np.isfinite(moved + blunt[end]):
        return GoneOn(found.deflection_mm, held, found.holds_to_mbar, 0.0)
    whole = np.where(held, found.deflection_mm, blunt + moved)
    return GoneOn(whole, held, found.holds_to_mbar, moved)


@dataclass(frozen=True)
class Sensors:
    """The sensor effects among some effects, in the order from the skin to the record."""

    chain: tuple[tuple[Effect, Mapping[str, float]], ...]

    @classmethod
    def of(cls, effects: Effects) -> Sensors:
        """Return those of these effects.

        Raises:
            InputError: an effect or a parameter is not known, missing or out of bounds.
        """
        return cls.among(chosen(effects))

    @classmethod
    def among(cls, effects: Chosen) -> Sensors:
        """Return the same of effects that are checked."""
        own = [pair for pair in effects if not pair[0].physical]
        return cls(tuple(sorted(own, key=lambda pair: (pair[0].order, pair[0].name))))

    @property
    def late(self) -> bool:
        """Whether any of them may record the deflection of another time."""
        return any(type(effect).when is not Effect.when for effect, _ in self.chain)

    def when(self, time_s: Array) -> Array:
        """Return the times (n,) whose deflection is recorded at these times (n,).

        What is installed is given copies, here and in `read`: it may change them in place.
        """
        for effect, values in self.chain:
            with EFFECTS.at_work(effect.name, refuses=True):
                if EFFECTS.origin(effect.name) is None:
                    time_s = effect.when(time_s, values)
                    continue
                found = effect.when(time_s.copy(), dict(values))
                check_series("when", found, time_s.shape, time_s)
                time_s = found
        return time_s

    def read(
        self, time_s: Array, pressure_mbar: Array, deflection_mm: Array, first_s: float
    ) -> Array:
        """Return what is recorded (n,); `first_s` is the time of the curve's first sample."""
        since_s = time_s - first_s
        for effect, values in self.chain:
            with EFFECTS.at_work(effect.name, refuses=True):
                if EFFECTS.origin(effect.name) is None:
                    deflection_mm = effect.read_along(since_s, pressure_mbar, deflection_mm, values)
                    continue
                found = effect.read_along(
                    since_s.copy(), pressure_mbar.copy(), deflection_mm.copy(), dict(values)
                )
                shape = np.broadcast_shapes(since_s.shape, deflection_mm.shape)
                check_series("read_along", found, shape, deflection_mm)
                deflection_mm = found
        return deflection_mm


@dataclass(frozen=True)
class SkinCurve:
    """The solved skin along one path: deflection as a function of time and pressure."""

    problem: SkinProblem
    path: PressurePath
    discretisation: Discretisation
    relaxing: RelaxingCurve | None
    """Its course where it has a memory; None where pressure alone tells the deflection."""

    def at(self, time_s: Array, pressure_mbar: Array) -> Array:
        """Return the deflection (n,) at these times, at pressures (n,) on the path or near it.

        NaN where the model does not hold.
        """
        top = self.path.top_mbar
        inside = (pressure_mbar >= -EXTENSION_BELOW_MBAR - 1e-9) & (
            pressure_mbar <= top * (1 + EXTENSION_ABOVE) + 1e-9
        )
        if self.relaxing is None:
            solution = self._elastic
            if solution.instant is None:
                return np.full(pressure_mbar.shape, np.nan)
            if solution.stopped:
                inside &= pressure_mbar <= solution.holds_to_mbar + 1e-9
            return np.where(inside, solution.instant(pressure_mbar), np.nan)
        w = self.relaxing(time_s)
        on_path = self.path(time_s)
        if np.any(pressure_mbar != on_path) and self.instant is not None:
            shift = self.shift_mbar(time_s)
            w = w + self.instant(pressure_mbar + shift) - self.instant(on_path + shift)
        return np.where(inside, w, np.nan)

    @property
    def instant(self) -> Instant | None:
        """The same dome without memory; None where it does not even begin."""
        return self._elastic.instant

    def shift_mbar(self, time_s: Array) -> Array:
        """Return the suction (n,) that memory is worth: without it, so much more would be needed.

        Around a state that it has crept to, the skin answers a sudden change as it would without
        memory around the same height: the stress that has relaxed is missing, whatever comes.
        """
        if self.relaxing is None or self.instant is None:
            return np.zeros(np.shape(time_s))
        w = self.relaxing(time_s)
        return np.asarray(np.nan_to_num(self.instant.inverse(w) - self.path(time_s)))

    @property
    def holds_to_mbar(self) -> float:
        """Up to which suction the model holds."""
        if self.relaxing is not None:
            return self.relaxing.holds_to_mbar
        return min(self._elastic.holds_to_mbar, self.path.top_mbar)

    @property
    def stopped(self) -> str:
        """Why it does not hold further; empty where it holds along the whole path."""
        return self._elastic.stopped if self.relaxing is None else self.relaxing.stopped

    @property
    def _elastic(self) -> _Elastic:
        share = sum(term.g for term in self.problem.prony)
        goal = max(self.path.top_mbar, 1.0) / (1.0 - share)
        return _solve_elastic(self.problem.elastic, self.discretisation, goal)


def solve_skin(
    problem: SkinProblem,
    path: PressurePath,
    discretisation: Discretisation = MESH_OF_RECORD,
    settings: StepSettings = RELAXING,
) -> SkinCurve:
    """Return the solved skin along this path; solutions are kept, and shared.

    `settings` are of the steps in time, where it relaxes.

    Raises:
        InputError: a value is out of its range.
    """
    relaxing = _solve_relaxing(problem, discretisation, path, settings) if problem.prony else None
    return SkinCurve(problem, path, discretisation, relaxing)


@lru_cache(maxsize=512)
def _solve_elastic(
    problem: SkinProblem, discretisation: Discretisation, goal_mbar: float
) -> _Elastic:
    preload = problem.preload_mbar
    prepared = prepare(problem, discretisation)
    curve = trace(
        prepared.assembly,
        prepared.apex,
        prepared.parameters(),
        goal_mbar + preload,
        problem.geometry.radius_mm,
    )
    holds_to = curve.holds_to_mbar - preload
    if len(curve.pressure_mbar) < 2 or holds_to <= 0:
        return _Elastic(None, 0.0, curve.stopped or "the model does not hold at all")
    zero = float(curve.spline(preload)) if preload > 0 else 0.0
    return _Elastic(Instant(curve.spline, preload, zero), holds_to, curve.stopped)


@lru_cache(maxsize=128)  # a long program's takes some MB
def _solve_relaxing(
    problem: SkinProblem, discretisation: Discretisation, path: PressurePath, settings: StepSettings
) -> RelaxingCurve:
    return relax(
        prepare(problem, discretisation),
        problem.prony,
        np.array(path.time_s),
        np.array(path.pressure_mbar),
        problem.geometry.radius_mm,
        settings,
        problem.preload_mbar,
    )


def forget() -> None:
    """Drop the solutions that are kept."""
    _solve_elastic.cache_clear()
    _solve_relaxing.cache_clear()
