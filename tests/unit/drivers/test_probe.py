from __future__ import annotations

import dataclasses
import threading
from itertools import pairwise

import pytest

from drivers.connection import Connection
from drivers.dialects.reference import DIALECT
from drivers.engine import Engine, Request
from drivers.errors import (
    InstrumentRefusedError,
    LinkError,
    LocalProtocolError,
    RemoteProtocolError,
)
from drivers.events import (
    Alarm,
    Arm,
    Gap,
    HostVented,
    Identify,
    InstrumentState,
    LinkLost,
    LinkRestored,
    Load,
    Loaded,
    Sample,
    Segment,
    SegmentKind,
    Start,
    State,
    VentConfirmed,
)
from drivers.probe import Probe
from drivers.watchdog import Watchdog
from sim_device.device import Device

RAMP = (
    Segment(SegmentKind.RAMP, target_mbar=40, rate_mbar_per_s=20),
    Segment(SegmentKind.RAMP, target_mbar=0, rate_mbar_per_s=20),
)
HOLD = (
    Segment(SegmentKind.RAMP, target_mbar=50, rate_mbar_per_s=100),
    Segment(SegmentKind.HOLD, duration_s=55),
)


def is_state(state, reason=None):
    return lambda e: (
        isinstance(e, State) and e.state == state and (reason is None or e.reason == reason)
    )


def is_a(kind):
    return lambda e: isinstance(e, kind)


def run(bench, segments=RAMP, rate_hz=20):
    bench.probe.open()
    bench.probe.load(segments, rate_hz)
    bench.probe.arm()
    bench.probe.start()


def samples_then(action, count=10):
    """A hook that acts once so many samples were sent by the device."""

    def hook(link):
        if link.device.sequence >= count:
            action(link)

    return hook


def once_pulling(action):
    """A hook that acts once the device has pulled for a while; its time stands still meanwhile."""

    def act(link):
        link.hook = lambda link: None
        action()

    return samples_then(act, 20)


def test_constructing_is_not_connecting():
    def refuse(url):
        raise AssertionError("opened")

    probe = Probe("nowhere", open_link=refuse)
    assert probe.state is None
    assert not probe.is_open
    probe.vent()
    probe.close()
    with pytest.raises(LinkError):
        probe.reset()


def test_no_such_dialect():
    with pytest.raises(ValueError, match="reference"):
        Probe("nowhere", dialect="klingon")


def test_a_run_and_its_repeat(make_bench):
    bench = make_bench()
    with bench.probe as probe:
        hello = probe.open()
        assert hello.simulated
        assert hello.default_rate_hz == 20
        assert probe.load(RAMP, 20) == Loaded(RAMP, 20, 40, 4)
        assert bench.skin.prepared == [(6.0, 40.0)]
        for _ in range(2):
            probe.arm()
            probe.start()
            bench.seen.clear()
            bench.until(is_state(InstrumentState.LOADED, "done"))
            samples = bench.of(Sample)
            assert [s.sequence for s in samples] == list(range(len(samples)))
            assert 80 <= len(samples) <= 82
            assert max(s.pressure_mbar for s in samples) == pytest.approx(40, abs=1.5)
            assert [s.device_time_s for s in samples] == pytest.approx(
                [k / 20 for k in range(len(samples))]
            )
            assert bench.of(VentConfirmed)
            assert not bench.of(HostVented)
            assert not bench.of(Gap)
    assert bench.link.closed
    assert HostVented("close") in bench.rest()


def test_keep_alive_every_100_ms_and_only_while_needed(make_bench):
    tapped = []
    bench = make_bench(on_bytes=lambda way, now, data: tapped.append((way, now, data)))
    run(bench)
    bench.until(is_state(InstrumentState.LOADED, "done"))
    times = [now for way, now, data in tapped if way == "tx" and data.startswith(b"$KEEP")]
    steps = [b - a for a, b in pairwise(times)]
    assert max(steps) < 0.115
    assert sum(steps) / len(steps) == pytest.approx(0.1, rel=0.02)
    sent = [data[:4] for data in bench.link.written]
    assert sent.index(b"$KEE") > sent.index(b"$ARM")
    assert b"".join(data for way, _, data in tapped if way == "tx") == b"".join(bench.link.written)


