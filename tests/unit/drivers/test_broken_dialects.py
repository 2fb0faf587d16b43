"""Dialects whose code fails: the probe vents, who waits is told, and the sentence names them."""

from __future__ import annotations

import importlib.metadata
import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from drivers import dialects
from drivers.capabilities import Capabilities, Stream
from drivers.dialects import get_dialect
from drivers.errors import BrokenDialectError, RemoteProtocolError
from drivers.events import (
    Alarm,
    Arm,
    Damaged,
    Hello,
    HostVented,
    InstrumentState,
    LinkLost,
    Loaded,
    Reading,
    Sample,
    Segment,
    SegmentKind,
    Start,
    State,
    Vent,
    VentConfirmed,
)
from drivers.guarded import guarded
from drivers.stream import StreamConnection, connect, follow_mark

RAMP = (Segment(SegmentKind.RAMP, target_mbar=40, rate_mbar_per_s=20),)
REFERENCE = get_dialect("reference")
NAN = math.nan


class Faulty:
    """The reference dialect, of which one function goes wrong from some moment on."""

    def __init__(self, **faults):
        self.faults = faults
        self.after = 10  # samples that are read well
        self.samples = 0

    def __getattr__(self, name):
        return getattr(REFERENCE, name)

    def _fault(self, name, given):
        fault = self.faults.get(name)
        return fault(given) if fault and self.samples >= self.after else None

    def take(self, buffer):
        return self._fault("take", buffer) or REFERENCE.take(buffer)

    def decode_event(self, frame):
        event, number = REFERENCE.decode_event(frame)
        self.samples += isinstance(event, Sample)
        return self._fault("decode_event", event) or (event, number)

    def encode_command(self, command, number):
        return self._fault("encode_command", command) or REFERENCE.encode_command(command, number)


def of(kind, act):
    return lambda given: act(given) if isinstance(given, kind) else None


def fail(_):
    return {}["missing"]


def leave(_):
    raise SystemExit(3)


def refuse(_):
    raise RemoteProtocolError("take may not say so")


def run(bench):
    bench.probe.open()
    bench.probe.load(RAMP, 20)
    bench.probe.arm()
    bench.probe.start()


@pytest.mark.parametrize(
    ("faults", "told"),
    [
        ({"take": fail}, "dialect 'reference': broke down: KeyError: 'missing' (test_broken"),
        ({"take": leave}, "broke down: SystemExit: 3"),
        ({"take": refuse}, "broke down: RemoteProtocolError: take may not say so"),
        ({"take": lambda buffer: "text"}, "take returned a str; expected bytes, Damaged or None"),
        ({"take": lambda buffer: b"again"}, "take returned a frame and removed nothing"),
        ({"take": lambda buffer: Damaged(7, buffer.pop(0))}, "take returned Damaged of an int and"),
        ({"decode_event": fail}, "broke down: KeyError: 'missing'"),
        ({"decode_event": lambda event: event}, "decode_event returned a Sample; expected an eve"),
        ({"decode_event": lambda event: (7, None)}, "decode_event returned an int; expected one"),
        (
            {"decode_event": of(Sample, lambda s: (replace(s, pressure_mbar="12"), None))},
            "Sample.pressure_mbar is a str; expected a number",
        ),
        ({"encode_command": fail}, "broke down: KeyError: 'missing'"),  # the keep-alive
        ({"encode_command": lambda command: "text"}, "encode_command returned a str; expected byt"),
    ],
)
def test_what_breaks_down_under_suction_vents_and_is_named(make_bench, faults, told):
    bench = make_bench(dialect=Faulty(**faults))
    run(bench)
    # Where no word can go out the link is given up, and the instrument vents by itself
    end = LinkLost if "encode_command" in faults else HostVented
    assert told in bench.until(lambda event: isinstance(event, end)).reason
    assert len(bench.of(Sample)) >= 9  # what came before stays
    if end is LinkLost:
        bench.until(lambda event: isinstance(event, Alarm))
    else:
        assert any(REFERENCE.decode_command(w)[0] == Vent() for w in bench.link.written)


