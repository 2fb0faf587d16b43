"""The skin under the simulated probe: finite elements, solved when a program is loaded.

Never the database, and not the mesh that built it: 9-node elements without quarter points, so that
a perfect score cannot come from fitting a model with itself. It is solved along the pressure that
this pump will make of the program, with the hidden effects of its file, and read between the solved
steps; where the pressure turns out otherwise (a vent, a fault), it answers the difference at once.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from drivers.events import Load, Segment, SegmentKind
from sim_device.device import STEP_US, Skin
from sim_device.files import TRUTHFUL, ProbeSection, SkinSection
from sim_device.plant import Plant
from sim_device.program import Run
from sim_device.timing import TIMING
from skinlab.curves.phantoms import read_phantoms
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import Hold, Ramp, Release, Rest, Until, parse_program
from skinlab.mechanics.effects.base import Effects
from skinlab.mechanics.effects.model import (
    Sensors,
    SkinCurve,
    felt_path,
    problem_of,
    solve_skin,
)
from skinlab.mechanics.fem.element import QUAD9_FULL
from skinlab.mechanics.fem.skin import Skin as Law
from skinlab.mechanics.fem.skin import SkinProblem
from skinlab.mechanics.fem.suction import Discretisation, Geometry
from skinlab.mechanics.materials import get_law

Array = NDArray[np.float64]

MESH = Discretisation("simulated-1", QUAD9_FULL, 0.01, 1.6, 0.125, 0.125, 0.25)
COARSE_MESH = Discretisation("simulated-coarse", QUAD9_FULL, 0.05, 1.6, 0.3, 0.4, 0.5)

STEP_S = STEP_US / 1e6
_ABOVE_MBAR = 15.0  # a pump overshoots a little, and the skin follows until the firmware vents
_HIGHEST_MBAR = 1000.0  # no suction is higher
_PATH_MBAR = 0.25  # how closely the pressure's path is followed with memory
_TABLE_MBAR = 0.01
_KIT = 40_961  # so that a kit and the noise of the same seed have nothing in common


def planned(
    load: Load, probe: ProbeSection = TRUTHFUL, dome: Callable[[float, float], float] | None = None
) -> PressurePath:
    """Return the pressure that pump and valve will make of this program, if nothing goes wrong.

    `dome` gives the deflection (mm) that the firmware reads at a time and a pressure, and so where
    a rise until a height ends; None: nowhere.
    """
    plant, run = Plant(STEP_S), Run(load)
    gain, offset = probe.pressure_gain, probe.pressure_offset_mbar
    run.advance(0, 0.0)
    pressures = [0.0]
    while not run.ended:
        run.advance(
            len(pressures) * STEP_US,
            gain * plant.pressure_mbar + offset,
            partial(_seen, dome, probe, (len(pressures) - 1) * STEP_S, plant.pressure_mbar),
        )
        wanted = max(0.0, (run.set_point_mbar - offset) / gain) if run.set_point_mbar > 0 else 0.0
        plant.step(wanted, run.valve_open)
        pressures.append(plant.pressure_mbar)
    times = STEP_S * np.arange(len(pressures), dtype=np.float64)
    return PressurePath.of_samples(times, np.array(pressures), _PATH_MBAR)


@dataclass(frozen=True)
class _Dome:
    """Tables of one loading: quick to read, however often."""

    pressure_mbar: Array
    instant_mm: Array  # without memory, at these pressures
    path: PressurePath  # of the pump
    felt: PressurePath  # by the skin
    time_s: Array
    path_mbar: Array  # at these times
    path_mm: Array  # the same; empty where there is no memory
    shift_mbar: Array  # what memory is worth

    def deflection_mm(self, time_s: float, pressure_mbar: float) -> float:
        if self.felt is not self.path:
            pressure_mbar += float(self.felt(time_s)) - float(self.path(time_s))
        if not len(self.path_mm):
            return self._instant(pressure_mbar)
        along, on_path, shift = (
            float(np.interp(time_s, self.time_s, y))
            for y in (self.path_mm, self.path_mbar, self.shift_mbar)
        )
        return along + self._instant(pressure_mbar + shift) - self._instant(on_path + shift)

    def _instant(self, pressure_mbar: float) -> float:
        return float(np.interp(pressure_mbar, self.pressure_mbar, self.instant_mm))


class SolvedSkin:
    """A skin of any law with any effects: its dome depends on pressure, time and cycle."""

    def __init__(self, skin: SkinSection, effects: Effects, probe: ProbeSection = TRUTHFUL) -> None:
        self._probe = probe
        self._law = Law((skin.X1_MPa, skin.X2_MPa, skin.nu), skin.kappa)
        if skin.law is not None:
            values = get_law(skin.law).ordered(skin.parameters)
            self._law = Law(values, skin.kappa, skin.law)
        self._thickness_mm = skin.thickness_mm
        self._effects = effects
        self._sensors = Sensors.of(effects)
        self._cycle = 0
        self._geometry = Geometry(6.0, skin.thickness_mm)
        self._load: Load | None = None
        self._present: _Dome | None = None  # that of this loading, once it is read
        self._domes: dict[SkinProblem, _Dome] = {}
        self._times_s: list[float] = []  # readings of this loading, and the pressures there
        self._pressures_mbar: list[float] = []
        self._problem_of(1)  # refuses what cannot be

    def prepare(self, aperture_mm: float, load: Load) -> None:
        """Solve along the program, for the next loading and those after it.

        Raises:
            ValueError: the finite elements do not hold that far.
        """
        geometry = Geometry(aperture_mm, self._thickness_mm)
        if (geometry, load) != (self._geometry, self._load):
            self._geometry, self._load, self._domes = geometry, load, {}
            self._present = None
        for cycle in (self._cycle + 1, self._cycle + 2):
            self._dome(cycle)

    def start(self) -> None:
        """Begin another loading of this site."""
        self._cycle += 1
        self._restart()

    def deflection_mm(self, time_s: float, pressure_mbar: float) -> float:
        """Return what the sensor makes of the apex's height; zero before anything was prepared."""
        if self._load is None:
            return 0.0
        if self._present is None:
            self._present = self._dome(max(1, self._cycle))
        dome = self._present
        self._times_s.append(time_s)
        self._pressures_mbar.append(pressure_mbar)
        now = np.array([time_s])
        when = float(self._sensors.when(now)[0])
        if when != time_s:
            pressure_mbar = self._pressure_at(when, dome.path)
        deflection = np.array([dome.deflection_mm(when, pressure_mbar)])
        read = self._sensors.read(now, np.array([pressure_mbar]), deflection, self._times_s[0])
        return float(read[0])

    def _restart(self) -> None:
        self._present = None
        self._times_s.clear()
        self._pressures_mbar.clear()

    def _pressure_at(self, time_s: float, path: PressurePath) -> float:
        """Return the pressure at another time: the path's, and how far the last reading was off."""
        k = max(0, bisect_right(self._times_s, time_s) - 1)
        off = self._pressures_mbar[k] - float(path(self._times_s[k]))
        return float(path(time_s)) + off

    def _problem_of(self, cycle: int) -> SkinProblem:
        return problem_of(self._law, self._effects, self._geometry, cycle)

    def _dome(self, cycle: int) -> _Dome:
        problem = self._problem_of(cycle)
        if problem not in self._domes:
            assert self._load is not None
            self._domes[problem] = _solved(problem, self._load, self._effects, self._probe)
        return self._domes[problem]