def test_operator_vents_and_the_pressure_is_seen_to_fall(make_bench):
    bench = make_bench()
    bench.link.hook = once_pulling(bench.probe.vent)
    run(bench, HOLD)
    bench.until(lambda e: isinstance(e, Sample) and e.pressure_mbar > 45)
    bench.until(is_a(HostVented))
    assert bench.of(HostVented) == [HostVented("operator")]
    confirmed = bench.until(is_a(VentConfirmed))
    assert confirmed.pressure_mbar < 5
    bench.until(is_state(InstrumentState.LOADED))
    assert not bench.of(Alarm)
    bench.probe.arm()  # and it can be repeated


def test_a_last_word_that_was_lost_is_asked_for(make_bench):
    """One damaged frame, and a whole curve ended in "still running", with no repeat behind it."""
    bench = make_bench()
    whole, lost = bench.device.transmit, []

    def transmit():
        data = whole()
        for frame in data.split(b"\n"):
            if b",done*" in frame and not lost:
                lost.append(frame)
                data = data.replace(frame + b"\n", b"")
        return data

    bench.device.transmit = transmit
    run(bench)
    bench.until(is_a(VentConfirmed))
    bench.until(is_state(InstrumentState.LOADED, "identify"))
    assert lost
    bench.probe.arm()  # and it can be repeated
    bench.probe.start()
    bench.until(is_state(InstrumentState.LOADED, "done"))
    assert not bench.of(HostVented)


def test_nothing_is_started_behind_a_vent_that_was_not_heard(make_bench):
    """Start was legal until the instrument's answer: it ran until the vent was sent again."""
    link = make_bench().link
    engine = Engine(link, Connection(DIALECT), link.clock, lambda event: None, None, Watchdog())

    def ask(command, state):
        answer = engine.submit(Request(command, [is_state(state)], 2.0))
        while not answer.done():
            engine.step()
        return answer

    ask(Identify(), InstrumentState.IDLE).result()
    ask(Load(HOLD, 20, 50, 60), InstrumentState.LOADED).result()
    ask(Arm(), InstrumentState.ARMED).result()
    link.lose = [b"$VENT"]
    engine.order_vent("operator")
    engine.step()
    assert engine.connection.state is InstrumentState.ARMED
    with pytest.raises(LocalProtocolError, match="a vent was ordered and is not over"):
        ask(Start(), InstrumentState.RUNNING).result()
    assert not any(data.startswith(b"$START") for data in link.written)
    while engine.connection.state is not InstrumentState.LOADED:
        engine.step()
    ask(Arm(), InstrumentState.ARMED).result()


def test_a_machine_that_stops_the_thread_behind_a_read_raises_no_alarm(make_bench):
    stood = []

    def stand_still(direction, host_time_s, data):
        if direction == "rx" and bench.device.state is InstrumentState.VENTING and not stood:
            stood.append(bench.device.pressure_mbar)
            bench.link.now += 1.5  # the instrument goes on, and what it says waits to be read
            bench.device.process(1.5)

    bench = make_bench(on_bytes=stand_still)
    run(bench, HOLD)
    bench.link.hook = once_pulling(bench.probe.vent)
    bench.until(is_a(VentConfirmed))
    bench.probe.close()
    bench.rest()
    assert stood[0] > 5.0  # it was still to fall
    assert not bench.of(Alarm)


