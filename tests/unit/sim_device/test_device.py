from __future__ import annotations

import dataclasses
import random
import threading
from itertools import pairwise

import pytest

from drivers.events import (
    Abilities,
    Arm,
    Hello,
    Identify,
    InstrumentFault,
    InstrumentState,
    KeepAlive,
    Load,
    Loaded,
    Refused,
    Reset,
    Sample,
    Segment,
    SegmentKind,
    Start,
    State,
    Vent,
)
from sim_device.files import SensorSection

S = InstrumentState
K = SegmentKind
QUIET = SensorSection(
    noise_um=0, resolution_um=0, pressure_noise_mbar=0, pressure_resolution_mbar=0
)


def ramp(target, rate):
    return Segment(K.RAMP, target_mbar=target, rate_mbar_per_s=rate)


def hold(seconds):
    return Segment(K.HOLD, duration_s=seconds)


RELEASE = Segment(K.RELEASE)
PROGRAM = (ramp(100, 50), hold(1), RELEASE, Segment(K.REST, duration_s=0.5), ramp(30, 1e5), hold(1))
LOAD = Load(PROGRAM, 100, 100, 5)


def samples(events):
    return [event for event in events if isinstance(event, Sample)]


def states(events):
    return [(event.state, event.reason) for event in events if isinstance(event, State)]


def test_a_run(make_bench):
    bench = make_bench(sensor=QUIET)
    hello, abilities, state = bench.tell(Identify())
    assert abilities == Abilities(until=True)
    assert isinstance(hello, Hello)
    assert (state.state, state.pressure_mbar) == (S.IDLE, 0.0)
    events = bench.run(LOAD)
    assert events[0] == Loaded(PROGRAM, 100, 100, 5)
    assert [s for s, _ in states(events)] == [S.LOADED, S.ARMED, S.RUNNING]
    events += bench.wait(6)
    assert states(events)[3:] == [(S.VENTING, "program end"), (S.LOADED, "done")]
    got = samples(events)
    assert [s.sequence for s in got] == list(range(len(got)))
    assert [s.device_time_s for s in got] == [k / 100 for k in range(len(got))]
    assert [s.segment for s in got] == sorted(s.segment for s in got)
    assert {s.segment for s in got} == {0, 1, 2, 3, 5, 6}  # the step is over within a sample
    by_time = {s.device_time_s: s for s in got}
    assert by_time[1.0].pressure_mbar == pytest.approx(50, abs=1.1)  # 20 ms behind
    assert by_time[2.9].pressure_mbar == pytest.approx(100, abs=0.01)
    assert by_time[2.9].deflection_mm == pytest.approx(0.05 * 100**0.7, abs=1e-4)
    assert by_time[4.6].pressure_mbar == pytest.approx(30, abs=0.1)
    falling = [s for s in got if s.segment == 2]
    assert falling[-1].device_time_s - falling[0].device_time_s < 0.25
    assert got[-1].pressure_mbar < 3
    again = bench.tell(Arm(), Start()) + bench.wait(6)
    assert len(samples(again)) == len(got)
    assert states(again)[-1] == (S.LOADED, "done")


def test_the_step_up_is_bounded_by_the_pump(make_bench):
    bench = make_bench(sensor=QUIET)
    events = bench.run(Load((ramp(500, 1e5), hold(1)), 1000, 500, 2)) + bench.wait(1)
    pressure = [s.pressure_mbar for s in samples(events)]
    steps = [b - a for a, b in pairwise(pressure)]
    assert max(steps) == pytest.approx(3.0, abs=0.01)
    assert max(pressure) <= 500


@pytest.mark.parametrize("rate", [20, 30, 333.3, pytest.param(1000, marks=pytest.mark.long)])
def test_the_same_bits_whatever_the_steps(make_bench, rate):
    load = dataclasses.replace(LOAD, rate_hz=rate)
    rng = random.Random(1)
    raw = []
    for longest_us in (6_000_000, 100_000, 1_000, 7_777):
        bench = make_bench(seed=5, keep_alive_s=100)
        bench.run(load)
        left = 6_000_000
        while left:
            step = min(left, longest_us if longest_us != 7_777 else rng.randrange(1, longest_us))
            bench.device.process(step / 1e6)
            left -= step
        bench.hear()
        raw.append(bench.raw)
    assert len(set(raw)) == 1
    other = make_bench(seed=6, keep_alive_s=100)
    other.run(load)
    other.device.process(6)
    other.hear()
    assert other.raw != raw[0]


