"""Quality gates: each fires on a curve made for it, as early as it can; clean curves pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from drivers.connection import Connection
from drivers.dialects import get_dialect
from drivers.events import (
    PROGRAM_END,
    Arm,
    Event,
    Gap,
    Identify,
    InstrumentState,
    Load,
    Loaded,
    Sample,
    Start,
    State,
    TimedEvent,
)
from drivers.limits import program_bounds
from sim_device.device import Device
from sim_device.files import SensorSection
from skinlab.acquisition.pipeline import Pipeline
from skinlab.acquisition.sources import wire_segments
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.inference.result import Identification
from skinlab.quality.gates import GATES, all_gates, judge
from skinlab.quality.gates.base import whole
from skinlab.quality.gates.expected import least_deflection_mm
from skinlab.recording.stream import CurveCompleted, Flagged, Identified, Message, Planned, Sampled

TRACE_HZ = 200.0


class _NoSkin:
    def prepare(self, aperture_mm: float, load: Load) -> None:
        pass

    def start(self) -> None:
        pass

    def deflection_mm(self, time_s: float, pressure_mbar: float) -> float:
        return 0.0


@cache
def trace(program: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (s), true pressure (mbar) and segment of a run of the simulated probe, 200 a second."""
    sensor = SensorSection(
        noise_um=0, resolution_um=0, pressure_noise_mbar=0, pressure_resolution_mbar=0
    )
    device = Device(_NoSkin(), sensor, keep_alive_s=1e6)
    connection = Connection(get_dialect("reference"))
    samples: list[Sample] = []

    def listen() -> None:
        connection.receive_data(device.transmit())
        while (event := connection.next_event()) is not None:
            if isinstance(event, Sample):
                samples.append(event)

    segments = wire_segments(parse_program(program))
    bounds = program_bounds(segments)
    load = Load(segments, TRACE_HZ, bounds.max_pressure_mbar, bounds.max_suction_s)
    for command in (Identify(), load, Arm(), Start()):
        device.receive(connection.send(command))
        listen()
    while connection.state is InstrumentState.RUNNING:
        device.process(0.5)
        listen()
    kept = [s for s in samples if s.segment < len(segments)]
    return (
        np.array([s.device_time_s for s in kept]),
        np.array([s.pressure_mbar for s in kept]),
        np.array([s.segment for s in kept]),
    )


def _nothing(run: Run) -> None:
    pass


