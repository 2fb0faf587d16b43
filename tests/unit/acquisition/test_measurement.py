"""The rules of a measurement: by hand for each, and at random for what must always hold."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from drivers.errors import InstrumentRefusedError, LinkError, RemoteProtocolError
from drivers.events import (
    PROGRAM_DONE,
    PROGRAM_END,
    Alarm,
    Damaged,
    HostVented,
    InstrumentFault,
    InstrumentState,
    LinkLost,
    LinkRestored,
    Sample,
    State,
    VentConfirmed,
)
from drivers.reconnect import Backoff
from skinlab.acquisition.measurement import Measurement, Policy
from skinlab.acquisition.measurement_messages import (
    Abort,
    Acknowledge,
    AcknowledgeAlarm,
    Arm,
    ArmProbe,
    Close,
    Continue,
    Failed,
    Gone,
    Over,
    Phase,
    Plan,
    Reconnect,
    Refused,
    RepeatEnded,
    Start,
    StartProbe,
    Succeeded,
    Vent,
    VentProbe,
)
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program

SETUP = Setup(6.0, 1.0, parse_program("ramp:100@20"))
PLAN = Plan(SETUP, repeats=2, rest_s=5.0)
RUNNING = State(InstrumentState.RUNNING, "start", 0.0)
ENDED = State(InstrumentState.VENTING, PROGRAM_END, 50.0)
DONE = State(InstrumentState.LOADED, PROGRAM_DONE, 0.0)
ALARM = Alarm("the link is lost and the vacuum cannot be checked: lift the probe")


class Bed:
    """A measurement with a time that passes only where it is told to."""

    def __init__(self, policy=None):
        self.measurement = Measurement(Policy() if policy is None else policy)
        self.now = 0.0
        self.outputs = []
        self.awaited = None

    def give(self, *given):
        """Hand these in; return what is to be done."""
        found = []
        for one in given:
            found += self.measurement.handle(one, self.now)
        self.outputs += found
        for output in found:
            if isinstance(output, ArmProbe | StartProbe | Reconnect):
                self.awaited = output
        return found

    def succeed(self):
        return self.give(Succeeded(self.awaited))

    def fail(self, error, **more):
        return self.give(Failed(self.awaited, error, **more))

    def wait(self, seconds):
        self.now += seconds
        return self.give(None)

    def wake(self):
        """Let time pass until the measurement wants to be asked."""
        self.now = max(self.now, self.measurement.wake_at)
        return self.give(None)

    def run(self):
        """From an ArmProbe to the suction."""
        self.succeed()
        self.succeed()
        self.give(RUNNING, Sample(0, 0.0, 1.0, 0.1, 0))

    def started(self):
        self.give(Arm(PLAN), Start())
        self.run()
        return self

    def of(self, kind):
        return [output for output in self.outputs if isinstance(output, kind)]

    @property
    def phase(self):
        return self.measurement.phase


@pytest.fixture
def bed():
    return Bed()


def test_repeats_with_a_rest_between_them(bed):
    (armed,) = bed.give(Arm(PLAN), Start())
    assert isinstance(armed, ArmProbe)
    assert armed.setup == SETUP
    (started,) = bed.succeed()
    assert isinstance(started, StartProbe)
    bed.succeed()
    bed.give(RUNNING)
    assert bed.phase is Phase.RUNNING
    bed.now = 7.0
    assert bed.give(ENDED) == [RepeatEnded(SETUP, ran=True, cut=None)]
    bed.now = 8.0
    assert bed.give(DONE) == []
    assert (bed.phase, bed.measurement.wake_at) == (Phase.RESTING, 13.0)
    bed.now = 12.9
    assert bed.give(None) == []
    (again,) = bed.wake()
    assert again.setup == replace(SETUP, cycle=2, repeat=2)
    bed.run()
    bed.give(ENDED)
    assert not bed.of(Over)
    bed.give(DONE)
    bed.wake()
    (over,) = bed.of(Over)
    assert over.failed is None
    assert bed.phase is Phase.READY
    assert not bed.of(VentProbe)
    assert len(bed.of(RepeatEnded)) == 2


def test_what_is_armed_waits_for_its_start(bed):
    bed.give(Arm(PLAN))
    assert bed.succeed() == []
    assert bed.phase is Phase.ARMED
    assert bed.wait(1000.0) == []
    (started,) = bed.give(Start())
    assert isinstance(started, StartProbe)
    assert isinstance(bed.give(Start())[0], Refused)


def test_a_start_without_an_arm_is_refused(bed):
    (refused,) = bed.give(Start())
    assert isinstance(refused, Refused)
    bed.started()
    assert isinstance(bed.give(Arm(PLAN))[0], Refused)
    assert len(bed.of(ArmProbe)) == 1


def test_the_series_is_over_only_when_the_stream_is_quiet(bed):
    bed.give(Arm(replace(PLAN, repeats=1)), Start())
    bed.run()
    bed.give(ENDED, DONE)
    for _ in range(5):
        bed.wait(0.09)
        assert bed.give(VentConfirmed(1.0)) == []
    bed.wake()
    assert len(bed.of(Over)) == 1


def test_a_lost_done_holds_nothing_up_for_ever(bed):
    """On a noisy line the instrument's last word may be lost, and the pressure still be seen."""
    bed.started()
    bed.give(ENDED, VentConfirmed(2.0))
    assert bed.phase is Phase.SETTLING
    bed.wait(bed.measurement.policy.vent_patience_s)
    assert bed.phase is Phase.RESTING


