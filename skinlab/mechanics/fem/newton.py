"""Follow the equilibrium path in pressure: Newton's method with steps that adapt.

At each converged point the factorised tangent also gives the path's slope du/dp, so that the next
step starts from a cubic Hermite extrapolation through the last two points, and w(p) between points
is a cubic Hermite interpolation. The extrapolation's error, seen when the step converges, bounds
the interpolation's: for equal steps the remainders h²(2h)² f⁗/4! and (h/2)⁴ f⁗/4! are 64 : 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinlab.mechanics.fem.admissibility import DEFAULT_LIMITS, Limits, fault
from skinlab.mechanics.fem.assembly import Assembly, State
from skinlab.mechanics.fem.banded import Factor

Array = NDArray[np.float64]


_FIRST_STEP_ALLOWANCE = 10.0
_QUADRATIC = 0.05  # below this ratio of corrections Newton is taken to converge quadratically
_SAFETY = 0.1


@dataclass(frozen=True)
class StepSettings:
    """How the path is followed; the defaults serve the mesh of record."""

    first_step: float = 0.008  # straight-line prediction of the watched unknown, same units
    smallest_step_mbar: float = 0.01
    extrapolation_error: float = 1e-4  # aimed at, in units of the opening's radius
    correction: float = 3e-7  # Newton ends when no displacement would move more, in mm
    most_iterations: int = 8
    tries: int = 6
    limits: Limits = DEFAULT_LIMITS
    limit_mbar: float = 1.0  # how closely the pressure of an inadmissible state is found
    leaps_mbar: tuple[float, ...] = ()  # tried where the path ends: what snaps may be a crease


@dataclass
class EquilibriumPath:
    """Converged points of the path, in order of pressure; the first is the unloaded state."""

    pressure_mpa: list[float] = field(default_factory=list)
    displacements: list[Array] = field(default_factory=list)  # unknowns, mm
    slopes: list[Array] = field(default_factory=list)  # d unknowns / d pressure, mm/MPa
    j_min: list[float] = field(default_factory=list)
    j_max: list[float] = field(default_factory=list)
    energy: list[float] = field(default_factory=list)  # stored, N mm
    volume: list[float] = field(default_factory=list)  # under the dome, mm³
    iterations: int = 0
    stopped: str = ""  # why the path ends before its goal; empty where it does not


@dataclass(frozen=True)
class Point:
    """One converged point."""

    unknowns: Array
    slope: Array
    volume: float
    state: State  # just before the last, negligible, correction
    last_work: float  # of the internal forces along that one, N mm
    contraction: float | None  # second correction over the first squared, mm⁻¹; None: only one
    factor: Factor  # of the tangent at `state`

    @property
    def energy(self) -> float:
        """Stored energy, N mm."""
        return self.state.energy + self.last_work


Look = Callable[[float, Point], None]
"""Is shown a point of the path and its pressure, MPa, while the point's factor is there."""


def solve_point(
    assembly: Assembly,
    guess: Array,
    pressure_mpa: float,
    parameters: Mapping[str, Any],
    settings: StepSettings,
    stress_2pk: Array | None = None,
    contraction: float = np.inf,
) -> tuple[Point | None, int]:
    """Return the equilibrium near `guess` and the iterations spent; None where Newton fails.

    `stress_2pk` is a stress besides the law's, see `Assembly.evaluate`. `contraction`, where it is
    known from a neighbouring point, foretells the second correction from the first.

    Fails: an element turned inside out, a tangent that is not positive definite (the state is not
    stable), corrections that grow, or too many iterations.
    """
    u = guess.copy()
    last = np.inf
    seen: float | None = None
    for iteration in range(1, settings.most_iterations + 1):
        state = assembly.evaluate(u, pressure_mpa, parameters, stress_2pk)
        if state is None:
            return None, iteration
        factor = state.matrix.factorise()
        if factor is None:
            return None, iteration
        step = solve_linear(factor, state, pressure_mpa, -state.residual)
        correction = float(np.abs(step).max())
        if not math.isfinite(correction) or correction > 4.0 * last:
            return None, iteration
        u += step
        # Quadratic convergence: the next correction would be about ratio² times this one.
        ratio = correction / last if iteration > 1 else 1.0
        foreseen = ratio * ratio * correction if ratio < _QUADRATIC else np.inf
        if iteration == 1:
            foreseen = contraction * correction * correction
        elif iteration == 2:
            seen = ratio / last
        if correction <= settings.correction or foreseen <= _SAFETY * settings.correction:
            slope = solve_linear(factor, state, pressure_mpa, state.load)
            internal = state.residual + pressure_mpa * state.load
            point = Point(
                u,
                slope,
                # `state` is that before the last correction: to first order, what it changes
                state.volume + float(state.load @ step),
                state,
                float(internal @ step),
                seen,
                factor,
            )
            return point, iteration
        last = correction
    return None, settings.most_iterations