def test_one_frame_that_breaks_it_vents_and_the_vent_is_seen(make_bench):
    broken = Faulty(decode_event=lambda event: broken.faults.clear() or fail(event))
    bench = make_bench(dialect=broken)
    run(bench)
    vented = bench.until(lambda event: isinstance(event, HostVented))
    assert "broke down: KeyError: 'missing'" in vented.reason
    bench.until(lambda event: isinstance(event, State) and event.state is InstrumentState.LOADED)
    assert not bench.of(Alarm)
    assert not bench.of(LinkLost)


@pytest.mark.parametrize("kind", [Arm, Start])
def test_who_waits_for_a_command_that_cannot_be_said_is_told(make_bench, kind):
    dialect = Faulty(encode_command=of(kind, fail))
    dialect.after = 0
    bench = make_bench(dialect=dialect)
    with pytest.raises(BrokenDialectError, match="dialect 'reference': broke down: KeyError"):
        run(bench)


@pytest.mark.parametrize(
    ("kind", "field", "told"),
    [
        (Hello, {"max_pressure_mbar": NAN}, "Hello.max_pressure_mbar is nan; expected a finite"),
        (Hello, {"model": None}, "Hello.model is a NoneType; expected a text"),
        (State, {"state": "idle"}, "State.state is a str; expected InstrumentState"),
        (Loaded, {"segments": ("ramp",)}, "segments holds a str; expected segments"),
    ],
)
def test_what_an_instrument_says_of_itself_has_its_types(make_bench, kind, field, told):
    dialect = Faulty(decode_event=of(kind, lambda event: (replace(event, **field), None)))
    dialect.after = 0
    bench = make_bench(dialect=dialect)
    with pytest.raises(BrokenDialectError, match="dialect 'reference': broke down: ") as error:
        run(bench)
    assert told in str(error.value)


@pytest.mark.parametrize("field", ["pressure_mbar", "deflection_mm", "device_time_s"])
@pytest.mark.parametrize("value", [NAN, math.inf])
def test_readings_that_are_no_numbers_are_no_samples(make_bench, field, value):
    """As if none came: within the limit for a stale link it vents, and says why."""
    dialect = Faulty(decode_event=of(Sample, lambda s: (replace(s, **{field: value}), None)))
    bench = make_bench(dialect=dialect)
    run(bench)
    vented = bench.until(lambda event: isinstance(event, HostVented))
    told = f": the readings are no numbers ({field} is {value})"
    assert vented.reason == "stale link: no sample for 300 ms" + told
    good = [t.host_time_s for t in bench.seen if isinstance(t.event, Sample)]
    assert bench.seen[-1].host_time_s - good[-1] < 0.4
    assert len(good) == 9


def test_a_state_whose_pressure_is_no_number_is_a_state_without_one():
    dialect = Faulty(decode_event=of(State, lambda s: (replace(s, pressure_mbar=NAN), None)))
    dialect.after = 0
    frame = REFERENCE.encode_event(State(InstrumentState.IDLE, "", 3.0), 1)
    assert guarded(dialect).decode_event(frame)[0].pressure_mbar is None


# ---- of an instrument that only streams --------------------------------------------------------


class Lines:
    """Readings, a line each: `pressure deflection`; a word breaks it."""

    name, protocol_version = "lines", 1
    capabilities, stream = Capabilities(), Stream(rate_hz=10.0)

    def take(self, buffer):
        if b"break" in buffer:
            raise ZeroDivisionError("at a word")
        line, found, _ = bytes(buffer).partition(b"\n")
        del buffer[: len(line) + len(found)]
        return line

    def decode_event(self, frame):
        pressure, deflection = map(float, frame.split())
        return Reading(pressure, deflection), None


class Lined:
    """A link with what such an instrument sends, and the clock; ten lines a second."""

    def __init__(self, lines):
        self.lines = lines
        self.followed = False
        self.now = 100.0

    def read(self, max_bytes, timeout_s):
        self.now += 0.1
        return next(self.lines) if self.followed else b"0 0\n"

    def write(self, data):
        raise AssertionError("nothing goes out")

    def close(self):
        pass


def lines(*, ends):
    for pressure in (0.0, 0.0, 2.0, 4.0, 6.0, 8.0, 10.0):
        yield f"{pressure} 0.1\n".encode()
    while True:
        yield ends