@pytest.mark.parametrize(
    "fault",
    [
        InstrumentFault("pressure", "too much"),
        Alarm("the pressure did not fall: lift the probe"),
        State(InstrumentState.VENTING, "keep-alive lost", 50.0),
        State(InstrumentState.FAULT, "pressure", 50.0),
        LinkLost("pulled out"),
    ],
)
def test_a_fault_vents_first_and_ends_the_repeat(bed, fault):
    bed.started()
    first, second, *_ = bed.give(fault)
    assert isinstance(first, VentProbe)
    assert isinstance(second, RepeatEnded)
    assert second.ran
    assert second.cut


def test_a_vent_of_the_driver_ends_the_series(bed):
    bed.started()
    bed.give(HostVented("overshoot"), State(InstrumentState.VENTING, "vent", 80.0))
    assert bed.phase is Phase.VENTING
    assert not bed.of(Over)  # before the vent is seen
    bed.give(Alarm("the pressure did not fall: lift the probe"))
    bed.wait(bed.measurement.policy.vent_patience_s)
    (over,) = bed.of(Over)
    assert "overshoot; the probe was told to vent" in over.failed
    assert "lift the probe" in over.failed


def test_one_that_never_falls_silent_is_not_waited_for(bed):
    """Bytes that mean nothing go on and on; the end came when they did."""
    bed.started()
    bed.give(HostVented("stale link"), State(InstrumentState.VENTING, "host", 60.0))
    bed.give(State(InstrumentState.LOADED, "vented", 0.0))
    for _ in range(100):
        bed.give(Damaged("not a frame", b"A"))
        bed.wait(0.05)
        if bed.of(Over):
            break
    assert "stale link" in bed.of(Over)[0].failed


def test_a_refusal_ends_the_series_with_its_error(bed):
    bed.give(Arm(PLAN), Start())
    error = InstrumentRefusedError("Load was refused: rate")
    (vent, ended) = bed.fail(error)
    assert isinstance(vent, VentProbe)
    assert (ended.ran, ended.cut) == (False, str(error))
    bed.wake()
    (over,) = bed.of(Over)
    assert over.error is error


def test_a_vent_ends_a_rest_and_the_series(bed):
    bed.started()
    bed.give(ENDED, DONE)
    assert bed.phase is Phase.RESTING
    (vent,) = bed.give(Vent("operator"))
    assert vent == VentProbe("operator")
    bed.wake()
    assert "operator" in bed.of(Over)[0].failed
    assert bed.wait(1000.0) == []
    assert len(bed.of(ArmProbe)) == 1