def solve_linear(factor: Factor, state: State, pressure_mpa: float, right: Array) -> Array:
    """Return x of K x = right, (n,) or several (k, n), from the factor of its symmetric part.

    Where the load ends on a surface that moves, K has a skew part of rank two besides.
    """
    if state.skew is None:
        return factor.solve(right)
    seen, size = state.skew
    k = pressure_mpa * size
    # K = K_s − k (e_z e_rᵀ − e_r e_zᵀ), by Woodbury: y = (e_r·x, e_z·x) of the solution
    found = factor.solve(np.vstack([right, seen]))
    x, by = found[:-2].reshape(right.shape), found[-2:]
    (rr, rz), (_, zz) = (k * (seen @ by.T)).tolist()
    inverse = np.array([[1.0 + rz, -rr], [zz, 1.0 - rz]]) / (1.0 - rz * rz + rr * zz)
    y = inverse @ (seen @ x.T)
    return np.asarray(x + k * (np.multiply.outer(y[0], by[1]) - np.multiply.outer(y[1], by[0])))


def follow(
    assembly: Assembly,
    goal_mpa: float,
    parameters: Mapping[str, Any],
    scale_mm: float,
    settings: StepSettings | None = None,
    watch: int | None = None,
    look: Look | None = None,
    after: EquilibriumPath | None = None,
) -> EquilibriumPath:
    """Return the path from zero to `goal_mpa` (either sign), or as far as it goes.

    `watch` is the unknown whose extrapolation error steers the steps (the apex deflection);
    `scale_mm` is what that error is measured against. `look` is shown each point of the path.
    `after` is a path that reached a smaller goal: this one goes on from its end.
    """
    settings = settings or StepSettings()
    sign = 1.0 if goal_mpa >= 0 else -1.0
    if after is not None:
        path = EquilibriumPath(**{f.name: copy(getattr(after, f.name)) for f in fields(after)})
        step = abs(path.pressure_mpa[-1] - path.pressure_mpa[-2])
    else:
        path = EquilibriumPath()
        start, spent = solve_point(assembly, np.zeros(assembly.n), 0.0, parameters, settings)
        path.iterations += spent
        if start is None:
            path.stopped = "the tangent of the unloaded skin is not positive definite"
            return path
        _append(path, 0.0, start, look)
        compliance = _size(start.slope, watch)
        step = min(settings.first_step * scale_mm / max(compliance, 1e-300), abs(goal_mpa))
    smallest = settings.smallest_step_mbar * 1e-4
    ceiling, reason_above = np.inf, ""  # a pressure known to be inadmissible, and why
    tries = 0
    while abs(path.pressure_mpa[-1]) < abs(goal_mpa) * (1 - 1e-12):
        left = abs(goal_mpa) - abs(path.pressure_mpa[-1])
        step = min(step, 0.5 * (ceiling - abs(path.pressure_mpa[-1])))
        n = max(1, int(np.ceil(left / step - 1e-9)))
        # Even out the last steps rather than end with a sliver.
        step_now = left / n if n <= 2 else step
        target = goal_mpa if n == 1 else path.pressure_mpa[-1] + sign * step_now
        guess = extrapolate(path, target)
        point, spent = solve_point(assembly, guess, target, parameters, settings)
        path.iterations += spent
        if point is None:
            tries += 1
            step = 0.35 * step_now
            if tries <= settings.tries and step >= smallest:
                continue
            leap = _leap(assembly, path, goal_mpa, parameters, settings)
            if leap is None:
                path.stopped = _stopped("no convergence", path)
                break
            target, point = leap
            step, tries = abs(target - path.pressure_mpa[-1]), 0
            _append(path, target, point, look)
            continue
        reason = fault(assembly, point.unknowns, point.state, settings.limits)
        if reason:  # close in on it by halves
            ceiling, reason_above = abs(target), reason
            if ceiling - abs(path.pressure_mpa[-1]) <= settings.limit_mbar * 1e-4:
                path.stopped = _stopped(reason, path)
                break
            continue
        error = _size(guess - point.unknowns, watch)
        wanted, order = settings.extrapolation_error * scale_mm, 4.0
        first = len(path.pressure_mpa) == 1
        if first:  # a straight line's error is of second order and larger
            wanted, order = wanted * _FIRST_STEP_ALLOWANCE, 2.0
        factor = 0.9 * (wanted / max(error, 1e-3 * wanted)) ** (1.0 / order)
        step = step_now * min(1.6, max(0.25, factor))
        if first and error > 2.0 * wanted and step >= smallest:
            continue  # a first step this curved would spoil the interpolation across it
        tries = 0
        _append(path, target, point, look)
        if ceiling - abs(target) <= settings.limit_mbar * 1e-4:
            path.stopped = _stopped(reason_above, path)
            break
    return path


