from __future__ import annotations

import random
from itertools import pairwise
from pathlib import Path

import pytest

from drivers.connection import Connection
from drivers.dialects import get_dialect
from drivers.errors import RemoteProtocolError
from drivers.events import (
    Arm,
    Damaged,
    Gap,
    Hello,
    Identify,
    InstrumentFault,
    InstrumentState,
    KeepAlive,
    Load,
    Sample,
    Segment,
    SegmentKind,
    Start,
    State,
    Vent,
)
from sim_device.device import Device
from sim_device.faults import KINDS, RATES, SIZES, Fault, Schedule, load_fault_file
from sim_device.files import SensorSection

QUIET = SensorSection(
    noise_um=0, resolution_um=0, pressure_noise_mbar=0, pressure_resolution_mbar=0
)
RAMP = Segment(SegmentKind.RAMP, target_mbar=100, rate_mbar_per_s=50)
LOAD = Load((RAMP, Segment(SegmentKind.HOLD, duration_s=2)), 100, 100, 5)


class PowerSkin:
    def prepare(self, aperture_mm, load):
        pass

    def start(self):
        pass

    def deflection_mm(self, *arguments):
        return 0.05 * arguments[-1] ** 0.7


class Bench:
    """A faulty device and a host that does not mind."""

    def __init__(self, *faults, sensor=QUIET, seed=0, **options):
        self.device = Device(PowerSkin(), sensor, seed=seed, faults=faults, **options)
        self.dialect = get_dialect("reference")
        self.connection = Connection(self.dialect)
        self.raw = b""
        self.number = 0

    def tell(self, *commands):
        for command in commands:
            self.device.receive(self.dialect.encode_command(command, self.number))
            self.number += 1
        return self.hear()

    def hear(self):
        data = self.device.transmit()
        self.raw += data
        self.connection.receive_data(data)
        events = []
        while True:
            try:
                event = self.connection.next_event()
            except RemoteProtocolError as error:
                events.append(error)
                continue
            if event is None:
                return events
            events.append(event)

    def wait(self, seconds, step=0.05):
        events = []
        for _ in range(round(seconds / step)):
            self.device.process(step)
            events += self.tell(KeepAlive())
        return events

    def run(self, seconds=4.5, load=LOAD):
        return self.tell(Identify(), load, Arm(), Start()) + self.wait(seconds)


def of(events, kind):
    return [event for event in events if isinstance(event, kind)]


def whole(events):
    samples = of(events, Sample)
    return [s.sequence for s in samples] == list(range(len(samples))) and len(samples) > 400


# ---- the file ----------------------------------------------------------------------------------


def test_every_kind_can_be_written_with_its_numbers(tmp_path):
    text = ""
    for kind in KINDS:
        text += f'[[fault]]\nkind = "{kind}"\nat_s = 2\nfor_s = 1.5\n'
        for name, table in (("rate", RATES), ("size", SIZES)):
            if kind in table:
                text += f"{name} = {table[kind].default}\n"
    path = tmp_path / "FAULTS.toml"
    path.write_text(text)
    faults = load_fault_file(path)
    assert [fault.kind for fault in faults] == list(KINDS)
    assert all((fault.at_s, fault.for_s) == (2.0, 1.5) for fault in faults)
    assert [f.amount for f in faults if f.kind in SIZES] == [SIZES[k].default for k in SIZES]


