"""Instruments for the watchdog, in numbers only: an honest one with a slow pump and a poor link."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.events import (
    PROGRAM_DONE,
    PROGRAM_END,
    Arm,
    Event,
    Load,
    Sample,
    Segment,
    SegmentKind,
    Start,
    State,
)
from drivers.events import InstrumentState as S
from drivers.limits import program_bounds
from drivers.watchdog import Watchdog
from sim_device.program import Run

STEP_S = 0.005
DOME_MM = 0.004  # deflection per mbar


def ready(dog: Watchdog, segments: Sequence[Segment], rate_hz: float = 20.0) -> None:
    """Load, arm and start at host time 0."""
    bounds = program_bounds(segments)
    load = Load(tuple(segments), rate_hz, bounds.max_pressure_mbar, bounds.max_suction_s)
    dog.commanded(load, 0.0)
    for state, command in ((S.LOADED, Arm()), (S.ARMED, Start())):
        assert dog.on_event(State(state, "", 0.0), 0.0) == []
        dog.commanded(command, 0.0)


@dataclass(frozen=True)
class Honest:
    """Does as it was told, as well as it can."""

    delay_s: float = 0.0  # of pump and valve
    pump_s: float = 0.02  # time constant
    valve_s: float = 0.05
    clock: float = 1.0  # s of the instrument in one of the host
    start_s: float = 0.0  # until it answers to Start
    noise_mbar: float = 0.0
    rate_hz: float = 20.0
    stalls: tuple[tuple[float, float], ...] = ()  # host time and length: nothing comes
    seed: int = 0

    def run(self, segments: Sequence[Segment]) -> list[tuple[float, Event]]:
        """Give what arrives, and when by the host's clock."""
        rng = random.Random(self.seed)
        run = Run(Load(tuple(segments), self.rate_hz, 500.0, 60.0))
        pressure, count, vented = 0.0, 0, None
        commands: list[tuple[float, bool]] = []
        said: list[tuple[float, Event]] = [(self.start_s, State(S.RUNNING, "started", 0.0))]
        step = 0
        while vented is None or pressure >= 2.0:
            time_s = step * STEP_S
            run.advance(round(1e6 * time_s), pressure, lambda mbar=pressure: DOME_MM * mbar)
            commands.append((run.set_point_mbar, run.valve_open))
            wanted, is_open = commands[max(0, step - round(self.delay_s / STEP_S))]
            constant_s = self.valve_s if is_open else self.pump_s
            pressure += ((0.0 if is_open else wanted) - pressure) * (
                1.0 - math.exp(-STEP_S / max(constant_s, 1e-6))
            )
            host_s = self.start_s + time_s / self.clock
            if run.ended and vented is None:
                vented = host_s
                said.append((host_s, State(S.VENTING, PROGRAM_END, pressure)))
            if time_s >= count / self.rate_hz:
                measured = pressure + rng.uniform(-self.noise_mbar, self.noise_mbar)
                height = DOME_MM * pressure + 1e-7 * count  # never frozen
                said.append((host_s, Sample(count, time_s, measured, height, run.index)))
                count += 1
            step += 1
        said.append((host_s, State(S.LOADED, PROGRAM_DONE, pressure)))
        return [(self._arrives(host_s), event) for host_s, event in said]

    def _arrives(self, host_s: float) -> float:
        for begin_s, length_s in self.stalls:
            if begin_s <= host_s < begin_s + length_s:
                return begin_s + length_s
        return host_s


def command_mbar(segments: Sequence[Segment], time_s: float) -> float:
    """Command at a time, for a program of ramps, holds and rests; 0 before and after it."""
    begin, target = 0.0, 0.0
    if time_s < 0:
        return 0.0
    for segment in segments:
        if segment.kind is SegmentKind.RAMP:
            before, target = target, segment.target_mbar
            lasts = abs(target - before) / segment.rate_mbar_per_s
            if time_s < begin + lasts:
                return before + (target - before) * (time_s - begin) / lasts
        else:
            target = target if segment.kind is SegmentKind.HOLD else 0.0
            lasts = segment.duration_s
            if time_s < begin + lasts:
                return target
        begin += lasts
    return 0.0