def _leap(
    assembly: Assembly,
    path: EquilibriumPath,
    goal_mpa: float,
    parameters: Mapping[str, Any],
    settings: StepSettings,
) -> tuple[float, Point] | None:
    """Return a state beyond the end of a path, and its pressure (MPa); None where none is found.

    A crease at the tape's edge that snaps shut ends the path, though the dome hardly moves.
    """
    sign = 1.0 if goal_mpa >= 0 else -1.0
    for leap in settings.leaps_mbar:
        target = path.pressure_mpa[-1] + sign * leap * 1e-4
        if abs(target) <= abs(goal_mpa):
            point, spent = solve_point(
                assembly, path.displacements[-1], target, parameters, settings
            )
            path.iterations += spent
            if point is not None and not fault(
                assembly, point.unknowns, point.state, settings.limits
            ):
                return target, point
    return None


def extrapolate(path: EquilibriumPath, target: float) -> Array:
    """Return the unknowns expected at `target` from the last two points and their slopes."""
    p1, u1, s1 = path.pressure_mpa[-1], path.displacements[-1], path.slopes[-1]
    if len(path.pressure_mpa) == 1:
        return u1 + (target - p1) * s1
    p0, u0, s0 = path.pressure_mpa[-2], path.displacements[-2], path.slopes[-2]
    h = p1 - p0
    t = (target - p0) / h
    return (
        (1 + 2 * t) * (1 - t) ** 2 * u0
        + h * t * (1 - t) ** 2 * s0
        + t**2 * (3 - 2 * t) * u1
        + h * t**2 * (t - 1) * s1
    )


def _size(unknowns: Array, watch: int | None) -> float:
    """Return how large unknowns (n,) are: the one that is watched, or the largest."""
    return float(abs(unknowns[watch]) if watch is not None else abs(unknowns).max())


def _append(path: EquilibriumPath, pressure: float, point: Point, look: Look | None) -> None:
    path.pressure_mpa.append(pressure)
    path.displacements.append(point.unknowns)
    path.slopes.append(point.slope)
    path.j_min.append(point.state.j_min)
    path.j_max.append(point.state.j_max)
    path.energy.append(point.energy)
    path.volume.append(point.volume)
    if look is not None:
        look(pressure, point)


def _stopped(reason: str, path: EquilibriumPath) -> str:
    return f"{reason} beyond {path.pressure_mpa[-1] * 1e4:.2f} mbar"