@dataclass
class Run:
    """One run: what the instrument says. `spoil` changes what is there, `misread` what is read."""

    program: str = "ramp:100@20,ramp:0@20"
    aperture_mm: float = 6.0
    thickness_mm: float = 1.0
    stiffness: float = 0.1  # of the stiffest skin that the gates know
    bend: float = 3.0  # how much the dome stiffens
    rate_hz: float = 20.0
    noise_um: float = 3.0
    resolution_um: float = 1.0
    pressure_noise_mbar: float = 0.2
    pressure_resolution_mbar: float = 0.1
    seed: int = 0
    cycle: int = 1
    repeat: int = 1
    spoil: Callable[[Run], None] = _nothing
    misread: Callable[[Run], None] = _nothing
    lose: frozenset[int] = frozenset()
    cut_at_s: float | None = None
    time_s: np.ndarray = field(init=False)
    pressure_mbar: np.ndarray = field(init=False)
    deflection_mm: np.ndarray = field(init=False)
    segment: np.ndarray = field(init=False)

    @property
    def setup(self) -> Setup:
        return Setup(
            self.aperture_mm,
            self.thickness_mm,
            parse_program(self.program),
            cycle=self.cycle,
            repeat=self.repeat,
        )

    def dome_mm(self, pressure_mbar: np.ndarray) -> np.ndarray:
        linear = least_deflection_mm(self.setup, 1.0) / self.stiffness
        scale = self.aperture_mm / 2 / self.bend
        return scale * np.arcsinh(linear * pressure_mbar / scale)

    def events(self) -> list[Event]:
        rng = np.random.default_rng(self.seed)
        every = round(TRACE_HZ / self.rate_hz)
        time_s, pressure, segment = (a[::every].copy() for a in trace(self.program))
        n = len(time_s)
        self.time_s, self.segment = time_s, segment
        self.pressure_mbar = pressure
        self.deflection_mm = self.dome_mm(pressure)
        self.spoil(self)
        self.pressure_mbar = self.pressure_mbar + self.pressure_noise_mbar * rng.normal(size=n)
        self.deflection_mm = self.deflection_mm + 1e-3 * self.noise_um * rng.normal(size=n)
        _round(self.pressure_mbar, self.pressure_resolution_mbar)
        _round(self.deflection_mm, 1e-3 * self.resolution_um)
        self.misread(self)
        events: list[Event] = [
            Loaded((), self.rate_hz, 500.0, 60.0),
            State(InstrumentState.RUNNING, "started", 0.0),
        ]
        due = 0
        for k in range(n):
            if k in self.lose or (self.cut_at_s is not None and time_s[k] > self.cut_at_s):
                continue
            if k > due:
                events.append(Gap(due, k))
            due = k + 1
            events.append(
                Sample(
                    k,
                    float(self.time_s[k]),
                    float(self.pressure_mbar[k]),
                    float(self.deflection_mm[k]),
                    int(segment[k]),
                )
            )
        reason = PROGRAM_END if self.cut_at_s is None else "host"
        return [*events, State(InstrumentState.VENTING, reason, 50.0)]


def _round(values: np.ndarray, resolution: float) -> None:
    if resolution > 0:
        values[:] = resolution * np.round(values / resolution)


@dataclass
class Told:
    """What came out of a pipeline."""

    messages: list[Message]

    @property
    def names(self) -> set[str]:
        return {m.finding.gate for m in self.messages if isinstance(m, Flagged)}

    @property
    def curves(self) -> list[Curve]:
        return [m.curve for m in self.messages if isinstance(m, CurveCompleted)]

    def known_at_s(self, gate: str) -> float | None:
        """Time of the sample after which the gate was told; None: at the end, or never."""
        last = None
        for message in self.messages:
            if isinstance(message, Sampled):
                last = message.sample.device_time_s
            elif isinstance(message, CurveCompleted):
                return None
            elif isinstance(message, Flagged) and message.finding.gate == gate:
                return last
        return None


def play(*runs: Run, identifier: Any = None) -> Told:
    """Feed runs to a pipeline, one after the other."""
    messages: list[Message] = []
    pipeline = Pipeline(identifier, [messages.append])
    for run in runs:
        pipeline.handle(Planned(run.setup))
        for event in run.events():
            pipeline.handle(TimedEvent(0.0, event))
    pipeline.end()
    return Told(messages)


# ---- what can be wrong ---------------------------------------------------------------------------


def from_on(begin_s: float, change: Callable[[Run, np.ndarray], None]) -> Callable[[Run], None]:
    return lambda run: change(run, run.time_s >= begin_s)


def leak(part: float, begin_s: float = 0.0) -> Callable[[Run], None]:
    def change(run: Run, late: np.ndarray) -> None:
        run.pressure_mbar[late] *= 1 - part
        run.deflection_mm = run.dome_mm(run.pressure_mbar)

    return from_on(begin_s, change)


def lifted(run: Run) -> None:
    run.pressure_mbar *= 0.05
    run.deflection_mm *= 0


def in_the_air(run: Run) -> None:
    run.deflection_mm *= 0


def freeze(begin_s: float, for_s: float = 1e9) -> Callable[[Run], None]:
    def change(run: Run) -> None:
        here = np.flatnonzero((run.time_s >= begin_s) & (run.time_s < begin_s + for_s))
        run.deflection_mm[here] = run.deflection_mm[here[0]]

    return change