def test_leaving_the_block_in_a_run_vents_the_instrument(make_bench):
    bench = make_bench()
    leaving = threading.Event()

    def fail():
        bench.link.hook = once_pulling(leaving.wait)
        with bench.probe:
            run(bench, HOLD)
            bench.until(lambda e: isinstance(e, Sample) and e.pressure_mbar > 45)
            leaving.set()  # and 55 s of the device's time are left to vent it
            raise RuntimeError("the caller's")

    with pytest.raises(RuntimeError, match="the caller's"):
        fail()
    assert bench.device.pressure_mbar < 5
    assert any(isinstance(event, VentConfirmed) for event in bench.rest())


@pytest.mark.parametrize("trouble", ["stale", "overshoot", "frozen"])
def test_watchdog_vents(make_bench, trouble):
    bench = make_bench(noise=False)
    if trouble == "frozen":
        bench.skin.frozen_at = 20
    elif trouble == "overshoot":

        def push(link):
            if link.device.state is InstrumentState.RUNNING:
                link.device.plant.pressure_mbar = 70.0

        bench.link.hook = samples_then(push, 15)
    else:
        bench.link.hook = samples_then(lambda link: setattr(link, "deaf", True), 15)
    if trouble == "overshoot":  # the maximum of the program is higher, so that only the host sees
        segments = (*HOLD[:1], Segment(SegmentKind.HOLD, duration_s=5))
        segments += (Segment(SegmentKind.RAMP, target_mbar=90, rate_mbar_per_s=10),)
        run(bench, segments)
    else:
        run(bench)
    vented = bench.until(is_a(HostVented))
    assert trouble in vented.reason
    if trouble == "stale":
        alarm = bench.until(is_a(Alarm))  # nothing is seen, so nothing is confirmed
        assert "lift the probe" in alarm.text
        assert sum(data.startswith(b"$VENT") for data in bench.link.written) >= 5  # it insists
    else:
        bench.until(is_a(VentConfirmed))
    assert bench.device.state is not InstrumentState.RUNNING


def test_stuck_valve_latches_an_alarm(make_bench):
    bench = make_bench()

    vents = []

    def stick(link):
        link.device.plant.pressure_mbar = max(link.device.pressure_mbar, 45.0)
        if not vents:
            vents.append(bench.probe.vent())

    bench.link.hook = samples_then(stick, 40)
    run(bench, HOLD)
    alarm = bench.until(is_a(Alarm))
    assert "lift the probe" in alarm.text
    assert bench.probe.alarm == alarm.text
    bench.until(is_state(InstrumentState.FAULT))
    with pytest.raises(InstrumentRefusedError, match="not vented"):
        bench.probe.reset()
    bench.link.hook = lambda link: None
    bench.until(is_a(VentConfirmed))
    bench.probe.reset()
    with pytest.raises(LocalProtocolError, match="alarm"):
        bench.probe.load(RAMP, 20)
    bench.probe.acknowledge_alarm()
    bench.probe.load(RAMP, 20)
    assert bench.probe.alarm is None


def test_a_recorder_that_fails_vents_and_is_reported(make_bench):
    failures = []

    def full_disk(way, now, data):
        if b"$S,30," in data:
            failures.append(now)
        if failures:
            raise OSError("disk full")

    bench = make_bench(on_bytes=full_disk)
    run(bench, HOLD)
    vented = bench.until(is_a(HostVented))
    assert vented.reason == "recording the bytes failed: disk full"  # and no class of Python's
    assert bench.probe.recording_error == vented.reason
    bench.until(is_a(VentConfirmed))
    with pytest.raises(LocalProtocolError, match="disk full"):
        bench.probe.arm()
    assert len(failures) == 1


def test_an_exception_in_the_thread_vents_and_is_reported(make_bench):
    bench = make_bench()

    def bug(link):
        link.hook = lambda link: None
        raise ZeroDivisionError("a bug")

    bench.link.hook = samples_then(bug)
    run(bench, HOLD)
    vented = bench.until(is_a(HostVented))
    assert "a bug" in vented.reason
    bench.until(is_a(VentConfirmed))
    assert bench.probe.is_open


