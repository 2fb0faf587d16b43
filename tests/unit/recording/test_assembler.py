from __future__ import annotations

import pytest

from drivers.events import Hello, InstrumentState, LinkLost, Sample, State
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.recording.assembler import CurveAssembler
from skinlab.recording.stream import CurveCompleted, CurveStarted

S = InstrumentState
HELLO = Hello("reference", 1, "", "", "", 6.0, 500, 60, 1, 1000, True)
READY = [State(S.LOADED, "", 0.0), State(S.ARMED, "", 0.0), State(S.RUNNING, "started", 0.0)]


def samples(begin, end):
    return [Sample(k, k / 20, 2.0 * k, 0.01 * k, 0) for k in range(begin, end)]


def curves(events):
    """The numbers of the runs that began, and the curves (number, length, partial)."""
    assembler = CurveAssembler()
    assembler.plan(Setup(6.0, 1.0, parse_program("ramp:100@20")))
    messages = [m for event in events for m in assembler.feed(event)]
    return (
        [m.index for m in messages if isinstance(m, CurveStarted)],
        [
            (m.index, len(m.curve), m.curve.partial)
            for m in messages
            if isinstance(m, CurveCompleted)
        ],
    )


@pytest.mark.parametrize("live", [True, False], ids=["live", "replayed"])
def test_a_run_that_goes_on_while_the_link_is_lost_is_cut_there(live):
    """The driver tells of the loss, the bytes of a record do not; the curves are the same."""
    lost = [LinkLost("gone")] if live else []
    again = [HELLO, State(S.RUNNING, "identify", 60.0), *samples(30, 40)]
    events = [
        HELLO, State(S.IDLE, "", 0.0), *READY, *samples(0, 20), *lost, *again,
        State(S.VENTING, "host", 80.0), State(S.LOADED, "vented", 1.0),
        *READY, *samples(0, 101), State(S.VENTING, "program end", 100.0),
    ]  # fmt: skip
    assert curves(events) == ([1, 2], [(1, 20, True), (2, 101, False)])


def test_an_instrument_that_is_found_running_gives_no_curve():
    found = [HELLO, State(S.RUNNING, "identify", 60.0), *samples(30, 60)]
    assert curves([*found, State(S.VENTING, "host", 80.0)]) == ([], [])


def test_a_segment_that_no_program_has_cuts_the_curve():
    past = Sample(20, 1.0, 40.0, 0.2, 7)
    assert curves([HELLO, *READY, *samples(0, 20), past]) == ([1], [(1, 20, True)])
    vent = Sample(20, 1.0, 40.0, 0.2, 1)
    assert curves([HELLO, *READY, *samples(0, 20), vent]) == ([1], [(1, 20, False)])