class TestLostLink:
    """The one policy: search, see the vent, wait for somebody's word, rest, take it again."""

    def lost(self, bed, alarm=ALARM):
        bed.started()
        bed.now = 3.0
        bed.give(LinkLost("pulled out"), alarm)
        assert bed.phase is Phase.SEARCHING
        return bed

    def back(self, bed, *events):
        bed.wake()
        assert isinstance(bed.awaited, Reconnect)
        bed.give(LinkRestored(1.0), *events)
        return bed.succeed()

    def test_the_cut_repeat_is_taken_again_as_the_next_cycle(self, bed):
        self.lost(bed)
        self.back(bed, VentConfirmed(1.0))
        assert bed.phase is Phase.INTERRUPTED
        assert isinstance(bed.give(Continue())[0], Refused)  # the alarm is latched
        assert bed.wait(1000.0) == []  # and nothing happens by itself
        assert [type(o) for o in bed.give(Acknowledge(), Continue())] == [
            AcknowledgeAlarm,
            ArmProbe,
        ]
        assert bed.of(ArmProbe)[-1].setup == replace(SETUP, cycle=2)  # the same repeat
        assert bed.measurement.left.repeats == 2
        bed.run()
        bed.give(ENDED, DONE)
        bed.wake()
        assert bed.of(ArmProbe)[-1].setup == replace(SETUP, cycle=3, repeat=2)

    def test_it_rests_before(self, bed):
        self.lost(bed)
        self.back(bed, VentConfirmed(1.0))
        seen = bed.now
        bed.give(Acknowledge(), Continue())
        assert bed.phase is Phase.RESTING
        assert bed.measurement.wake_at == seen + PLAN.rest_s

    def test_what_never_ran_is_not_a_loading(self, bed):
        bed.give(Arm(PLAN), Start(), LinkLost("pulled out"))
        self.back(bed)
        assert bed.of(RepeatEnded) == [RepeatEnded(SETUP, ran=False, cut="pulled out")]
        bed.give(Continue())
        bed.wake()
        assert bed.of(ArmProbe)[-1].setup == SETUP

    def test_the_link_may_be_lost_while_a_command_is_under_way(self, bed):
        bed.give(Arm(PLAN), Start())
        arming = bed.awaited
        bed.give(LinkLost("pulled out"))
        assert bed.give(Failed(arming, LinkError("gone"), link=True)) == []
        self.back(bed)
        assert bed.phase is Phase.INTERRUPTED

    def test_a_link_that_is_lost_behind_the_last_repeat_brings_no_other_one(self, bed):
        bed.give(Arm(replace(PLAN, repeats=1)), Start())
        bed.run()
        bed.give(ENDED, LinkLost("pulled out"))
        self.back(bed, VentConfirmed(1.0))
        assert bed.phase is Phase.READY
        assert [over.failed for over in bed.of(Over)] == [None]

    def test_without_a_vent_that_was_seen_nothing_goes_on(self, bed):
        self.lost(bed)
        self.back(bed)
        assert bed.phase is Phase.CHECKING
        vent, *_ = bed.wake()
        assert isinstance(vent, VentProbe)
        bed.wait(bed.measurement.policy.vent_patience_s)
        assert "no vent was seen" in bed.of(Over)[0].failed
        assert isinstance(bed.give(Continue())[0], Refused)

    def test_attempts_are_ever_rarer_and_end(self):
        bed = self.lost(Bed(Policy(Backoff(0.1, 2.0, 1.0, give_up_s=5.0))))
        times = []
        while bed.phase is Phase.SEARCHING:
            bed.wake()
            times.append(bed.now - 3.0)
            bed.fail(LinkError("no such port"))
        assert times[:6] == pytest.approx([0.1, 0.3, 0.7, 1.5, 2.5, 3.5])
        assert bed.phase is Phase.CLOSED
        assert "gave up after 5 s" in bed.of(Over)[0].failed
        assert len(bed.of(Gone)) == 1

    def test_another_instrument_ends_it(self, bed):
        self.lost(bed)
        bed.wake()
        bed.fail(RemoteProtocolError("another instrument is here now"), final=True)
        assert bed.phase is Phase.CLOSED
        assert "another instrument" in bed.of(Over)[0].failed

    def test_too_many_outages_end_the_series_and_not_the_search(self, bed):
        bed.started()
        for _ in range(bed.measurement.policy.most_outages):
            bed.give(LinkLost("pulled out"))
            self.back(bed)
            bed.give(Continue())
            bed.wake()
            bed.run()
        assert not bed.of(Over)
        bed.give(LinkLost("pulled out"))
        (over,) = bed.of(Over)
        assert "no vent is confirmed" in over.failed
        self.back(bed)
        assert bed.phase is Phase.READY

    def test_something_else_may_be_asked_for_instead(self, bed):
        self.lost(bed)
        self.back(bed, VentConfirmed(1.0))
        bed.give(Acknowledge(), Arm(PLAN))
        assert bed.phase is Phase.ARMING
        assert len(bed.of(Over)) == 1
        assert bed.succeed() == []  # the confirmation of before is not one of this

    def test_a_vent_while_it_is_searched_for_ends_the_series(self, bed):
        self.lost(bed)
        bed.give(Vent("operator"))
        assert len(bed.of(Over)) == 1
        self.back(bed, VentConfirmed(1.0))
        assert bed.phase is Phase.READY

    def test_idle_and_lost_is_no_failure(self, bed):
        bed.give(LinkLost("pulled out"))
        self.back(bed)
        assert bed.phase is Phase.READY
        assert not bed.of(Over)