def streamed(make_probe, ends, wanted):
    link = Lined(lines(ends=ends))
    probe = make_probe("lines", clock=lambda: link.now, open_link=lambda _: link, dialect=Lines())
    seen = []
    with probe:
        probe.open()
        probe.follow()
        link.followed = True
        while not any(isinstance(event, wanted) for event in seen):
            timed = probe.next_event(60.0)
            assert timed is not None, seen
            seen.append(timed.event)
    return seen


def test_a_stream_whose_dialect_breaks_down_is_lost_with_a_sentence(monkeypatch):
    from drivers.probe import Probe

    seen = streamed(Probe, b"break", LinkLost)
    assert "dialect 'lines': broke down: ZeroDivisionError: at a word" in seen[-1].reason


@pytest.mark.parametrize("value", [math.nan, np.float32("nan"), np.float16("inf")])
def test_a_reading_is_no_number_in_whatever_width(value):
    faulty = Faulty(decode_event=of(Sample, lambda s: (replace(s, deflection_mm=value), None)))
    faulty.after = 0
    buffer = bytearray(REFERENCE.encode_event(Sample(1, 0.1, 5.0, 0.1, 0), None))
    with pytest.raises(RemoteProtocolError, match="no numbers"):
        guarded(faulty).decode_event(REFERENCE.take(buffer))


def test_a_stream_of_no_numbers_raises_the_alarm():
    from drivers.probe import Probe

    seen = streamed(Probe, b"nan 0.1\n", Alarm)
    assert "ms: the readings are no numbers (pressure_mbar is nan)" in seen[-1].text


def test_lines_that_are_no_numbers_count_where_nothing_else_does():
    """So that the readings behind them have their times."""
    connection = connect(Lines())
    assert isinstance(connection, StreamConnection)
    connection.mark(follow_mark(None))
    connection.receive_data(b"0 0\n9 0\nnan 0\n9 0\n")
    events = list(iter(connection.next_event, None))
    assert [e.device_time_s for e in events if isinstance(e, Sample)] == [0.0, 0.1, 0.3]


def test_a_vent_does_not_wait_for_what_a_slow_dialect_makes_of_a_backlog(make_bench):
    """Four samples that came at once: the order is sent before the second one is read."""
    sent = []

    def order(event):
        if isinstance(event, Sample):
            if not sent:
                bench.probe.vent("operator")
            sent.append(any(REFERENCE.decode_command(w)[0] == Vent() for w in bench.link.written))

    dialect = Faulty(decode_event=order)
    dialect.after = 12  # within a burst
    bench = make_bench(dialect=dialect)
    at_once, held, read = 20, [], bench.link.read

    def bursts(max_bytes, timeout_s):
        held.append(read(max_bytes, timeout_s))
        if bench.link.device.sequence < 10 or len(held) >= at_once:
            data = b"".join(held)
            held.clear()
            return data
        return b""

    bench.link.read = bursts
    run(bench)
    bench.until(lambda event: isinstance(event, HostVented) and event.reason == "operator")
    bench.until(lambda event: isinstance(event, VentConfirmed))
    assert sent[:2] == [False, True]


def test_of_two_packages_with_one_dialect_the_first_by_name_is_taken(monkeypatch, capsys):
    """As `skinlab plugins` lists them: a measurement had taken whichever was found first."""

    def entry(package, load):
        dist = SimpleNamespace(name=package, version="1.0")
        return SimpleNamespace(name="ours", dist=dist, load=load)

    def ours(package):
        return type("Ours", (type(get_dialect("reference")),), {"name": "ours", "of": package})()

    late, first = (entry(p, partial(ours, p)) for p in ("zebra", "ant"))
    broken = entry("aardvark", partial(int, "x"))
    found = [late, broken, first]
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: found)
    (taken, origin), *others = dialects._installed.__wrapped__().values()
    assert (taken.of, origin, others) == ("ant", ("ant", "1.0"), [])
    assert capsys.readouterr().err.splitlines() == [
        "drivers: plugin aardvark, dialect 'ours': left out, because it is broken: ValueError: "
        "invalid literal for int() with base 10: 'x'",
        "drivers: plugin zebra, dialect 'ours': left out, because one of this name comes from ant",
    ]