def freeze_pressure(run: Run) -> None:
    here = np.flatnonzero(run.time_s >= 2.0)
    run.pressure_mbar[here] = run.pressure_mbar[here[0]]


def clip(limit_mm: float) -> Callable[[Run], None]:
    def change(run: Run) -> None:
        run.deflection_mm = np.minimum(run.deflection_mm, limit_mm)

    return change


def stretch(factor: float) -> Callable[[Run], None]:
    """The pump is slower or faster than asked; segments last as long as they should."""

    def change(run: Run) -> None:
        first = run.segment == 0
        run.pressure_mbar[first] *= factor
        run.pressure_mbar[~first] *= factor
        run.deflection_mm = run.dome_mm(run.pressure_mbar)

    return change


def late(by_s: float) -> Callable[[Run], None]:
    def change(run: Run) -> None:
        run.pressure_mbar = np.interp(run.time_s - by_s, run.time_s, run.pressure_mbar)
        run.deflection_mm = run.dome_mm(run.pressure_mbar)

    return change


def stall_clock(run: Run) -> None:
    run.time_s[run.time_s > 2.0] += 0.4


def turn_clock_back(run: Run) -> None:
    run.time_s[50:] -= 0.3


# ---- each gate fires, and early ------------------------------------------------------------------

RAMP = "ramp:100@20"
BOTH = "ramp:100@20,ramp:0@20"
HELD = "ramp:100@20,hold:5,release"

CASES = [
    ("leak", Run(spoil=leak(0.3)), 3.5),
    ("leak", Run(HELD, spoil=leak(0.1)), 6.5),
    ("leak", Run(HELD, spoil=leak(0.2, 6.0)), 7.0),
    ("no_contact", Run(spoil=lifted), 1.5),
    ("no_contact", Run(spoil=in_the_air), 2.5),
    ("frozen", Run(misread=freeze(2.0)), 2.8),
    ("frozen", Run(misread=freeze(7.0, 1.0)), 7.8),
    ("frozen", Run(misread=freeze(1.0), cut_at_s=1.6), 1.6),
    ("frozen", Run(RAMP, misread=freeze_pressure), 3.5),
    ("saturated", Run(misread=clip(0.9)), 4.0),
    ("saturated", Run(RAMP, misread=clip(0.9)), 4.0),
    ("too_few_points", Run("ramp:100@200,hold:3"), 0.0),
    ("too_few_points", Run("mode1:100,3,2"), 0.0),
    ("time_gaps", Run(misread=stall_clock), 2.7),
    ("time_gaps", Run(misread=turn_clock_back), 2.6),
    ("lost_frames", Run(lose=frozenset({40})), 2.3),
    ("ramp_not_as_asked", Run(spoil=stretch(1.2)), 2.0),
    ("ramp_not_as_asked", Run("ramp:100@20,hold:3", spoil=late(0.8)), 2.0),
    ("ramp_not_as_asked", Run(BOTH, spoil=leak(0.3)), 2.5),
    ("not_first_cycle", Run(cycle=2), 0.0),
]


@pytest.mark.parametrize(("gate", "run", "known_by_s"), CASES)
def test_a_gate_fires_on_a_curve_made_for_it_as_soon_as_it_can(gate, run, known_by_s):
    told = play(run)
    assert gate in told.names
    known_at_s = told.known_at_s(gate)
    assert known_at_s is not None, "only at the end"
    assert known_at_s <= known_by_s


def test_a_repeat_that_differs_is_told_while_it_grows():
    first, second = Run(seed=1, cycle=2), Run(seed=2, cycle=3)
    moved = Run(seed=3, cycle=4, stiffness=0.08)
    told = play(first, second, moved)
    flagged = [m for m in told.messages if isinstance(m, Flagged)]
    (found,) = [m for m in flagged if m.finding.gate == "repeat_differs"]
    assert found.index == 3
    assert "more than in curve 1, curve 2" in found.finding.sentence
    assert told.messages.index(found) < told.messages.index(
        next(m for m in told.messages if isinstance(m, CurveCompleted) and m.index == 3)
    )