def test_noise_and_resolution(make_bench):
    sensor = SensorSection(noise_um=5, resolution_um=2, pressure_noise_mbar=0.5)
    bench = make_bench(sensor=sensor)
    got = samples(bench.run(Load((ramp(50, 1e5), hold(5)), 1000, 50, 6)) + bench.wait(5))
    got = [s for s in got if s.segment == 1 and s.device_time_s > 0.5]
    mean = sum(s.deflection_mm for s in got) / len(got)
    deviation = (sum((s.deflection_mm - mean) ** 2 for s in got) / len(got)) ** 0.5
    assert mean == pytest.approx(0.05 * 50**0.7, abs=5e-4)
    assert deviation == pytest.approx(5e-3, rel=0.1)
    assert all(round(1e6 * s.deflection_mm) % 2000 == 0 for s in got)
    assert all(round(1e3 * s.pressure_mbar) % 100 == 0 for s in got)


class SlowSkin:
    """Gets ready once it is told to."""

    def __init__(self):
        self.begun, self.go = threading.Event(), threading.Event()

    def prepare(self, aperture_mm, load):
        self.begun.set()
        assert self.go.wait(60)

    def start(self):
        pass

    def deflection_mm(self, time_s, pressure_mbar):
        return 0.0


def test_a_skin_that_takes_long_does_not_make_the_firmware_deaf(make_bench):
    skin = SlowSkin()
    bench = make_bench(skin=skin, beside=True)
    assert not bench.tell(LOAD)
    assert skin.begun.wait(60)
    assert states(bench.wait(0.5)) == []
    assert states(bench.tell(Vent()) + bench.wait(0.1)) == [(S.VENTING, "host"), (S.IDLE, "vented")]
    skin.go.set()  # for a load that was given up with the vent
    assert not bench.wait(0.5)
    bench.tell(LOAD)
    events = []
    while not events:
        events = bench.wait(0.1)
    assert isinstance(events[0], Loaded)
    assert states(events) == [(S.LOADED, "loaded")]


def test_keep_alive(make_bench):
    bench = make_bench()
    events = bench.run(LOAD) + bench.wait(1.0)
    bench.device.process(0.5)
    assert bench.device.state is S.RUNNING
    bench.device.process(0.002)
    assert bench.device.state is S.VENTING
    bench.device.process(0.5)
    assert bench.device.pressure_mbar < 0.1
    events = bench.hear()
    assert states(events) == [(S.VENTING, "keep-alive lost"), (S.IDLE, "vented")]
    assert samples(events)[-1].segment == len(PROGRAM)


def test_keep_alive_counts_from_arm(make_bench):
    bench = make_bench()
    bench.tell(LOAD, Arm())
    bench.device.process(0.6)
    assert bench.device.state is S.IDLE


def test_vent_from_full_suction(make_bench):
    bench = make_bench()
    bench.run(Load((ramp(500, 1000), hold(5)), 100, 500, 10))
    bench.wait(2)
    assert bench.device.pressure_mbar > 499
    assert states(bench.tell(Vent())) == [(S.VENTING, "host")]
    events = bench.wait(0.3)
    assert bench.device.pressure_mbar < 2
    assert states(events) == [(S.LOADED, "vented")]
    assert bench.device.resting or bench.wait(2) == []


@pytest.mark.parametrize("prepare", [(), (LOAD,), (LOAD, Arm())])
def test_vent_is_answered_in_every_state(make_bench, prepare):
    bench = make_bench()
    bench.tell(*prepare)
    events = bench.tell(Vent()) + bench.wait(0.1)
    assert states(events) == [(S.VENTING, "host"), (S.LOADED if prepare else S.IDLE, "vented")]


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"max_pressure_mbar": 500.001}, "above 500"),
        ({"max_suction_s": 60.1}, "above 60"),
        ({"max_pressure_mbar": 99.9}, "goes to 100"),
        ({"max_suction_s": 2.9}, "pulls for 3 s"),
        ({"rate_hz": 0.5}, "0.5 Hz"),
        ({"rate_hz": 1001}, "1001 Hz"),
        ({"segments": (ramp(10, 0),)}, "inf"),
    ],
)
def test_the_firmware_refuses_by_itself(make_bench, change, match):
    bench = make_bench()
    [refused] = bench.tell(dataclasses.replace(LOAD, **change))
    assert isinstance(refused, Refused)
    assert match in refused.reason
    assert bench.device.state is S.IDLE