def test_a_bug_that_stays_ends_as_link_lost(make_bench):
    bench = make_bench()

    def bug(link):
        raise ZeroDivisionError("a bug")

    bench.link.hook = samples_then(bug)
    run(bench, HOLD)
    bench.until(is_a(LinkLost))
    bench.until(is_a(Alarm))
    with pytest.raises(LinkError, match="a bug"):
        bench.probe.reset()


def test_unplugged_in_a_run(make_bench):
    bench = make_bench()

    def gone(link):
        raise LinkError("loop is gone")

    bench.link.hook = samples_then(gone)
    run(bench, HOLD)
    assert bench.until(is_a(LinkLost)).reason == "loop is gone"
    assert "lift the probe" in bench.until(is_a(Alarm)).text
    assert not bench.probe.is_open
    with pytest.raises(LinkError, match="loop is gone"):
        bench.probe.start()
    bench.probe.acknowledge_alarm()
    assert bench.probe.alarm is None
    bench.probe.close()
    bench.link.hook = lambda link: None
    bench.probe.open()  # plugged in again
    assert bench.probe.state in {InstrumentState.IDLE, InstrumentState.LOADED}


def test_reopened_after_the_link_was_lost(make_bench):
    bench = make_bench()

    def gone(link):
        raise LinkError("loop is gone")

    bench.link.hook = samples_then(gone)
    run(bench, HOLD)
    bench.until(is_a(Alarm))
    with pytest.raises(LinkError, match="gone"):
        bench.probe.reopen()
    bench.link.hook = lambda link: None
    bench.link.now += 2.0  # a while in which the instrument has long vented
    bench.device.process(2.0)
    bench.device.transmit()
    hello = bench.probe.reopen()
    assert hello == bench.probe.hello
    assert bench.until(is_a(VentConfirmed)).pressure_mbar < 5
    assert bench.until(is_a(LinkRestored)).outage_s > 2.0
    with pytest.raises(LocalProtocolError, match="acknowledge the alarm"):
        bench.probe.load(RAMP, 20)
    bench.probe.acknowledge_alarm()
    with pytest.raises(LocalProtocolError, match="load a program first"):
        bench.probe.arm()
    bench.probe.load(RAMP, 20)
    bench.probe.arm()
    bench.probe.start()
    bench.until(is_state(InstrumentState.LOADED, "done"))


def test_another_instrument_after_the_outage(make_bench):
    class Renamed(Device):
        serial = "SIM-1"

        def _hello(self):
            return dataclasses.replace(super()._hello(), serial_number=self.serial)

    bench = make_bench(device_type=Renamed)
    bench.probe.open()
    bench.device.serial = "SIM-2"
    with pytest.raises(RemoteProtocolError, match=r"another instrument.*SIM-2.*it was.*SIM-1"):
        bench.probe.reopen()
    assert not bench.probe.is_open
    bench.device.serial = "SIM-1"
    bench.probe.reopen()


def test_an_instrument_that_is_found_running_is_vented(make_bench):
    bench = make_bench()
    dialect = bench.device.dialect
    for number, command in enumerate((Load(HOLD, 20, 50, 60), Arm(), Start())):
        bench.device.receive(dialect.encode_command(command, number))
    bench.device.process(0.4)
    assert bench.device.pressure_mbar > 30
    bench.probe.open()
    assert bench.device.pressure_mbar < 5
    assert bench.probe.state in {InstrumentState.IDLE, InstrumentState.LOADED}
    with pytest.raises(LocalProtocolError, match="load a program"):
        bench.probe.arm()  # that program is not ours


