"""The forward model with effects: from parameters, a pressure path and a cycle to a curve.

Solutions are kept (the last ones, by their mechanical problem): curves that differ in sensor
effects, in program or in repeat alone share one solution, and so does a second call.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline

from skinlab.effects.base import Effect
from skinlab.effects.registry import checked, get_effect
from skinlab.fem.relaxation import RelaxingCurve, relax
from skinlab.fem.skin import SkinProblem, prepare
from skinlab.fem.suction import (
    EXTENSION_ABOVE,
    EXTENSION_BELOW_MBAR,
    MESH_OF_RECORD,
    Discretisation,
    Geometry,
    trace,
)
from skinlab.materials.compressibility import KappaConvention
from skinlab.pressure_path import PressurePath

Array = NDArray[np.float64]
Effects = Mapping[str, Mapping[str, float]]  # name of the effect -> parameter -> value


@dataclass(frozen=True)
class Skin:
    """The base law's parameters of one skin."""

    X1_MPa: float
    X2_MPa: float
    nu: float
    kappa: KappaConvention = "paper"
    law: str = "extended_neo_hookean"


@dataclass(frozen=True)
class Response:
    """A simulated curve: deflection (n,) in mm, NaN where the model does not hold.

    `stopped` says why it does not hold further than `holds_to_mbar`; empty where it does.
    """

    deflection_mm: Array
    holds_to_mbar: float
    stopped: str


@dataclass(frozen=True)
class _Elastic:
    """A dome without memory: deflection (mm) as a function of pressure (mbar)."""

    spline: CubicHermiteSpline | None
    holds_to_mbar: float
    stopped: str
    zero_mm: float  # deflection at the preload


def problem_of(skin: Skin, effects: Effects, geometry: Geometry, cycle: int = 1) -> SkinProblem:
    """Return the mechanical problem of this skin with the physical ones of these effects.

    Raises:
        InputError: a value is out of its range.
    """
    problem = SkinProblem(geometry, skin.X1_MPa, skin.X2_MPa, skin.nu, skin.kappa, skin.law)
    for name, values in checked(effects).items():
        problem = get_effect(name).change(problem, values, cycle)
    return problem


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
    sensors = _sensors(full)
    when = times
    for effect in sensors:
        when = effect.when(when, full[effect.name])
    pressure = path(when)
    if pressure_mbar is not None:
        off = np.asarray(pressure_mbar, dtype=float) - path(times)
        pressure = pressure + (off if when is times else np.interp(when, times, off))
    curve = solve_skin(problem, path, discretisation)
    w = curve.at(when, pressure)
    for effect in sensors:
        w = effect.read(times, w, full[effect.name])
    return Response(w, curve.holds_to_mbar, curve.stopped)


def _sensors(effects: Effects) -> list[Effect]:
    """Return the sensor effects in the order of the sensor's path."""
    chosen = (get_effect(name) for name in effects)
    return sorted((e for e in chosen if not e.physical), key=lambda e: (e.order, e.name))


@dataclass(frozen=True)
class SkinCurve:
    """The solved skin along one path: deflection as a function of time and pressure."""

    problem: SkinProblem
    path: PressurePath
    discretisation: Discretisation
    relaxing: RelaxingCurve | None

    def at(self, time_s: Array, pressure_mbar: Array) -> Array:
        """Return the deflection (n,) at these times, at pressures (n,) on the path or near it."""
        top = self.path.top_mbar
        inside = (pressure_mbar >= -EXTENSION_BELOW_MBAR - 1e-9) & (
            pressure_mbar <= top * (1 + EXTENSION_ABOVE) + 1e-9
        )
        if self.relaxing is None:
            return np.where(inside, self._elastic(pressure_mbar), np.nan)
        w = self.relaxing(time_s)
        on_path = self.path(time_s)
        if np.any(pressure_mbar != on_path):
            # an instant's answer; of first order in a deviation that is small
            w = w + self._elastic(pressure_mbar) - self._elastic(on_path)
        return np.where(inside, w, np.nan)

    def _elastic(self, pressure_mbar: Array) -> Array:
        problem = self.problem
        curve = _elastic(problem.relaxed, self.discretisation, _goal(problem, self.path))
        if curve.spline is None:
            return np.full(pressure_mbar.shape, np.nan)
        p = pressure_mbar + problem.preload_mbar
        top = curve.holds_to_mbar * (1 + (0.0 if curve.stopped else EXTENSION_ABOVE))
        w = curve.spline(p) - curve.zero_mm
        return np.where(p <= top + 1e-9, w, np.nan)

    @property
    def holds_to_mbar(self) -> float:
        """Up to which suction the model holds."""
        if self.relaxing is not None:
            return self.relaxing.holds_to_mbar
        curve = self._solution
        return min(curve.holds_to_mbar - self.problem.preload_mbar, self.path.top_mbar)

    @property
    def stopped(self) -> str:
        """Why it does not hold further; empty where it holds along the whole path."""
        return self._solution.stopped if self.relaxing is None else self.relaxing.stopped

    @property
    def _solution(self) -> _Elastic:
        return _elastic(self.problem, self.discretisation, _goal(self.problem, self.path))


def solve_skin(
    problem: SkinProblem, path: PressurePath, discretisation: Discretisation = MESH_OF_RECORD
) -> SkinCurve:
    """Return the solved skin along this path.

    Raises:
        InputError: a value is out of its range.
    """
    relaxing = _relaxing(problem, discretisation, path) if problem.prony else None
    return SkinCurve(problem, path, discretisation, relaxing)


def _goal(problem: SkinProblem, path: PressurePath) -> float:
    return max(path.top_mbar, 1.0) + problem.preload_mbar


@lru_cache(maxsize=512)
def _elastic(problem: SkinProblem, discretisation: Discretisation, goal_mbar: float) -> _Elastic:
    prepared = prepare(problem, discretisation)
    curve = trace(
        prepared.assembly,
        prepared.apex,
        prepared.parameters(),
        goal_mbar,
        problem.geometry.radius_mm,
    )
    if len(curve.pressure_mbar) < 2:
        return _Elastic(None, 0.0, curve.stopped, math.nan)
    zero = 0.0
    if problem.preload_mbar > 0:
        zero = float(curve([problem.preload_mbar])[0])
    return _Elastic(curve.spline, curve.holds_to_mbar, curve.stopped, zero)


@lru_cache(maxsize=512)
def _relaxing(
    problem: SkinProblem, discretisation: Discretisation, path: PressurePath
) -> RelaxingCurve:
    return relax(
        prepare(problem, discretisation),
        problem.prony,
        np.array(path.time_s),
        np.array(path.pressure_mbar),
        problem.geometry.radius_mm,
        preload_mbar=problem.preload_mbar,
    )
