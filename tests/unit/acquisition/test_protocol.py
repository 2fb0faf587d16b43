"""A study's protocol: its file, which curve serves which step, what is missing or otherwise."""

from __future__ import annotations

from pathlib import Path

import pytest

from skinlab.acquisition.protocol import (
    condition_complaint,
    conditions_missing,
    decode_protocol,
    demanded,
    read_protocol,
)
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.inference.result import Value
from skinlab.report.protocol import Done, progress, rest_due_s
from skinlab.report.verdict import Step, Use, Verdict

TEXT = """
[study]
title = "Winter forearms"
sites = ["forearm, volar, left", "forearm, volar, right"]

[conditions]
room_temperature_c = [20.0, 24.0]
acclimatisation_min = 15.0
operator = true

[acceptance]
interval_percent = {X1_MPa = 20.0}
scatter_percent = {X1_MPa = 10.0}

[[step]]
name = "wide"
aperture_mm = 6.0
program = "ramp:100@20"
repeats = 2
rest_s = 30.0

[[step]]
aperture_mm = 2.0
program = "ramp:300@60"
rest_before_s = 60.0
"""
GOOD = Verdict(Use.GOOD, "", Step.REPEAT_TO_CONFIRM)
SPOILT = Verdict(Use.NOT, "the probe had no contact", Step.ADVICE)
PROTOCOL = decode_protocol(TEXT, "p.toml")


def curve(name, program="ramp:100@20", aperture=6.0, verdict=GOOD, x1=0.03, wide=1.1, **more):
    setup = Setup(aperture, 1.0, parse_program(program))
    return Done(name, setup, verdict, {"X1_MPa": Value(x1, x1 / wide, x1 * wide)}, **more)


def small(name, **more):
    return curve(name, "ramp:300@60", 2.0, **more)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("repeats = 2", "repeat = 2", "step 1: unknown field `repeat`; did you mean repeats?"),
        ("[acceptance]", "[aceptance]", "unknown field `aceptance`; did you mean acceptance?"),
        ("aperture_mm = 2.0", "aperture_mm = 3.0", "step 2: "),
        ('"ramp:300@60"', '"rump:300@60"', "step 2: "),
        ("repeats = 2", "repeats = 0", "step 1: repeats is 0; expected 1"),
        ("rest_s = 30.0", "rest_s = -1.0", "step 1: rest_s is -1; expected 0"),
        ("[20.0, 24.0]", "[24.0, 20.0]", "conditions.room_temperature_c is (24.0, 20.0); expected"),
        ("{X1_MPa = 20.0}", "{X1 = 20.0}", "acceptance.interval_percent.X1: no such parameter"),
        ('title = "Winter forearms"', "", "`title` is missing"),
        ("volar, right", "volar, left", "a site is named twice"),
    ],
)
def test_what_is_wrong_is_named_by_its_field(tmp_path, old, new, said):
    path = tmp_path / "p.toml"
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(InputError) as refused:
        read_protocol(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert said in str(refused.value)


def test_steps_are_served_in_order_and_curves_beside_them_are_told():
    found = progress(PROTOCOL, [curve("a"), curve("b", aperture=8.0), curve("c"), curve("d")])
    first, second = found.steps
    assert [c.name for c in first.accepted] == ["a", "c"]
    assert found.beside == ("b", "d")
    assert found.next is second
    assert found.words == "protocol step 2 of 2: 2 mm, ramp:300@60"
    assert progress(PROTOCOL, [curve("a"), curve("b"), small("c")]).next is None


@pytest.mark.parametrize(
    ("spoilt", "why"),
    [
        ({"verdict": SPOILT}, "Do not use: the probe had no contact"),
        ({"left_out": "slipped"}, "left out (slipped)"),
        ({"wide": 1.5}, "X1 ± 50 %, not within ± 20 %"),
    ],
)
def test_a_curve_beyond_the_limits_of_acceptance_is_to_be_taken_again(spoilt, why):
    found = progress(PROTOCOL, [curve("a"), curve("b", **spoilt)])
    assert found.steps[0].refused == {"b": why}
    assert found.steps[0].left == 1


def test_repeats_that_scatter_are_remarked():
    found = progress(PROTOCOL, [curve("a"), curve("b", x1=0.05)])
    assert found.steps[0].remarks == ["X1 scatters by 35 % over its repeats, not 10 %"]


def test_a_rest_that_was_too_short_is_remarked_and_one_that_is_due_told():
    curves = [
        curve("a", began_s=0.0, ended_s=5.0),
        curve("b", began_s=36.0, ended_s=41.0),
        small("c", began_s=60.0, ended_s=65.0),
    ]
    found = progress(PROTOCOL, curves)
    assert found.steps[0].remarks == []
    assert found.steps[1].remarks == ["c began after 19 s of rest, not 60 s"]
    two = progress(PROTOCOL, curves[:2])
    assert rest_due_s(two.steps[1], curves[1], 51.0) == 50.0
    assert rest_due_s(two.steps[1], curves[1], 200.0) == 0.0


def test_conditions_are_marked_where_missing_or_outside():
    assert list(demanded(PROTOCOL)) == ["room_temperature_c", "acclimatisation_min", "operator"]
    assert conditions_missing(PROTOCOL, {}) == [
        "not stated: room temperature, acclimatisation, operator"
    ]
    stated = {"room_temperature_c": "26,5", "acclimatisation_min": "20", "operator": "OP-1"}
    assert conditions_missing(PROTOCOL, stated) == ["room temperature 26,5 °C, not 20 to 24"]
    assert condition_complaint("room_temperature_c", "warm") is not None
    assert condition_complaint("operator", "Dr. Anna Schmidt") is not None
    assert condition_complaint("operator", "OP-1") is None


def test_the_page_s_example_is_a_protocol():
    page = (Path(__file__).parents[3] / "docs" / "files.md").read_text(encoding="utf-8")
    text = page.split("## PROTOCOL.toml")[1].split("```toml\n")[1].split("```")[0]
    found = decode_protocol(text, "docs")
    assert [step.repeats for step in found.step] == [3, 1]
    assert len(demanded(found)) == 5