def test_commands_out_of_turn_are_refused(make_bench):
    bench = make_bench()
    assert [type(e) for e in bench.tell(Arm(), Start(), KeepAlive())] == [Refused, Refused]
    bench.run(LOAD)
    assert [type(e) for e in bench.tell(LOAD, Arm(), Start(), Reset())] == [Refused] * 4
    assert bench.device.state is S.RUNNING


def test_over_pressure_is_a_fault_until_reset(make_bench):
    bench = make_bench()
    bench.run(LOAD)
    bench.device.plant.pressure_mbar = 120.0
    events = bench.wait(0.1)
    assert any(isinstance(e, InstrumentFault) and e.code == "pressure" for e in events)
    assert bench.device.state is S.FAULT
    assert [type(e) for e in bench.tell(Arm())] == [Refused]
    assert states(bench.wait(0.5)) == [(S.FAULT, "vented")]
    assert states(bench.tell(Vent())) == [(S.FAULT, "host")]
    assert states(bench.tell(Reset())) == [(S.IDLE, "reset")]


@pytest.mark.parametrize("program", [(ramp(50, 100), hold(0.2)), (ramp(50, 100), RELEASE, hold(2))])
def test_a_valve_that_sticks_is_a_fault(make_bench, program):
    bench = make_bench()
    bench.run(Load(program, 100, 50, 5))
    bench.wait(0.5)
    events = []
    for _ in range(150):
        bench.device.plant.pressure_mbar = 45.0
        events += bench.wait(0.01, 0.01)
    assert [e.code for e in events if isinstance(e, InstrumentFault)] == ["vent"]


def test_suction_time_is_counted_by_the_firmware(make_bench):
    bench = make_bench()
    bench.run(Load((ramp(50, 100), hold(5)), 100, 50, 5.5))
    bench.device.run.load = Load((ramp(50, 100), hold(50)), 100, 50, 5.5)  # as if memory failed
    events = bench.wait(6)
    assert [e.code for e in events if isinstance(e, InstrumentFault)] == ["suction"]


def test_a_skin_that_cannot_be_computed(make_bench):
    class Broken:
        def prepare(self, aperture_mm, load):
            if load.max_pressure_mbar > 50:
                raise RuntimeError("no convergence, at 60 mbar")

        def start(self):
            pass

        def deflection_mm(self, time_s, pressure_mbar):
            if pressure_mbar > 20:
                return float("nan")
            return 0.0

    bench = make_bench(skin=Broken())
    assert bench.tell(LOAD) == [Refused("Load", "no convergence, at 60 mbar")]
    bench.run(Load((ramp(50, 50),), 100, 50, 5))
    events = bench.wait(1)
    assert [e.code for e in events if isinstance(e, InstrumentFault)] == ["skin"]
    assert bench.device.pressure_mbar < 1


def test_a_repeated_number_is_answered_and_not_done_again(make_bench):
    bench = make_bench()
    for command, number in ((LOAD, 7), (Arm(), 8), (Start(), 9)):
        frame = bench.dialect.encode_command(command, number)
        bench.device.receive(frame * 2)
        assert [reason for _, reason in states(bench.hear())][-1] == "repeated"
    events = bench.wait(6)
    bench.device.receive(frame)
    assert states(bench.hear()) == [(S.LOADED, "repeated")]
    assert samples(events)[0].sequence == 1


def test_damaged_commands_are_dropped(make_bench):
    bench = make_bench()
    frame = bench.dialect.encode_command(Identify(), 0)
    for position in range(len(frame)):
        bench.device.receive(frame[:position] + b"\x07" + frame[position + 1 :])
    bench.device.receive(bytes(range(256)) * 40)
    assert bench.hear() == []
    assert len(bench.tell(Identify())) == 3


def test_rest_costs_nothing(make_bench):
    bench = make_bench()
    bench.device.process(1e6)
    assert bench.device.resting
    assert bench.hear() == []
