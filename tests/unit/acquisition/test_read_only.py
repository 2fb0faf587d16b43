"""What only streams, through the whole pipeline: a lost link, and a replay that agrees."""

from __future__ import annotations

import threading
from contextlib import nullcontext

import pytest
from streaming_instrument import AT_REST, TEXT, Wire, ramp

from drivers.errors import LocalProtocolError
from drivers.events import Alarm, InstrumentState, LinkLost, LinkRestored, Segment, State
from drivers.line_dialect import line_dialect
from drivers.probe import Probe
from drivers.reconnect import Backoff
from skinlab.acquisition.measure import measure
from skinlab.acquisition.measurement import Policy
from skinlab.acquisition.measurement_messages import Plan
from skinlab.acquisition.pipeline import Pipeline
from skinlab.acquisition.replay import differences, identifier_of, replay
from skinlab.acquisition.sources import LiveSource
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.errors import AcquisitionError, InputError
from skinlab.inference.identify import Identifier
from skinlab.recording.recorder import Recording
from skinlab.recording.session import read_session
from skinlab.recording.stream import CurveStarted, Happened, Identified
from skinlab.tables.store import shipped_table

ROUND = [0.0] * AT_REST + ramp(40.0) + ramp(40.0)[-2::-1] + [0.0] * AT_REST
DIALECT = line_dialect(TEXT, "plain.toml")


class Person:
    """Somebody at the instrument, who acts on what is said."""

    def __init__(self, wire, *deeds):
        self.wire, self.deeds = wire, list(deeds)
        self.heard = []

    def __call__(self, message):
        self.heard.append(message)
        for wants, does in self.deeds[:1]:
            if wants(message):
                del self.deeds[0]
                does()


def waits(message):
    return isinstance(message, Happened) and message.event == State(
        InstrumentState.ARMED, "waits for the pressure to leave zero"
    )


def runs(message):
    return isinstance(message, CurveStarted)


def measured(tmp_path, wire, person, *, repeats, dialect=DIALECT, setup=None, policy=None):
    identifier = Identifier(shipped_table())
    path = tmp_path / "s.h5"
    recording = Recording(path, identifier, dialect=dialect)
    try:
        with Probe(
            "COM99", dialect=dialect, open_link=wire.open, on_bytes=recording.journal.raw
        ) as probe:
            probe.open()
            source = LiveSource(probe, recording.journal)
            plan = Plan(setup or Setup(6.0, 1.0), repeats=repeats)
            measure(source, plan, Pipeline(identifier, [recording, person]), policy=policy)
    finally:
        recording.finish()
    assert wire.sent == []
    return read_session(path)


def agrees(session):
    results = []

    def keep(message):
        if isinstance(message, Identified):
            results.append(message.result)

    curves = replay(session, identifier_of(session)[0], [keep])
    return differences(session, curves, results) == []


def test_a_link_that_is_lost_cuts_a_curve_which_is_taken_again(tmp_path):
    wire = Wire()

    def unplug():
        wire.unplugged = True

    def replug():
        wire.unplugged = False
        wire.put([0.0] * 5)  # it is seen that the suction is gone

    person = Person(
        wire,
        (waits, lambda: wire.put(ROUND)),
        (waits, lambda: wire.put([0.0] * AT_REST + ramp(30.0))),
        (runs, lambda: threading.Timer(0.3, unplug).start()),
        (lambda m: isinstance(m, Happened) and isinstance(m.event, LinkLost), replug),
        (waits, lambda: wire.put(ROUND)),
    )
    session = measured(tmp_path, wire, person, repeats=2)
    assert [curve.partial for curve in session.curves] == [False, True, False]
    assert [curve.setup.cycle for curve in session.curves] == [1, 2, 3]
    happened = [m.event for m in person.heard if isinstance(m, Happened)]
    assert [e for e in happened if isinstance(e, LinkRestored)]
    (alarm,) = [e for e in happened if isinstance(e, Alarm)]
    assert "the link is lost under suction" in alarm.text
    assert agrees(session)


BACK_AT_ZERO = ROUND[:-AT_REST]


@pytest.mark.parametrize(
    ("readings", "program", "partial"),
    [
        (BACK_AT_ZERO, None, False),
        ([*BACK_AT_ZERO, 0.0, 0.0, 0.0], None, False),
        (BACK_AT_ZERO[:-10], None, True),
        (BACK_AT_ZERO, "ramp:40@20,ramp:0@20,rest:10", True),  # in the midst of its rest
        ([*BACK_AT_ZERO, 0.0, 0.0], "ramp:40@20,ramp:0@20,rest:10", True),
    ],
)
def test_an_instrument_that_hangs_up_when_it_is_done_is_replayed_as_it_was(
    tmp_path, readings, program, partial
):
    wire = Wire()

    def run():
        wire.put(readings)
        wire.hangs_up = True

    setup = Setup(6.0, 1.0, None if program is None else parse_program(program))
    soon = Policy(Backoff(0.01, 1.0, 0.01, 0.01))
    with pytest.raises(AcquisitionError, match="unplugged") if partial else nullcontext():
        measured(tmp_path, wire, Person(wire, (waits, run)), repeats=1, setup=setup, policy=soon)
    session = read_session(tmp_path / "s.h5")
    (curve,) = session.curves
    assert curve.partial == partial
    assert agrees(session)


def test_the_opening_that_a_dialect_names_has_to_be_that_of_the_setup(tmp_path):
    probe = Probe("COM99", dialect=line_dialect(TEXT + "aperture_mm = 8\n", "p.toml"),
                  open_link=Wire().open)  # fmt: skip
    with probe:
        assert probe.open().aperture_mm == 8.0
        with pytest.raises(InputError, match="the probe has 8 mm"):
            LiveSource(probe).arm(Setup(6.0, 1.0))


def test_a_probe_that_is_read_only_is_never_told_anything():
    wire = Wire()
    with Probe("COM99", dialect=DIALECT, open_link=wire.open) as probe:
        assert probe.open().read_only
        assert probe.read_only
        for order in (
            lambda: probe.load([Segment("release")], 20.0),
            probe.arm,
            probe.start,
            probe.reset,
        ):
            with pytest.raises(LocalProtocolError, match="its own limits hold"):
                order()
        probe.follow()
        probe.vent()
        while (event := probe.next_event(5.0)) is not None:
            if isinstance(event.event, State) and event.event.reason == "operator":
                break
        assert event is not None
        assert probe.state is InstrumentState.IDLE
    assert wire.sent == []


def test_only_what_streams_is_followed():
    with Probe("sim://?seed=1") as probe:
        probe.open()
        with pytest.raises(LocalProtocolError, match="only stream"):
            probe.follow()


def test_a_stream_that_falls_silent_ends_its_curve_and_the_record_says_so(tmp_path):
    wire = Wire()
    silent = line_dialect(TEXT.replace("silent_s = 600", "silent_s = 0.2"), "plain.toml")
    person = Person(wire, (waits, lambda: wire.put([0.0] * AT_REST + ramp(20.0))))
    with pytest.raises(AcquisitionError, match=r"nothing came|nobody can see the pressure"):
        measured(tmp_path, wire, person, repeats=1, dialect=silent)
    session = read_session(tmp_path / "s.h5")
    (curve,) = session.curves
    assert curve.partial
    assert curve.pressure_mbar.max() == 20.0
    assert agrees(session)
