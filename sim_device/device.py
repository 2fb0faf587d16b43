"""The simulated probe: an instrument that moves only by `process(dt_s)`. Bytes in, bytes out.

Its firmware keeps its own limits and vents by itself; it shares the grammar of the wire with the
host, and nothing else.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Protocol

import numpy as np

from drivers.dialect import Dialect
from drivers.dialects import get_dialect
from drivers.errors import RemoteProtocolError
from drivers.events import (
    PROGRAM_DONE,
    PROGRAM_END,
    Abilities,
    Arm,
    Command,
    Damaged,
    Hello,
    Identify,
    InstrumentEvent,
    InstrumentFault,
    InstrumentState,
    KeepAlive,
    Load,
    Loaded,
    Pace,
    Refused,
    Reset,
    Sample,
    SegmentKind,
    Start,
    State,
    Vent,
)
from sim_device.faults import Fault, Schedule
from sim_device.files import TRUTHFUL, ProbeSection, SensorSection
from sim_device.line import Line
from sim_device.plant import Plant
from sim_device.program import Run, needs
from sim_device.timing import TIMING

STEP_US = 1_000  # everything moves on this grid, so that the sizes of dt_s change nothing
MAX_PRESSURE_MBAR = 500.0
MAX_SUCTION_S = 60.0
MIN_RATE_HZ = 1.0
MAX_RATE_HZ = 1000.0
VENTED_MBAR = 2.0  # samples and the state VENTING end below this
SAFE_MBAR = 5.0  # a fault can be reset, and a release has worked, below this ...
VENT_TIME_S = 1.0  # ... within this
_TEXT_CHARACTERS = 80  # of a reason; escaped, three bytes each at worst, that fits the wire
_SLACK_S = 1e-5
_SUCTION_SLACK_US = 5 * STEP_US  # segments end between two steps
_LONGEST_MM = 1000.0
_TRACE_US = 10_000  # between two rows of a trace
_OTHER_FIRMWARE = "2.0"

_S = InstrumentState
_LIVE = frozenset({_S.ARMED, _S.RUNNING})


Trace = Callable[[float, float, InstrumentState], None]


class Skin(Protocol):
    """What is under the probe."""

    def prepare(self, aperture_mm: float, load: Load) -> None:
        """Get ready for this program, to be run any number of times; its error refuses Load."""

    def start(self) -> None:
        """Begin another loading of this site: the prepared program runs from time zero."""

    def deflection_mm(self, time_s: float, pressure_mbar: float) -> float:
        """Height of the dome's apex at this suction, `time_s` after the last start."""