def test_first_and_later_loadings_and_other_setups_are_not_compared():
    others = (
        Run(cycle=1),
        Run(cycle=2, stiffness=0.05),
        Run(cycle=2, stiffness=0.1, program=RAMP),
        Run(cycle=2, stiffness=0.2, aperture_mm=2.0),
    )
    cut = Run(cycle=2, stiffness=0.2, cut_at_s=4.0)
    assert "repeat_differs" not in play(*others).names | play(cut, others[1]).names


def test_what_else_a_fault_shows_is_told_apart():
    """One cause, the names that belong to it, and no others."""
    assert play(Run(spoil=lifted)).names == {"no_contact"}
    assert play(Run(misread=freeze(7.0, 1.0))).names == {"frozen"}
    assert play(Run(lose=frozenset({40}))).names == {"lost_frames"}
    assert play(Run(lose=frozenset({40, 41, 42}))).names == {"lost_frames", "time_gaps"}
    assert play(Run("ramp:100@20,hold:3", spoil=late(0.8))).names == {"ramp_not_as_asked"}


def test_a_saturated_sensor_that_came_back_is_not_a_frozen_one():
    for spoiled, gate in ((clip(0.9), "saturated"), (freeze(4.0), "frozen")):
        (curve,) = play(Run(misread=spoiled)).curves
        assert [one.name for one in all_gates() if judge(one, whole(curve)) is not None] == [gate]


def test_a_run_that_the_operator_cuts_fails_no_gate_for_it():
    assert play(Run(cut_at_s=4.0)).names == set()
    assert play(Run("ramp:100@20,hold:5", cut_at_s=5.5)).names == set()


# ---- and clean curves pass -----------------------------------------------------------------------

PROGRAMS = [
    "ramp:100@20",
    "ramp:100@20,ramp:0@20",
    "ramp:300@60",
    "mode2:100@50,2",
    "mode4:100@40,1,2",
    "ramp:100@40,hold:2,ramp:0@40",
    "ramp:50@25,hold:1,ramp:0@25",
    "ramp:60@60,hold:2,release,rest:1",
    "ramp:500@125,ramp:0@125",
    "ramp:20@8,ramp:0@8",
    "ramp:50@50,hold:1,ramp:100@50,hold:1,release,rest:1,ramp:100@50,ramp:0@50",
    "mode1:100,1,1,2",
    "mode3:100,1@50",
]


def clean_run(number: int) -> Run:
    rng = np.random.default_rng(number)
    program = PROGRAMS[number % len(PROGRAMS)]
    steps = program.startswith(("mode1", "mode3"))
    return Run(
        program,
        aperture_mm=float(rng.choice([2.0, 4.0, 6.0, 8.0])),
        thickness_mm=float(rng.uniform(0.6, 2.5)),
        stiffness=float(10 ** rng.uniform(-1.5, -0.3)),  # X1 of 0.01 to 0.15 MPa
        bend=float(rng.uniform(1.5, 6.0)),
        # A step has samples enough for three parameters only where there are many a second.
        rate_hz=200.0 if steps else float(rng.choice([20.0, 20.0, 50.0, 100.0])),
        noise_um=float(rng.choice([0.0, 1.0, 3.0, 5.0])),
        resolution_um=float(rng.choice([0.0, 1.0, 2.0])),
        pressure_noise_mbar=float(rng.choice([0.0, 0.1, 0.2, 0.5])),
        pressure_resolution_mbar=float(rng.choice([0.0, 0.1])),
        seed=number,
    )


@pytest.mark.long
def test_two_hundred_clean_curves_pass():
    alarms = []
    for number in range(200):
        run = clean_run(number)
        told = play(run)
        assert len(told.curves) == 1
        names = told.names
        if run.program.startswith(("mode1", "mode3")):
            names = names - {"too_few_points"}  # true of a step: 50 ms of loading
        alarms += [(number, m.finding) for m in told.messages if isinstance(m, Flagged)
                   if m.finding.gate in names]  # fmt: skip
    assert alarms == []


