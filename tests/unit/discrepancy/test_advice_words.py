"""What is said, in text and JSON: chances, minutes, the plan that settles it, and places."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from skinlab.discrepancy.adequacy import Place
from skinlab.discrepancy.next_measurement import NextMeasurement, Plan, Planned
from skinlab.discrepancy.outcome import _next_json
from skinlab.discrepancy.text import next_words, where_words

STRETCH, SLIP = ("natural_tension",), ("tape_slip",)
WIDE = Planned(8.0, "ramp:100@60,ramp:0@60", 2, 5.0)
SMALL = Planned(2.0, "ramp:400@60,ramp:0@60", 1, 3.7)
ALONE = Plan((WIDE,), ((STRETCH, 0.4), (SLIP, 0.15)), 0.02, 0.43)
BOTH = Plan((WIDE, SMALL), ((STRETCH, 0.6), (SLIP, 0.32)), 0.01, 0.07)


def words(plan):
    following = NextMeasurement(WIDE.aperture_mm, WIDE.program, (STRETCH, SLIP), 1.1, ALONE, plan)
    found = SimpleNamespace(base=SimpleNamespace(effects=("viscoelasticity",)))
    return next_words(SimpleNamespace(next_measurement=following, found=found))


def test_a_plan_tells_chances_and_minutes():
    first, alone, plan = words(BOTH)
    assert "ramp:100@60,ramp:0@60 with the 8 mm opening, putting the probe on 2 times" in first
    assert "takes 5 min" in alone
    assert "natural_tension 40 %, tape_slip 15 %; of a wrong one 2 %, of no decision 43 %" in alone
    assert plan.startswith("The shortest plan that would settle it: ramp:100@60")
    assert ", then ramp:400@60,ramp:0@60 with the 2 mm opening. It takes 9 min" in plan
    assert BOTH.settled == pytest.approx(0.92)


def test_a_plan_that_is_the_measurement_is_not_told_twice_and_no_sure_one_is_promised():
    assert len(words(ALONE)) == 2
    unsure = Plan((WIDE, SMALL), ((STRETCH, 0.5), (SLIP, 0.2)), 0.05, 0.25)
    assert words(unsure)[2].startswith("No plan is sure; the best: ")


def test_an_explanation_that_is_part_of_another_has_its_name():
    both, own = ("sensor_curve", *STRETCH), "viscoelasticity"
    plan = Plan((WIDE, SMALL), (((own, *both), 0.9), ((own, *STRETCH), 0.05)), 0.0, 0.05)
    assert "sensor_curve and natural_tension 90 %, natural_tension 5 %; of" in words(plan)[2]
    following = NextMeasurement(8.0, WIDE.program, (both, STRETCH), 1.1, plan, plan)
    named = _next_json(following, {own})["expected"]["named"]
    assert [one["effects"] for one in named] == [list(both), list(STRETCH)]


def test_a_place_begins_at_zero_and_not_at_minus_zero():
    place = Place("a.csv", "load", (-0.3, 15.2), (0.0, 0.8), -2.0, 0.3, 1e-9)
    assert where_words(place).startswith("a.csv, load, 0–15 mbar, 0.0–0.8 s: -2.0 µm")


def test_without_advice_nothing_is_said():
    assert next_words(SimpleNamespace(next_measurement=None)) == []