def test_closing_waits_for_the_vent(bed):
    bed.started()
    first, *_ = bed.give(Close())
    assert isinstance(first, VentProbe)
    bed.wait(1.0)
    assert bed.phase is Phase.CLOSING
    bed.give(State(InstrumentState.LOADED, "vented", 1.0))
    bed.wake()
    assert bed.phase is Phase.CLOSED
    assert len(bed.of(Over)) == len(bed.of(RepeatEnded)) == 1
    assert bed.give(Close()) == []


def test_closing_ends_where_nothing_answers(bed):
    bed.started()
    bed.give(Close())
    bed.wait(bed.measurement.policy.vent_patience_s)
    assert bed.phase is Phase.CLOSED


def test_closing_ends_a_search(bed):
    bed.give(LinkLost("pulled out"), Close())
    assert bed.phase is Phase.CLOSED


def test_giving_up_vents_where_something_may_pull(bed):
    bed.started()
    (vent, _) = bed.give(Abort("enough"))
    assert vent == VentProbe("enough")
    bed.give(State(InstrumentState.LOADED, "vented", 1.0))
    bed.wake()
    assert bed.of(Over)[0].failed == "enough"


def test_what_runs_by_itself_is_vented(bed):
    (vent,) = bed.give(RUNNING)
    assert isinstance(vent, VentProbe)
    bed.give(Arm(PLAN))
    bed.succeed()
    assert isinstance(bed.give(RUNNING)[0], VentProbe)


FAULTS = st.sampled_from(
    [
        LinkLost("pulled out"),
        Alarm("lift the probe"),
        InstrumentFault("pressure", "too much"),
    ]
)
EVENTS = st.sampled_from(
    [
        *(State(s, r, 0.0) for s in InstrumentState for r in ("vent", PROGRAM_END, PROGRAM_DONE)),
        VentConfirmed(1.0),
        LinkRestored(1.0),
        HostVented("stale link"),
        Sample(1, 0.05, 1.0, 0.1, 0),
    ]
)
REQUESTS = st.sampled_from(
    [Arm(PLAN), Start(), Vent("operator"), Acknowledge(), Continue(), Abort("enough"), Close()]
)
ERRORS = st.sampled_from(
    [
        {"error": LinkError("gone"), "link": True},
        {"error": LinkError("no answer")},
        {"error": RemoteProtocolError("another one"), "final": True},
    ]
)