def _seen(
    dome: Callable[[float, float], float] | None,
    probe: ProbeSection,
    time_s: float,
    pressure_mbar: float,
) -> float:
    if dome is None:
        return -math.inf
    read = probe.deflection_gain * dome(time_s, pressure_mbar)
    return read + 1e-3 * probe.deflection_offset_um


def _solved(
    problem: SkinProblem, load: Load, effects: Effects, probe: ProbeSection = TRUTHFUL
) -> _Dome:
    path = planned(load, probe)
    top = max(load.max_pressure_mbar, path.top_mbar)
    untils = sum(s.kind is SegmentKind.UNTIL for s in load.segments)
    if untils:
        # Soft skin need not hold at pressures that its height never lets it come to
        reach = _elastic(problem, top, whole=False)
        path = planned(load, probe, lambda _, p: reach(np.array([p]))[0])
        top = path.top_mbar
    dome = _along(problem, path, top, effects, whole=not untils)
    for _ in range(untils if problem.prony else 0):
        # What is remembered up to a height says where it is reached, and so what follows
        path = planned(load, probe, dome.deflection_mm)
        dome = _along(problem, path, max(top, path.top_mbar), effects, whole=False)
    return dome


def _elastic(problem: SkinProblem, top_mbar: float, *, whole: bool) -> Callable[[Array], Array]:
    """Return the dome without memory (mm) at suctions (mbar); `whole`: it must hold to the top."""
    goal = 1.1 * top_mbar + _ABOVE_MBAR
    instant = solve_skin(problem.elastic, PressurePath((0.0, 1.0), (0.0, goal)), _mesh())
    if whole:
        _check(instant, top_mbar)
    if instant.instant is None:
        raise ValueError("the simulated skin does not hold at all")
    return instant.instant