def test_clean_repeats_pass():
    runs = [clean_run(1)]
    runs = [replace(runs[0], seed=k, cycle=k, repeat=k, noise_um=5.0) for k in range(1, 6)]
    assert play(*runs).names == {"not_first_cycle"}


# ---- the interface -------------------------------------------------------------------------------


BUILT_IN = [gate for gate in all_gates() if GATES.origin(gate.name) is None]


def test_every_gate_has_a_curve_that_fails_it_and_the_name_of_its_file():
    assert {gate.name for gate in BUILT_IN} == {case[0] for case in CASES} | {"repeat_differs"}
    for gate in BUILT_IN:
        assert gate.check.__module__ == f"skinlab.quality.gates.{gate.name}"


@pytest.mark.parametrize("case", CASES, ids=lambda case: case[0])
def test_a_finding_says_what_and_what_to_do(case):
    for message in play(case[1]).messages:
        if isinstance(message, Flagged):
            found = message.finding
            assert len(found.sentence) > 20
            assert not found.sentence.endswith(".")
            assert len(found.advice) > 10
            assert str(found) == f"{found.gate}: {found.sentence}; {found.advice}"


def test_the_least_that_skin_moves_is_less_than_any_of_the_database(table):
    """Three times as stiff as its stiffest, and then some."""
    for aperture_mm in (2.0, 4.0, 6.0, 8.0):
        for thickness_mm in (0.6, 1.0, 2.0):
            geometry = table_geometry(aperture_mm, thickness_mm)
            model = table.model(geometry, np.array([20.0, 50.0]))
            stiffest = model.deflection_mm(np.array([[0.1, 4.9, 0.2]]))[0]
            setup = Setup(aperture_mm, thickness_mm)
            for pressure, moved in zip((20.0, 50.0), stiffest, strict=True):
                assert 0.1 * moved < least_deflection_mm(setup, pressure) < 0.5 * moved


def table_geometry(aperture_mm: float, thickness_mm: float) -> Any:
    from skinlab.mechanics.fem.suction import Geometry

    return Geometry(aperture_mm, thickness_mm)


# ---- through the pipeline ------------------------------------------------------------------------


def test_failed_gates_are_flags_of_the_result_once_and_told_before_it():
    def identify(curve: Curve) -> Identification:
        return Identification(curve.name, curve.setup, None, flags=("not_first_cycle", "x"))

    told = play(Run(cycle=2, lose=frozenset({40})), identifier=identify)
    (found,) = [m for m in told.messages if isinstance(m, Identified)]
    assert found.result.flags == ("not_first_cycle", "x", "lost_frames")
    assert told.messages[-2] == found or told.messages.index(found) > max(
        k for k, m in enumerate(told.messages) if isinstance(m, Flagged)
    )


def test_the_same_events_give_the_same_findings_at_the_same_sample():
    a, b = (play(Run(spoil=leak(0.3), seed=4)).messages for _ in range(2))
    assert [m for m in a if isinstance(m, Flagged)] == [m for m in b if isinstance(m, Flagged)]
    assert [type(m) for m in a] == [type(m) for m in b]


def test_a_clock_that_goes_back_leaves_a_curve(caplog):
    told = play(Run(misread=turn_clock_back))
    (curve,) = told.curves
    assert np.all(np.diff(curve.time_s) > 0)
    assert len(curve) > 150


@pytest.mark.long
def test_a_long_curve_costs_no_more_a_sample_than_a_short_one():
    """What a gate sees of a growing curve does not grow with it."""
    (curve,) = play(Run("ramp:100@20,hold:50", rate_hz=100.0)).curves
    view = replace(whole(curve), complete=False)
    assert len(view.tail.time_s) <= 302
    assert view.tail.tail is view.tail