class Anything(RuleBasedStateMachine):
    """Whatever comes in whatever order."""

    def __init__(self):
        super().__init__()
        self.bed = Bed()
        self.confirmed = False  # a Start was asked for since the last Arm
        self.cycles = []
        self.open = 0

    def see(self, outputs):
        for output in outputs:
            match output:
                case ArmProbe(setup):
                    assert self.open == 0
                    self.open = 1
                    self.cycles.append(setup.cycle)
                case StartProbe():
                    assert self.confirmed
                    assert self.open == 1
                    assert isinstance(self.before, ArmProbe)
                case RepeatEnded(setup, ran):
                    assert self.open == 1  # every repeat ends exactly once
                    self.open = 0
                    assert setup.cycle == self.cycles[-1]
                    self.ran = ran
            if isinstance(output, ArmProbe | StartProbe | VentProbe | Reconnect):
                self.before = output

    def give(self, given):
        found = self.bed.give(given)
        self.see(found)
        return found

    @rule(event=EVENTS)
    def event(self, event):
        self.give(event)

    @rule(event=FAULTS)
    def fault(self, event):
        phase = self.bed.phase
        found = self.give(event)
        commands = [o for o in found if not isinstance(o, RepeatEnded | Over | Refused | Gone)]
        if phase not in {Phase.SEARCHING, Phase.CHECKING, Phase.CLOSED}:
            assert isinstance(commands[0], VentProbe)  # before anything else
        assert not any(isinstance(o, ArmProbe | StartProbe) for o in found)

    @rule(request=REQUESTS)
    def request(self, request):
        phase = self.bed.phase
        if isinstance(request, Arm) and phase in {Phase.READY, Phase.INTERRUPTED}:
            self.confirmed, self.cycles = False, []
        if isinstance(request, Start) and phase in {Phase.ARMING, Phase.ARMED}:
            self.confirmed = True
        found = self.give(request)
        if isinstance(request, Vent | Close) and phase is not Phase.CLOSED:
            assert isinstance(found[0], VentProbe)

    @precondition(lambda self: self.bed.awaited is not None)
    @rule()
    def succeeds(self):
        self.give(Succeeded(self.bed.awaited))

    @precondition(lambda self: self.bed.awaited is not None)
    @rule(how=ERRORS)
    def fails(self, how):
        self.give(Failed(self.bed.awaited, **how))

    @rule(seconds=st.sampled_from([0.01, 0.2, 1.0, 6.0, 100.0]))
    def time(self, seconds):
        self.bed.now += seconds
        self.give(None)

    @precondition(lambda self: self.bed.phase is Phase.ARMING)
    @rule()
    def goes_well(self):
        """A whole run, which random events would almost never make."""
        self.give(Succeeded(self.bed.awaited))
        if self.bed.phase is Phase.ARMED:
            self.request(Start())
        for given in (Succeeded(self.bed.awaited), RUNNING, ENDED, DONE):
            self.give(given)

    @invariant()
    def loadings_are_counted(self):
        assert self.cycles == sorted(self.cycles)

    @invariant()
    def nothing_is_left_behind(self):
        if self.bed.phase in {Phase.READY, Phase.CLOSED}:
            assert self.open == 0
            assert self.bed.measurement.left is None

    @invariant()
    def time_goes_on(self):
        waits = {Phase.RESTING, Phase.VENTING, Phase.CLOSING}
        if self.bed.phase in waits:
            assert self.bed.measurement.wake_at is not None


TestAnything = Anything.TestCase
TestAnything.settings = settings(max_examples=100, stateful_step_count=40, deadline=None)


# ---- what only streams ----------------------------------------------------------------------


def streaming():
    bed = Bed()
    bed.measurement = Measurement(controls=False)
    bed.give(State(InstrumentState.IDLE, "connected"), Arm(PLAN), Start())
    bed.give(Succeeded(bed.awaited))
    bed.give(Succeeded(bed.awaited), State(InstrumentState.ARMED, "waits"))
    assert bed.measurement.phase is Phase.STARTING
    return bed


def test_repeats_of_what_only_streams_follow_without_a_rest_or_silence():
    bed = streaming()
    idle = State(InstrumentState.IDLE, PROGRAM_DONE)
    sample = Sample(0, 0.0, 0.0, 0.0, 0)
    first = bed.give(State(InstrumentState.RUNNING, "left zero"), sample, idle, sample)
    assert [type(o) for o in first if not isinstance(o, VentProbe)] == [RepeatEnded, ArmProbe]
    bed.give(Succeeded(bed.awaited))
    bed.give(Succeeded(bed.awaited))
    last = bed.give(State(InstrumentState.RUNNING, "left zero"), idle, sample)
    assert [type(o) for o in last] == [RepeatEnded, Over]  # though readings go on
    assert last[-1].failed is None


def test_nobody_says_of_what_only_streams_that_it_was_told_to_vent():
    bed = streaming()
    bed.give(State(InstrumentState.RUNNING, "left zero"))
    outputs = bed.give(Alarm("540 mbar; it cannot be vented from here: lift the probe"))
    outputs += bed.give(State(InstrumentState.IDLE, "540 mbar"))
    (over,) = [o for o in outputs if isinstance(o, Over)]
    assert over.failed == "540 mbar; it cannot be vented from here: lift the probe"
    bed = streaming()
    bed.give(State(InstrumentState.RUNNING, "left zero"))
    (over,) = [
        o
        for o in bed.give(State(InstrumentState.IDLE, "nothing came for 1 s"))
        if isinstance(o, Over)
    ]
    assert over.failed == "the curve was cut (nothing came for 1 s)"