@pytest.mark.parametrize(
    ("segments", "rate_hz", "match"),
    [
        ((Segment(SegmentKind.RAMP, target_mbar=501, rate_mbar_per_s=20),), 20, "501 mbar.*500"),
        ((*HOLD, Segment(SegmentKind.HOLD, duration_s=5)), 20, "60.5 s.*60 s"),
        (RAMP, 1001, "1001 Hz.*1000 Hz"),
        (RAMP, float("nan"), "sample rate nan"),
        ((), 20, "0 segments"),
        (RAMP * 100, 20, "200 segments"),
        ((Segment(SegmentKind.RAMP, target_mbar=10),), 20, "rate 0"),
        ((Segment(SegmentKind.HOLD, duration_s=-1),), 20, "duration_s"),
    ],
)
def test_beyond_a_limit_nothing_is_sent(make_bench, segments, rate_hz, match):
    bench = make_bench()
    bench.probe.open()
    before = list(bench.link.written)
    with pytest.raises(LocalProtocolError, match=match):
        bench.probe.load(segments, rate_hz)
    assert bench.link.written == before
    assert bench.probe.state is InstrumentState.IDLE


def test_what_the_instrument_refuses(make_bench):
    bench = make_bench()

    def too_stiff(aperture_mm, max_pressure_mbar):
        raise RuntimeError("the solver, at 40 mbar, did not converge ☹")

    bench.skin.prepare = too_stiff
    bench.probe.open()
    with pytest.raises(InstrumentRefusedError, match="at 40 mbar, did not converge"):
        bench.probe.load(RAMP, 20)


def test_a_read_back_that_differs(make_bench):
    class Deaf(Device):
        def _take_load(self, load, number):
            changed = Load(load.segments, load.rate_hz, load.max_pressure_mbar + 1, 60)
            super()._take_load(changed, number)

    bench = make_bench(device_type=Deaf)
    bench.probe.open()
    with pytest.raises(RemoteProtocolError, match="another program"):
        bench.probe.load(RAMP, 20)
    bench.until(is_a(HostVented))
    with pytest.raises(LocalProtocolError, match="load a program"):
        bench.probe.arm()


def test_another_protocol_version(make_bench):
    class Newer(Device):
        def _hello(self):
            return dataclasses.replace(super()._hello(), protocol_version=2)

    bench = make_bench(device_type=Newer)
    with pytest.raises(RemoteProtocolError, match="version 2"):
        bench.probe.open()
    assert not bench.probe.is_open
    assert bench.link.closed


@pytest.mark.parametrize("command", [b"$ID", b"$LOAD", b"$ARM", b"$START", b"$VENT"])
def test_a_lost_command_is_sent_again_and_done_once(make_bench, command):
    bench = make_bench()
    bench.link.lose.append(command)
    vents = []

    def vent_once(link):
        if not vents:
            vents.append(bench.probe.vent())

    bench.link.hook = samples_then(vent_once)
    run(bench)
    bench.until(is_a(VentConfirmed))
    assert sum(data.startswith(command) for data in bench.link.written) == 2
    assert len([s for s in bench.of(State) if s.reason == "started"]) == 1


def test_no_answer(make_bench):
    bench = make_bench()
    bench.link.deaf = True
    with pytest.raises(LinkError, match="no answer to Identify in 1 s: is the instrument on"):
        bench.probe.open(1.0)
    assert bench.link.written[-1].startswith(b"$VENT")


def test_vent_overtakes_what_waits(make_bench):
    bench = make_bench()
    bench.probe.open()
    bench.link.deaf = True

    def vent(link):
        if any(data.startswith(b"$LOAD") for data in link.written):
            link.hook = lambda link: None
            bench.probe.vent("hand")

    bench.link.hook = vent
    with pytest.raises(LocalProtocolError, match=r"^Load was abandoned: vent \(hand\)$"):
        bench.probe.load(RAMP, 20)


def test_closing_while_the_port_opens_is_no_error(make_bench, monkeypatch):
    """Who closed before the thread ran joined one that had not begun, and let go of nothing."""
    bench, errors = make_bench(), []
    start = threading.Thread.start

    def closed_first(thread):
        if thread.name.startswith("probe "):
            try:
                bench.probe.close()
            except RuntimeError as error:
                errors.append(error)
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", closed_first)
    bench.probe.open()
    bench.probe.close()
    assert errors == []