def _along(
    problem: SkinProblem, path: PressurePath, top_mbar: float, effects: Effects, *, whole: bool
) -> _Dome:
    """Return the tables of one loading along a path of the pump."""
    felt = felt_path(effects, path)
    if felt == path:
        felt = path
    times = np.arange(path.time_s[0], path.time_s[-1] + STEP_S, STEP_S)
    along, shift = np.empty(0), np.empty(0)
    if problem.prony:
        curve = solve_skin(problem, felt, _mesh())
        _check(curve, felt.top_mbar)
        along, shift = curve.at(times, felt(times)), curve.shift_mbar(times)
    instant = _elastic(problem, max(top_mbar, felt.top_mbar), whole=whole)
    # Beyond what was solved it goes on straight: only a fault of the pump leads there
    pressure = np.arange(0.0, _HIGHEST_MBAR + shift.max(initial=0.0), _TABLE_MBAR)
    return _Dome(pressure, instant(pressure), path, felt, times, felt(times), along, shift)


def _mesh() -> Discretisation:
    return COARSE_MESH if TIMING.coarse_skin else MESH


def _check(curve: SkinCurve, top_mbar: float) -> None:
    if curve.holds_to_mbar < top_mbar - 1e-9:
        raise ValueError(
            f"the simulated skin holds to {curve.holds_to_mbar:.0f} mbar only, "
            f"and the program goes to {top_mbar:g}"
        )


class Rigid:
    """A body that no suction moves."""

    def __init__(self, height_mm: float) -> None:
        self._height_mm = height_mm

    def prepare(self, aperture_mm: float, load: Load) -> None:
        """Do nothing."""

    def start(self) -> None:
        """Do nothing."""

    def deflection_mm(self, time_s: float, pressure_mbar: float) -> float:
        """Return its height, always."""
        return self._height_mm


def make_skin(skin: SkinSection, effects: Effects, probe: ProbeSection = TRUTHFUL) -> Skin:
    """Return the skin that a SKIN.toml describes, under this probe.

    Raises:
        ValueError: an effect or a parameter that there is not, or out of its bounds.
    """
    return SolvedSkin(skin, effects, probe)


def make_phantom(name: str, seed: int, probe: ProbeSection = TRUTHFUL) -> Skin:
    """Return a phantom of the kit (skinlab/data/phantoms.toml), under this probe.

    It differs from what its sheet states by the sheet's standard deviations; one seed, one kit.

    Raises:
        ValueError: the kit has no such phantom.
    """
    kit = read_phantoms()
    known = [phantom.name for phantom in kit]
    if name not in known:
        raise ValueError(f"there is no phantom {name!r}; expected one of {', '.join(known)}")
    number = known.index(name)
    stated = kit[number]
    off = np.random.default_rng([_KIT, seed, number]).standard_normal(2)
    if stated.kind == "rigid":
        return Rigid(stated.height_mm + stated.height_sd_mm * off[0])
    assert stated.X1_MPa is not None
    silicone = SkinSection(
        X1_MPa=stated.X1_MPa * float(np.exp(stated.X1_relative_sd * off[0])),
        X2_MPa=0.0,
        nu=stated.nu,
        kappa="consistent",
        thickness_mm=stated.thickness_mm + stated.thickness_sd_mm * float(off[1]),
    )
    return SolvedSkin(silicone, {}, probe)


