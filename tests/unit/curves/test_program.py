from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinlab.curves.program import (
    Hold,
    Program,
    Ramp,
    Release,
    Rest,
    check_measurable,
    parse_program,
)
from skinlab.errors import InputError


def test_ramp_up_and_down():
    program = parse_program("ramp:100@20,ramp:0@20")
    assert program.segments == (Ramp(100, 20), Ramp(0, 20))
    assert program.phases == ("load", "unload")
    assert program.duration_s == 10
    np.testing.assert_allclose(program.pressure_mbar([0, 2.5, 5, 7.5, 10]), [0, 50, 100, 50, 0])
    assert program.segment_at([0, 5, 5.01, 10]).tolist() == [0, 0, 1, 1]


@pytest.mark.parametrize(
    ("text", "segments"),
    [
        ("mode1:300,2,3", (Ramp(300, 2000), Hold(2), Release(), Rest(3))),
        ("mode2:100@20", (Ramp(100, 20), Ramp(0, 20))),
        ("mode3:100,2@20", (Ramp(100, 2000), Hold(2), Ramp(0, 20))),
        ("mode4:100@20,3", (Ramp(100, 20), Release(), Rest(3))),
    ],
)
def test_classic_modes(text, segments):
    assert parse_program(text).segments == segments
    assert parse_program(f"{text},2").segments == segments * 2


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is not a segment"),
        ("ramp:100", "expected ramp:P@RATE"),
        ("ramp:600@20", "0–500 mbar"),
        ("ramp:-1@20", "0–500 mbar"),
        ("ramp:100@0", "rate must be positive"),
        ("ramp:nan@20", "was not understood"),
        ("ramp:1e999@20", "was not understood"),
        ("ramp:100@20,hold:0", "duration must be positive"),
        ("ramp:100@20,hold:56", "61 s of suction without a pause"),
        ("hold:3", "never leaves zero"),
        ("mode1:300,2", "expected mode1:P,ON,OFF[,N]"),
        ("mode2:100@20,1.5", "whole number"),
        ("mode2:100@20,0", "whole number"),
        ("release:1", "expected release"),
        ("suck:3", "expected one of"),
    ],
)
def test_refuses_with_a_reason(text, says):
    with pytest.raises(InputError) as caught:
        parse_program(text)
    assert says in str(caught.value)


def test_a_pause_ends_the_count_of_suction():
    assert parse_program("ramp:100@20,hold:50,release,rest:5,ramp:100@20,hold:50").duration_s == 115
    assert parse_program("mode2:100@5,5").duration_s == 200  # each cycle comes back to zero


@pytest.mark.parametrize(
    ("text", "longest_s"),
    [
        ("ramp:400@16,ramp:0@16", 50.0),
        ("ramp:100@20,hold:10,ramp:0@10", 25.0),
        ("mode2:100@5,5", 200.0),  # a moment at zero is no pause
        ("ramp:100@20,release,ramp:100@10,ramp:0@10", 20.0),
    ],
)
def test_the_way_down_is_suction(text, longest_s):
    """There were two counts; that of the constructor, under the plainer name, left it out."""
    program = parse_program(text)
    assert program.longest_suction_s == pytest.approx(longest_s)


def test_a_curve_may_be_of_a_program_that_no_probe_is_asked_for():
    assert parse_program("ramp:400@8,ramp:0@8").longest_suction_s == 100.0
    with pytest.raises(InputError, match="100 s of suction without a pause"):
        check_measurable(parse_program("ramp:400@8,ramp:0@8"))


positive = st.floats(0.001, 50, allow_nan=False)


@given(
    st.lists(
        st.one_of(
            st.builds(Ramp, st.floats(0, 500), st.floats(50, 1000)),
            st.builds(Hold, st.floats(0.001, 5)),
            st.just(Release()),
            st.builds(Rest, st.floats(0.001, 5)),
        ),
        min_size=1,
        max_size=6,
    )
)
def test_text_reads_back_as_the_same_program(segments):
    try:
        program = Program((Ramp(10, 100), *segments))
    except InputError:
        return
    assert parse_program(str(program)) == program
