"""Programs steered by height: what they may need, and whom they are for."""

from __future__ import annotations

import pytest

from drivers.connection import Connection
from drivers.dialects import get_dialect
from drivers.dose import program_dose
from drivers.errors import LocalProtocolError
from drivers.events import Abilities, Hello, Load, Segment, SegmentKind, State
from drivers.events import InstrumentState as S
from drivers.limits import program_bounds
from sim_device.program import needs

WIRE = get_dialect("reference")
HELLO = Hello("reference", 1, "rig", "1", "7", 6.0, 500, 60, 1, 1000, False)


def until(height, rate, most):
    return Segment(SegmentKind.UNTIL, target_mbar=most, rate_mbar_per_s=rate, height_mm=height)


def ramp(target, rate):
    return Segment(SegmentKind.RAMP, target_mbar=target, rate_mbar_per_s=rate)


HOLD = Segment(SegmentKind.HOLD, duration_s=2)


@pytest.mark.parametrize(
    ("program", "mbar", "suction_s"),
    [((until(0.4, 20, 100),), 100, 5),
     ((until(0.4, 20, 100), HOLD, ramp(0, 20)), 100, 12),
     # From nearly nothing it may have to go all the way again
     ((until(0.4, 20, 100), ramp(100, 10)), 100, 15),
     ((ramp(50, 50), until(0.4, 10, 100), until(0.6, 10, 120)), 120, 13)],
)  # fmt: skip
def test_a_program_needs_what_it_can_need_at_most(program, mbar, suction_s):
    bounds = program_bounds(program)
    assert bounds.max_pressure_mbar == mbar
    assert bounds.max_suction_s == pytest.approx(suction_s)
    # The firmware counts for itself
    assert needs(program) == (mbar, pytest.approx(suction_s))


def test_the_dose_is_that_of_a_height_that_is_never_reached():
    assert program_dose((until(0.4, 20, 100), HOLD)).suction_mbar_s == pytest.approx(250 + 200)


@pytest.mark.parametrize(
    ("segment", "match"),
    [(until(0.0, 20, 100), "height_mm"), (until(-1.0, 20, 100), "height_mm"),
     (until(0.4, 0, 100), "rate"), (until(float("nan"), 20, 100), "height_mm"),
     (Segment(SegmentKind.RAMP, 10, 10, height_mm=1.0), "height_mm must be 0")],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(segment, match):
    with pytest.raises(LocalProtocolError, match=match):
        program_bounds((segment,))


def test_a_rise_to_less_than_there_is_is_refused():
    with pytest.raises(LocalProtocolError, match="below the 120 mbar"):
        program_bounds((ramp(120, 50), until(0.4, 20, 100)))


def connected(*said):
    connection = Connection(WIRE)
    for event in (HELLO, *said, State(S.IDLE, "", 0.0)):
        connection.receive_data(WIRE.encode_event(event))
    while connection.next_event() is not None:
        pass
    return connection


def load(program):
    bounds = program_bounds(program)
    return Load(program, 20, bounds.max_pressure_mbar, bounds.max_suction_s)


def test_only_who_says_that_it_can_is_asked():
    program = load((until(0.4, 20, 100), HOLD))
    frame = connected(Abilities(until=True)).send(program)
    assert WIRE.decode_command(frame)[0] == program
    for said in ((), (Abilities(),)):
        with pytest.raises(LocalProtocolError, match="rig cannot stop at a height"):
            connected(*said).send(program)
    # A new Hello is another instrument, until it says so too
    again = connected(Abilities(until=True), HELLO)
    with pytest.raises(LocalProtocolError, match="cannot stop"):
        again.send(program)


def test_words_that_a_host_does_not_know_mean_nothing():
    frame = WIRE.seal(b"CAN,fly,until,swim")
    assert WIRE.decode_event(frame)[0] == Abilities(until=True)
    assert WIRE.decode_event(WIRE.seal(b"CAN"))[0] == Abilities()


def test_a_height_above_the_opening_is_refused():
    with pytest.raises(LocalProtocolError, match="above the opening"):
        connected(Abilities(until=True)).send(load((until(7.0, 20, 100),)))