# ---- curves without a wire: of a cohort -----------------------------------------------------


def load_of(program: str, rate_hz: float) -> Load:
    """Return what the instrument is told to do for a program in words.

    Raises:
        ValueError: it is no program.
    """
    asked = parse_program(program)
    return Load(
        tuple(_segment(s) for s in asked.segments),
        rate_hz,
        asked.max_pressure_mbar,
        asked.longest_suction_s,
    )


def program_duration_s(program: str) -> float:
    """Return how long a program takes, without the final vent."""
    return parse_program(program).duration_s


def _segment(segment: Ramp | Until | Hold | Release | Rest) -> Segment:
    match segment:
        case Ramp(target, rate):
            return Segment(SegmentKind.RAMP, target_mbar=target, rate_mbar_per_s=rate)
        case Hold(duration):
            return Segment(SegmentKind.HOLD, duration_s=duration)
        case Until(height, rate, most):
            return Segment(
                SegmentKind.UNTIL, target_mbar=most, rate_mbar_per_s=rate, height_mm=height
            )
        case Rest(duration):
            return Segment(SegmentKind.REST, duration_s=duration)
        case Release():
            return Segment(SegmentKind.RELEASE)


class Domes:
    """Domes of many skins along one program; those that differ in stiffness alone are solved once.

    Without a memory the dome depends on p/X1, X2/X1 and ν, so that a stiffer skin of the same
    ratio is the same solution at a lower pressure. With effects each skin is solved for itself.
    """

    def __init__(self, effects: Effects, aperture_mm: float, load: Load) -> None:
        self._effects, self._aperture_mm, self._load = effects, aperture_mm, load
        self._sensors = Sensors.of(effects)
        self._path = planned(load)
        self._solved: dict[tuple[float, float, str, float], tuple[float, SkinCurve]] = {}

    def curve(
        self, skin: SkinSection, time_s: Array, cycle: int, softest_MPa: float
    ) -> tuple[Array, Array]:
        """Return pressure (n,) in mbar and deflection (n,) in mm at these times, without noise.

        `softest_MPa` is the least X1 that a skin of this ratio and ν will have: it is solved once.

        Raises:
            ValueError: the finite elements do not hold that far, or a value is out of range.
        """
        pressure = np.asarray(self._path(time_s), dtype=float)
        when = np.asarray(self._sensors.when(time_s), dtype=float)
        felt = np.asarray(self._path(when), dtype=float)
        if self._effects:
            dome = _solved(self._problem(skin, cycle), self._load, self._effects)
            clean = np.array(
                [
                    dome.deflection_mm(t, p)
                    for t, p in zip(when.tolist(), felt.tolist(), strict=True)
                ]
            )
        else:
            clean = self._scaled(skin, felt, min(softest_MPa, skin.X1_MPa))
        return pressure, self._sensors.read(time_s, pressure, clean, float(time_s[0]))

    def _scaled(self, skin: SkinSection, pressure_mbar: Array, softest_MPa: float) -> Array:
        ratio = skin.X2_MPa / skin.X1_MPa
        key = (round(ratio, 9), skin.nu, skin.kappa, skin.thickness_mm)
        if key not in self._solved or self._solved[key][0] > skin.X1_MPa * (1 + 1e-12):
            goal = 1.02 * self._load.max_pressure_mbar + 1.0
            soft = Law((softest_MPa, ratio * softest_MPa, skin.nu), skin.kappa)
            geometry = Geometry(self._aperture_mm, skin.thickness_mm)
            problem = problem_of(soft, {}, geometry)
            found = solve_skin(problem, PressurePath((0.0, 1.0), (0.0, goal)), MESH)
            _check(found, goal)
            self._solved[key] = (softest_MPa, found)
        solved_MPa, found = self._solved[key]
        assert found.instant is not None
        return found.instant(pressure_mbar * (solved_MPa / skin.X1_MPa))

    def _problem(self, skin: SkinSection, cycle: int) -> SkinProblem:
        law = Law((skin.X1_MPa, skin.X2_MPa, skin.nu), skin.kappa)
        return problem_of(law, self._effects, Geometry(self._aperture_mm, skin.thickness_mm), cycle)