def test_a_kind_alone_is_enough(tmp_path):
    path = tmp_path / "FAULTS.toml"
    path.write_text('[[fault]]\nkind = "leak"\n')
    assert load_fault_file(path) == (Fault("leak"),)
    path.write_text("")
    assert load_fault_file(path) == ()


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("[[fault]]\nat_s = 1", r"fault\[0\].*kind"),
        ("[[fault]]\nkind = 'gremlin'", r"fault\[0\].*'gremlin'.*stuck_valve"),
        ("[[fault]]\nkind = 'leak'\n[[fault]]\nkind = 'leak'\nsice = 1", r"fault\[1\].*sice"),
        ("[[fault]]\nkind = 'leak'\nat_s = -1", r"fault\[0\].at_s"),
        ("[[fault]]\nkind = 'leak'\nat_s = 'now'", r"fault\[0\].at_s"),
        ("[[fault]]\nkind = 'leak'\nat_s = nan", "at_s"),
        ("[[fault]]\nkind = 'leak'\nfor_s = 0", r"fault\[0\].for_s"),
        ("[[fault]]\nkind = 'leak'\nfor_s = inf", "for_s"),
        ("[[fault]]\nkind = 'leak'\nsize = 1.1", "size of leak.*0 to 1"),
        ("[[fault]]\nkind = 'leak'\nrate = 1", "leak has no rate"),
        ("[[fault]]\nkind = 'unplug'\nsize = 1", "unplug has no size"),
        ("[[fault]]\nkind = 'bit_flip'\nrate = 2", "rate of bit_flip"),
        ("[[fault]]\nkind = 'garbage'\nsize = 1.5", "whole number"),
        ("[[fault]]\nkind = 'overshoot'\nsize = nan", "size of overshoot"),
        ("[fault]\nkind = 'leak'", "fault"),
        ("[[faults]]\nkind = 'leak'", "faults"),
        ("[[fault]\n", "line 1"),
    ],
)
def test_bad_files(tmp_path, text, match):
    path = tmp_path / "FAULTS.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=match) as caught:
        load_fault_file(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_when_faults_are_active():
    schedule = Schedule([Fault("leak", 1, 2), Fault("leak", 5, size=0.5), Fault("unplug", 1)])
    active = [schedule.active("leak", round(t * 1e6)) for t in (0.9, 1, 2.9, 3, 5, 1e6)]
    assert [a and a.amount for a in active] == [None, 0.3, 0.3, None, 0.5, 0.5]
    assert not schedule.changes_after(2_000_000, ["unplug"])
    assert schedule.changes_after(2_000_000, ["leak"])


@pytest.mark.parametrize(
    ("faults", "out"),
    [
        ([Fault("unplug", 2)], (2, 100)),
        ([Fault("unplug", 2, 1)], (2, 3)),
        ([Fault("unplug", 2), Fault("replug", 4)], (2, 4)),
        ([Fault("unplug", 2, 5), Fault("replug", 4)], (2, 4)),
        ([Fault("replug", 4)], (4, 4.1)),
        ([Fault("replug", 4, 1)], (4, 5)),
    ],
)
def test_unplug_and_replug(faults, out):
    schedule = Schedule(faults)
    for t in (k / 100 for k in range(1000)):
        unplugged = schedule.active("unplug", round(t * 1e6)) is not None
        assert unplugged == (out[0] <= t < out[1]), t


# ---- the line ----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["bit_flip", "drop_bytes", "duplicate_bytes"])
def test_damaged_bytes_cost_frames_and_nothing_else(kind):
    good = Bench().run()
    assert whole(good)
    events = Bench(Fault(kind, 1, 2, rate=0.002)).run()
    assert of(events, Damaged)
    samples = of(events, Sample)
    assert not whole(events)
    by_sequence = {s.sequence: s for s in of(good, Sample)}
    assert all(by_sequence[s.sequence] == s for s in samples)  # a CRC of 16 bits, and few frames
    lost = {s for s in by_sequence if not any(s == got.sequence for got in samples)}
    assert lost
    assert all(1 <= by_sequence[s].device_time_s <= 3 for s in lost)
    assert sum(gap.received - gap.expected for gap in of(events, Gap)) == len(lost)


def test_garbage_between_frames_costs_little():
    events = Bench(Fault("garbage", 1, 2, rate=20, size=30)).run()
    assert of(events, Damaged)
    assert len(of(events, Sample)) > 350
    assert not of(events, RemoteProtocolError)


def test_a_stall_holds_everything_back_and_loses_nothing():
    bench = Bench(Fault("stall", 1, 1))
    bench.tell(Identify(), LOAD, Arm(), Start())
    bench.wait(1)
    assert bench.wait(0.9) == []
    burst = bench.wait(0.2)
    assert 100 <= len(of(burst, Sample)) <= 115
    assert whole(Bench(Fault("stall", 1, 1)).run())


def test_late_samples_are_late_and_in_order():
    bench = Bench(Fault("late_samples", 1, 1, size=0.3))
    arrived = [(0.0, s) for s in of(bench.tell(Identify(), LOAD, Arm(), Start()), Sample)]
    for k in range(1, 91):
        arrived += [(k * 0.05, s) for s in of(bench.wait(0.05), Sample)]
    lags = {s.sequence: t - s.device_time_s for t, s in arrived}
    assert max(lag for n, lag in lags.items() if n < 100) <= 0.0501
    assert all(0.29 <= lags[n] <= 0.351 for n in range(100, 200))
    assert list(lags) == list(range(len(lags)))


def test_unplugged_nothing_gets_through_and_the_instrument_vents_by_itself():
    trace = []
    bench = Bench(Fault("unplug", 1, 2), trace=lambda *row: trace.append(row))
    bench.run(1.05)
    assert not bench.device.plugged
    assert bench.wait(1.9) == []
    assert bench.device.pressure_mbar < 0.1
    assert bench.device.state is InstrumentState.IDLE
    venting = next(t for t, _, state in trace if state is InstrumentState.VENTING)
    assert venting == pytest.approx(1.5, abs=0.06)
    assert next(t for t, p, _ in trace if t > venting and p < 5) < venting + 0.25
    assert not bench.device.resting  # its plug is about to come back
    bench.wait(0.1)
    assert bench.device.plugged
    assert isinstance(bench.tell(Identify())[0], Hello)
    assert bench.device.resting


def test_commands_are_damaged_too():
    bench = Bench(Fault("drop_bytes", 0, rate=1.0))
    assert bench.tell(Identify()) == []
    assert bench.device.resting


# ---- the instrument ----------------------------------------------------------------------------


def test_a_counter_that_jumps():
    events = Bench(Fault("counter_jump", 1, size=7)).run()
    assert of(events, Gap) == [Gap(100, 107)]
    back = Bench(Fault("counter_jump", 1, 0.5, size=-7)).run()
    (gap,) = of(back, Gap)  # numbers that came already are dropped, and then some are missing
    assert gap.expected == 143
    assert gap.received == 150


def test_a_stuck_valve_leaves_the_vacuum_and_the_firmware_says_so():
    bench = Bench(Fault("stuck_valve", 1, 5))
    bench.run(2)
    events = bench.tell(Vent()) + bench.wait(2)
    assert [f.code for f in of(events, InstrumentFault)] == ["vent"]
    assert bench.device.pressure_mbar == pytest.approx(100, abs=5)
    bench.wait(2.5)
    assert bench.device.pressure_mbar < 1
    half = Bench(Fault("stuck_valve", 1, size=0.5))
    half.run(2)
    half.tell(Vent())
    half.wait(0.2)
    assert half.device.pressure_mbar == pytest.approx(100 * 2.718 ** (-0.1 / 0.05), rel=0.1)


def test_lifting_the_probe_helps_a_stuck_valve():
    bench = Bench(Fault("stuck_valve", 1), Fault("no_contact", 3.5))
    bench.run(2)
    bench.tell(Vent())
    bench.wait(1)
    assert bench.device.pressure_mbar > 90
    bench.wait(1)
    assert bench.device.pressure_mbar < 1


def test_leak_overshoot_and_no_contact():
    assert Bench(Fault("leak", 1, size=0.4)).run(3.5)[-1].pressure_mbar == pytest.approx(60, abs=1)
    off = Bench(Fault("no_contact", 0)).run(3.5)[-1]
    assert off.pressure_mbar == pytest.approx(5, abs=0.5)
    assert off.deflection_mm == 0
    over = Bench(Fault("overshoot", 1, size=30)).run(1.5)
    assert over[-1].pressure_mbar > 1.05 * 50 + 20
    fault = of(Bench(Fault("overshoot", 1, size=30)).run(3.5), InstrumentFault)
    assert [f.code for f in fault] == ["pressure"]


def test_frozen_and_drifting_sensors():
    frozen = of(Bench(Fault("frozen_sensor", 1, 1), sensor=SensorSection()).run(), Sample)
    assert len({s.deflection_mm for s in frozen if 1 <= s.device_time_s < 2}) == 1
    assert len({s.deflection_mm for s in frozen if s.device_time_s >= 2}) > 20
    drifted = of(Bench(Fault("drifting_sensor", 1, rate=100)).run(), Sample)
    true = of(Bench().run(), Sample)
    for a, b in zip(drifted, true, strict=True):
        late = max(0.0, b.device_time_s - 1)
        assert a.deflection_mm - b.deflection_mm == pytest.approx(0.1 * late, abs=1e-6)


def test_another_firmware():
    error, hello, _, state = Bench(Fault("wrong_firmware")).tell(Identify())
    assert hello.firmware == "2.0"
    assert isinstance(error, RemoteProtocolError)
    assert isinstance(state, State)
    assert Bench().tell(Identify())[0].firmware == "1.0"


# ---- time, randomness ---------------------------------------------------------------------------

ALL = (
    Fault("bit_flip", 0.5, 3, rate=0.002),
    Fault("drop_bytes", 0.7, rate=0.001),
    Fault("duplicate_bytes", 0.9, rate=0.001, size=5),
    Fault("garbage", 1, rate=10),
    Fault("stall", 1.5, 0.2),
    Fault("late_samples", 2, 0.5),
    Fault("counter_jump", 2.2),
    Fault("leak", 2.5, 0.5),
    Fault("drifting_sensor", 2.5),
)


def test_the_same_bits_whatever_the_steps():
    raw = []
    rng = random.Random(3)
    for longest_us in (4_500_000, 50_000, 7_777):
        bench = Bench(*ALL, sensor=SensorSection(), keep_alive_s=100)
        bench.tell(Identify(), LOAD, Arm(), Start())
        left = 4_500_000
        while left:
            step = min(left, longest_us if longest_us != 7_777 else rng.randrange(1, longest_us))
            bench.device.process(step / 1e6)
            left -= step
        bench.hear()
        raw.append(bench.raw)
    assert len(set(raw)) == 1
    other = Bench(*ALL, sensor=SensorSection(), keep_alive_s=100, seed=1)
    other.tell(Identify(), LOAD, Arm(), Start())
    other.device.process(4.5)
    other.hear()
    assert other.raw != raw[0]


def test_faults_do_not_change_what_is_right():
    """The noise of the sensor is the same with and without faults on the line."""
    good = {s.sequence: s for s in of(Bench(sensor=SensorSection()).run(), Sample)}
    bad = of(Bench(Fault("bit_flip", rate=0.001), sensor=SensorSection()).run(), Sample)
    assert len(bad) > 100
    assert all(good[s.sequence] == s for s in bad)


def test_the_clock_of_the_faults_waits_for_the_first_start():
    bench = Bench(Fault("unplug", 1, 1))
    bench.device.process(100)
    assert bench.device.plugged
    bench.run(1.05)
    assert not bench.device.plugged


# ---- what the pump does -------------------------------------------------------------------------

MODES = {
    "mode1": ((100, 1e5), "hold", "release", "rest"),
    "mode2": ((100, 50), (0, 50)),
    "mode3": ((100, 1e5), "hold", (0, 50)),
    "mode4": ((100, 50), "release", "rest"),
}


@pytest.mark.parametrize("rate_hz", [10, 100, 1000])
@pytest.mark.parametrize("mode", MODES)
def test_the_classic_modes_three_times(mode, rate_hz):
    kinds = {
        "hold": Segment(SegmentKind.HOLD, duration_s=1),
        "release": Segment(SegmentKind.RELEASE),
        "rest": Segment(SegmentKind.REST, duration_s=1),
    }
    pulse = [
        kinds[part]
        if isinstance(part, str)
        else Segment(SegmentKind.RAMP, target_mbar=part[0], rate_mbar_per_s=part[1])
        for part in MODES[mode]
    ]
    bench = Bench()
    events = bench.run(16, Load(tuple(pulse * 3), rate_hz, 100, 20))
    samples = of(events, Sample)
    assert [s.sequence for s in samples] == list(range(len(samples)))
    assert [s.device_time_s for s in samples] == [k / rate_hz for k in range(len(samples))]
    assert of(events, State)[-1].reason == "done"
    assert {s.segment for s in samples} <= set(range(3 * len(pulse) + 1))
    peaks = [
        max(s.pressure_mbar for s in samples if s.segment // len(pulse) == k) for k in range(3)
    ]
    assert peaks == pytest.approx([100] * 3, abs=6)  # at 10 Hz the very tip may fall between two
    high = [s.pressure_mbar > 50 for s in samples]
    assert sum(b and not a for a, b in pairwise(high)) == 3
    if rate_hz == 1000:
        up = next(s.device_time_s for s in samples if s.pressure_mbar > 90)
        steep = isinstance(MODES[mode][0], tuple) and MODES[mode][0][1] == 1e5
        assert up == pytest.approx(0.064 if steep else 1.82, abs=0.03)


def test_the_table_in_the_documentation_is_the_codes():
    text = (Path(__file__).parents[3] / "docs" / "simulator.md").read_text(encoding="utf-8")
    rows = [[c.strip() for c in line.split("|")[1:-1]] for line in text.splitlines() if "|" in line]
    documented = {row[0].strip("`"): row[2:] for row in rows if row[0].strip("`") in KINDS}
    for kind in KINDS:
        for table, cell in zip((RATES, SIZES), documented[kind], strict=True):
            amount = table.get(kind)
            assert cell == (
                "–"
                if amount is None
                else f"{amount.meaning}: {amount.default:g} ({amount.low:g} to {amount.high:g})"
            )