class _Loading:
    """A skin that gets ready for a program in a thread: no firmware is deaf while it loads."""

    def __init__(self, prepare: Callable[[], str | None], load: Load, number: int | None) -> None:
        self.load, self.number = load, number
        self.problem: str | None = None
        self._prepare = prepare
        self._thread = threading.Thread(target=self._run, name="skin", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        self.problem = self._prepare()

    @property
    def over(self) -> bool:
        return not self._thread.is_alive()


class Device:
    """A probe with its firmware, on a skin.

    seed: of all noise; the same seed and the same conversation give the same bytes.
    speed: how many of its seconds whoever calls `process` lets pass in one of the host's. The host
    is told, and the 500 ms without keep-alive after which it vents are the host's.
    faults: what goes wrong, and when; see `sim_device.faults`.
    probe: what this one probe makes of the truth.
    stops_at_heights: whether it can end a segment where a height is reached.
    beside: the skin gets ready in a thread, while the firmware goes on; else within `receive`.
    trace: is told the time (s), the true pressure (mbar) and the state, every 10 ms of movement.
    """

    def __init__(
        self,
        skin: Skin,
        sensor: SensorSection,
        *,
        aperture_mm: float = 6.0,
        seed: int = 0,
        speed: float = 1.0,
        keep_alive_s: float | None = None,
        dialect: Dialect | None = None,
        faults: Iterable[Fault] = (),
        probe: ProbeSection = TRUTHFUL,
        stops_at_heights: bool = True,
        beside: bool = False,
        trace: Trace | None = None,
    ) -> None:
        self._skin = skin
        self._beside = beside
        self._loading: _Loading | None = None
        self._one_skin = threading.Lock()  # a load that was given up may still be under way
        self._sensor = sensor
        self._probe = probe
        self._stops_at_heights = stops_at_heights
        self._past_mbar = deque([0.0], maxlen=1 + round(probe.lag_s * 1e6) // STEP_US)
        self._aperture_mm = aperture_mm
        self._rng = np.random.default_rng(seed)
        self._speed = speed
        if keep_alive_s is None:
            keep_alive_s = TIMING.keep_alive_s
        self._keep_alive_us = round(keep_alive_s * speed * 1e6)
        self.dialect = get_dialect("reference") if dialect is None else dialect
        self.plant = Plant(STEP_US / 1e6)
        self._schedule = Schedule(faults)
        self._line = Line(self._schedule, seed)
        self._trace = trace
        self._in = bytearray()
        self._now_us = 0
        self._first_start_us: int | None = None
        self._frozen_mm: float | None = None
        self._owed_ns = 0  # time that process() was given and that is less than a step
        self._state = _S.IDLE
        self._load: Load | None = None
        self.run: Run | None = None
        self._number: int | None = None  # of the last command that changed something
        self._alive_us = 0
        self._vent_us: int | None = None  # the valve is open since then and the chamber not empty
        self._vent_reason = ""
        self._suction_us = 0  # without a pause, so far
        self.sequence = 0
        self._due_us = 0  # of the next sample, since Start
        self._started_us = 0

    @property
    def state(self) -> InstrumentState:
        """What the firmware is doing."""
        return self._state

    @property
    def pressure_mbar(self) -> float:
        """True pressure of the chamber."""
        return self.plant.pressure_mbar

    @property
    def resting(self) -> bool:
        """Nothing moves: time alone changes nothing, and no bytes will come."""
        still = self._state not in _LIVE and self._vent_us is None and not self.plant.pressure_mbar
        ticking = self._first_start_us is not None
        return (
            still and self._loading is None and not self._line.busy(self._fault_us, ticking=ticking)
        )

    @property
    def plugged(self) -> bool:
        """Whether a host can reach it."""
        return self._line.plugged(self._fault_us)

    @property
    def _fault_us(self) -> int:
        """The clock of the faults."""
        return 0 if self._first_start_us is None else self._now_us - self._first_start_us

    # ---- the three methods of a device --------------------------------------------------------

    def receive(self, data: bytes) -> None:
        """Take bytes from the host. Damaged ones are dropped: the host repeats what it needs."""
        self._in += self._line.receive(data, self._fault_us)
        while (taken := self.dialect.take(self._in)) is not None:
            if isinstance(taken, Damaged):
                continue
            try:
                command, number = self.dialect.decode_command(taken)
            except RemoteProtocolError:
                continue
            self._obey(command, number)

    def process(self, dt_s: float) -> None:
        """Let `dt_s` seconds of the device's own time pass."""
        loading = self._loading
        if loading is not None and loading.over:
            self._loading = None
            self._loaded(loading.load, loading.number, loading.problem)
        self._owed_ns += round(dt_s * 1e9)
        steps, self._owed_ns = divmod(self._owed_ns, STEP_US * 1000)
        for done in range(steps):
            if self.resting:
                self._now_us += (steps - done) * STEP_US
                return
            self._step()

    def transmit(self) -> bytes:
        """Take the bytes that the device wants to send."""
        return self._line.take()

    # ---- commands -----------------------------------------------------------------------------

    def _obey(self, command: Command, number: int | None) -> None:
        if number is not None and number == self._number:
            self._answer_again(command, number)
            return
        match command:
            case Identify():
                self._number = None
                self._send(self._hello())
                if self._stops_at_heights:
                    self._send(Abilities(until=True))
                if self._speed != 1:
                    self._send(Pace(self._speed))
                self._say("identify")
            case Vent():
                self._vent("host")
            case KeepAlive():
                self._alive_us = self._now_us
            case Load():
                self._take_load(command, number)
            case Arm() | Start() | Reset():
                self._take_move(command, number)

    def _answer_again(self, command: Command, number: int) -> None:
        """Repeat the answer to a command that was done: it was lost, and is all that is missing."""
        if isinstance(command, Load) and self._load is not None:
            self._send(_read_back(self._load), number)
        self._say("repeated")

    def _take_load(self, load: Load, number: int | None) -> None:
        problem = self._problem_with(load)
        if problem is not None or not self._beside:
            self._loaded(load, number, problem or self._prepare(load))
        elif self._loading is None or self._loading.number != number:  # else it comes
            self._load, self._state = None, _S.IDLE
            self._loading = _Loading(lambda: self._prepare(load), load, number)

    def _prepare(self, load: Load) -> str | None:
        """Return why the skin cannot be computed along this program; None: it can."""
        with self._one_skin:
            try:
                self._skin.prepare(self._aperture_mm, load)
            except Exception as error:  # noqa: BLE001 -- a skin that cannot be computed is refused
                return str(error) or type(error).__name__
        return None

    def _loaded(self, load: Load, number: int | None, problem: str | None) -> None:
        if problem is not None:
            self._refuse("Load", number, problem)
            return
        self._number = number
        self._load = load
        self._send(_read_back(load), number)
        self._enter(_S.LOADED, "loaded")

    def _problem_with(self, load: Load) -> str | None:
        highest, suction_s = needs(load.segments)
        if self._state not in {_S.IDLE, _S.LOADED}:
            return f"not while {self._state}"
        until = any(s.kind is SegmentKind.UNTIL for s in load.segments)
        if until and not self._stops_at_heights:
            return "it cannot stop at a height"
        if not MIN_RATE_HZ <= load.rate_hz <= MAX_RATE_HZ:
            return f"rate {load.rate_hz:g} Hz is outside {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz"
        if load.max_pressure_mbar > MAX_PRESSURE_MBAR:
            return f"{load.max_pressure_mbar:g} mbar is above {MAX_PRESSURE_MBAR:g} mbar"
        if load.max_suction_s > MAX_SUCTION_S + _SLACK_S:
            return f"suction of {load.max_suction_s:g} s is above {MAX_SUCTION_S:g} s"
        if highest > load.max_pressure_mbar:
            return f"the program goes to {highest:g} mbar, above {load.max_pressure_mbar:g} mbar"
        if not suction_s <= load.max_suction_s + _SLACK_S:
            return f"the program pulls for {suction_s:g} s, above {load.max_suction_s:g} s"
        return None

    def _take_move(self, command: Arm | Start | Reset, number: int | None) -> None:
        name = type(command).__name__
        legal = {
            Arm: frozenset({_S.LOADED}),
            Start: frozenset({_S.ARMED}),
            Reset: frozenset({_S.FAULT, _S.LOADED, _S.IDLE}),
        }
        if self._state not in legal[type(command)]:
            self._refuse(name, number, f"not while {self._state}")
            return
        if isinstance(command, Reset) and self._pressure() >= SAFE_MBAR:
            self._refuse(name, number, "the chamber is not vented")
            return
        self._number = number
        self._alive_us = self._now_us
        match command:
            case Arm():
                self._enter(_S.ARMED, "armed")
            case Start():
                self._start()
            case Reset():
                self._load = self._loading = None
                self._enter(_S.IDLE, "reset")

    def _refuse(self, name: str, number: int | None, reason: str) -> None:
        self._send(Refused(name, _short(reason)), number)

    def _start(self) -> None:
        assert self._load is not None
        self.run = Run(self._load)
        self.sequence = self._due_us = 0
        self._started_us = self._now_us
        if self._first_start_us is None:
            self._first_start_us = self._now_us
        self.run.advance(0, self._pressure())
        self._suction_us = 0
        self._skin.start()
        self._enter(_S.RUNNING, "started")
        self._sample()

    # ---- one step of time -----------------------------------------------------------------

    def _step(self) -> None:
        self._now_us += STEP_US
        set_point, valve_open = 0.0, True
        if self._state is _S.RUNNING and self.run is not None:
            self.run.advance(self._now_us - self._started_us, self._pressure(), self._height_mm)
            set_point, valve_open = self.run.set_point_mbar, self.run.valve_open
        if self._schedule:
            self._break_plant()
        self.plant.step(self._true_mbar(set_point) if set_point > 0 else 0.0, valve_open)
        self._past_mbar.append(self.plant.pressure_mbar)
        if self._state in _LIVE and self._now_us - self._alive_us > self._keep_alive_us:
            self._load = None
            self._open_valve("keep-alive lost")
        if self._state is _S.RUNNING and self.run is not None:
            self._check_run(self.run)
        else:
            self._check_vent()
        self._sample()
        self._finish_vent()
        if self._schedule:
            self._line.step(self._fault_us, STEP_US)
        if self._trace is not None and self._now_us % _TRACE_US == 0:
            self._trace(self._now_us / 1e6, self.plant.pressure_mbar, self._state)

    def _break_plant(self) -> None:
        time_us = self._fault_us
        valve = self._schedule.active("stuck_valve", time_us)
        leak = self._schedule.active("leak", time_us)
        overshoot = self._schedule.active("overshoot", time_us)
        self.plant.opening = 1.0 if valve is None else valve.amount
        self.plant.lost = 0.0 if leak is None else leak.amount
        self.plant.excess_mbar = 0.0 if overshoot is None else overshoot.amount
        self.plant.lifted = self._schedule.active("no_contact", time_us) is not None

    def _check_run(self, run: Run) -> None:
        pressure, maximum = self._pressure(), run.load.max_pressure_mbar
        if run.valve_open and pressure < SAFE_MBAR:
            self._suction_us = 0
        elif run.set_point_mbar > 0:
            self._suction_us += STEP_US
        if pressure > maximum + max(10.0, 0.05 * maximum):
            self._fault("pressure", f"{pressure:.1f} mbar, above the maximum of {maximum:g} mbar")
        elif run.release_us > VENT_TIME_S * 1e6 and pressure >= SAFE_MBAR:
            self._fault("vent", f"{pressure:.1f} mbar {VENT_TIME_S:g} s after a release")
        elif run.ended:
            self._open_valve(PROGRAM_END)
        elif self._suction_us > run.load.max_suction_s * 1e6 + _SUCTION_SLACK_US:
            self._fault("suction", f"more than {run.load.max_suction_s:g} s without a pause")

    def _check_vent(self) -> None:
        """Take a vent that does not work as a fault; the valve stays open."""
        if self._vent_us is None or self._state is _S.FAULT:
            return
        pressure = self._pressure()
        if self._now_us - self._vent_us > VENT_TIME_S * 1e6 and pressure >= SAFE_MBAR:
            self._fault("vent", f"{pressure:.1f} mbar {VENT_TIME_S:g} s after a vent")

    def _sample(self) -> None:
        run = self.run
        if run is None:
            return
        elapsed_us = self._now_us - self._started_us
        if elapsed_us < self._due_us:
            return
        try:
            felt_s = max(0.0, elapsed_us / 1e6 - self._probe.lag_s)
            deflection = self._skin.deflection_mm(felt_s, self._past_mbar[0])
            if not abs(deflection) < _LONGEST_MM:
                raise ValueError(f"a deflection of {deflection} mm")
        except Exception as error:  # noqa: BLE001 -- a skin that cannot be computed is a fault
            self.run = None
            self._fault("skin", str(error) or type(error).__name__)
            return
        pressure_noise, deflection_noise = self._rng.standard_normal(2)
        sensor = self._sensor
        pressure = self._pressure() + sensor.pressure_noise_mbar * pressure_noise
        true_um = 0.0 if self.plant.lifted else 1e3 * deflection
        read_um = self._probe.deflection_gain * true_um + self._probe.deflection_offset_um
        deflection_um = read_um + sensor.noise_um * deflection_noise
        sample = Sample(
            sequence=self.sequence,
            device_time_s=elapsed_us / 1e6,
            pressure_mbar=_quantised(pressure, sensor.pressure_resolution_mbar),
            deflection_mm=_quantised(deflection_um, sensor.resolution_um) / 1e3,
            segment=run.index if self._state is _S.RUNNING else len(run.load.segments),
        )
        self.sequence += 1
        self._due_us = self.sequence * 10**9 // round(run.load.rate_hz * 1000)
        self._send(self._misread(sample) if self._schedule else sample)

    def _misread(self, sample: Sample) -> Sample:
        """Give the reading of a broken sensor or counter, where one of them is broken."""
        time_us = self._fault_us
        jump = self._schedule.active("counter_jump", time_us)
        if jump is not None:
            sample = replace(sample, sequence=max(0, sample.sequence + int(jump.amount)))
        drift = self._schedule.active("drifting_sensor", time_us)
        if drift is not None:
            drifted_um = drift.often * (time_us / 1e6 - drift.at_s)
            resolution = self._sensor.resolution_um
            sample = replace(
                sample,
                deflection_mm=_quantised(1e3 * sample.deflection_mm + drifted_um, resolution) / 1e3,
            )
        if self._schedule.active("frozen_sensor", time_us) is None:
            self._frozen_mm = None
        elif self._frozen_mm is None:
            self._frozen_mm = sample.deflection_mm
        else:
            sample = replace(sample, deflection_mm=self._frozen_mm)
        return sample

    # ---- valve, faults, states ----------------------------------------------------------------

    def _vent(self, reason: str) -> None:
        self._loading = None
        if self._state is _S.FAULT:
            self._say(reason)  # the valve is open already, and the fault stays
        else:
            self._open_valve(reason)

    def _open_valve(self, reason: str) -> None:
        if self._vent_us is None:
            self._vent_us = self._now_us
            self._vent_reason = reason
        self._enter(_S.VENTING, reason)

    def _finish_vent(self) -> None:
        if self._vent_us is None or self._pressure() >= VENTED_MBAR:
            return
        self._vent_us = None
        self.run = None
        if self._state is _S.FAULT:
            self._say("vented")
        else:
            reason = PROGRAM_DONE if self._vent_reason == PROGRAM_END else "vented"
            self._enter(_S.IDLE if self._load is None else _S.LOADED, reason)

    def _fault(self, code: str, text: str) -> None:
        self._load = None
        if self._vent_us is None:
            self._vent_us = self._now_us
        self._send(InstrumentFault(code, _short(text)))
        self._enter(_S.FAULT, code)

    def _enter(self, state: InstrumentState, reason: str) -> None:
        self._state = state
        self._say(reason)

    def _say(self, reason: str) -> None:
        self._send(State(self._state, reason, self._pressure()))

    def _pressure(self) -> float:
        """Give what the firmware's own pressure sensor reads, in mbar."""
        probe = self._probe
        return probe.pressure_gain * self.plant.pressure_mbar + probe.pressure_offset_mbar

    def _height_mm(self) -> float:
        """Give what the deflection sensor reads, without its noise: firmware averages."""
        elapsed_s = (self._now_us - self._started_us) / 1e6
        felt_s = max(0.0, elapsed_s - self._probe.lag_s)
        if self._frozen_mm is not None:
            return self._frozen_mm
        if self.plant.lifted:
            return 1e-3 * self._probe.deflection_offset_um
        true_mm = self._skin.deflection_mm(felt_s, self._past_mbar[0])
        return self._probe.deflection_gain * true_mm + 1e-3 * self._probe.deflection_offset_um

    def _true_mbar(self, read_mbar: float) -> float:
        """Give the pressure at which the firmware's sensor reads this."""
        probe = self._probe
        return max(0.0, (read_mbar - probe.pressure_offset_mbar) / probe.pressure_gain)

    def _hello(self) -> Hello:
        other = self._schedule.active("wrong_firmware", self._fault_us) is not None
        return Hello(
            dialect=self.dialect.name,
            protocol_version=self.dialect.protocol_version + int(other),
            model="skinlab simulated probe",
            firmware=_OTHER_FIRMWARE if other else "1.0",
            serial_number=self._probe.serial_number,
            aperture_mm=self._aperture_mm,
            max_pressure_mbar=MAX_PRESSURE_MBAR,
            max_suction_s=MAX_SUCTION_S,
            min_rate_hz=MIN_RATE_HZ,
            max_rate_hz=MAX_RATE_HZ,
            simulated=True,
            default_rate_hz=self._sensor.rate_hz,
        )

    def _send(self, event: InstrumentEvent, number: int | None = None) -> None:
        frame = self.dialect.encode_event(event, number)
        self._line.send(frame, self._fault_us, sample=isinstance(event, Sample))


def _read_back(load: Load) -> Loaded:
    return Loaded(load.segments, load.rate_hz, load.max_pressure_mbar, load.max_suction_s)


def _quantised(value: float, resolution: float) -> float:
    return float(round(value / resolution) * resolution if resolution > 0 else value)


def _short(text: str) -> str:
    return text.encode("ascii", "replace").decode("ascii")[:_TEXT_CHARACTERS]
