"""Campaigns of another program's domes: the same seeds, the same bits; effects mean the same."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.mechanics.effects import effect_names
from skinlab.mechanics.effects.model import Skin, response
from skinlab.mechanics.fem.suction import Geometry

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))

import other_program
from other_program_domes import KINDS, MOST_MBAR, TRUTH, draw

TRUTHS = json.loads(TRUTH.read_text(encoding="utf-8"))
FIRST = {kind: next(t for t in TRUTHS if t["kind"] == kind) for kind in KINDS}


@pytest.mark.parametrize("kind", [k for k in FIRST if k in ("none", *effect_names())])
def test_an_effect_is_the_same_thing_to_both_programs(kind):
    of = FIRST[kind]
    effects = {} if kind == "none" else {kind: of["values"]}
    for aperture, most in MOST_MBAR.items():
        if kind == "aperture_error" and aperture != 6.0:
            continue  # it is of this opening alone
        path = PressurePath.of_program(parse_program(f"ramp:{most:g}@{most / 5:g}"))
        t = np.array([1.0, 3.0, 5.0])
        ours = response(
            Skin(tuple(of["skin"])), effects, Geometry(aperture, of["thickness_mm"]), path, t
        ).deflection_mm
        theirs = other_program.deflections(of, aperture, path, t, 1.0)
        np.testing.assert_allclose(ours, theirs, rtol=4e-3)


def test_a_campaign_is_the_same_each_time_and_another_one_for_another_draw():
    one, again, other = (
        other_program.campaign(TRUTHS[1], 7, draw_)[0].curves[0] for draw_ in (0, 0, 1)
    )
    np.testing.assert_array_equal(one.deflection_mm, again.deflection_mm)
    assert one.deflection_mm.tobytes() != other.deflection_mm.tobytes()


def test_the_skins_are_those_that_are_drawn():
    for of in TRUTHS:
        drawn = [draw(1, of["number"], attempt) for attempt in range(30)]
        assert {k: v for k, v in of.items() if k != "number"} in drawn


def test_figures_count_what_they_say():
    def line(kind, verdict, effects, held=True):
        value = {"low": 0.0, "high": 1.0 if held else 0.1}
        return {
            "kind": kind, "verdict": verdict, "effects": effects, "skin": [0.5, 0.5, 0.5],
            "parameters": dict.fromkeys(("X1_MPa", "X2_MPa", "nu"), value), "cpu_seconds": 2.0,
        }  # fmt: skip

    found = other_program.figures(
        [
            line("none", "none", []),
            line("none", "named", [["tape_slip"]]),
            line("tape_slip", "named", [["tape_slip"]], held=False),
            line("tape_slip", "named", [["deflection_gain"]]),
            line("hypodermis", "ambiguous", [["hypodermis"], ["tape_slip"]]),
            line("two_layers", "unknown", []),
        ]
    )
    assert found["nothing_hidden_named"]["share"] == 0.5
    assert found["names_right"]["share"] == pytest.approx(1 / 3)
    assert found["one_hidden_named"]["share"] == pytest.approx(2 / 3)
    assert found["truth_among_tied"]["share"] == 1.0
    assert found["outside_named"]["share"] == 0.0
    assert found["interval_holds_nu"] == {**found["interval_holds_nu"], "share": 0.5, "of": 2}
