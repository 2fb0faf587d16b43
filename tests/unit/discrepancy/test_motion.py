"""What moves in each curve in its own way: offered once, and known where the model has it."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_effects import RAMPS, measured

from skinlab.discrepancy import motion
from skinlab.discrepancy.adequacy import Residual
from skinlab.discrepancy.adopt import adopted
from skinlab.discrepancy.candidates import Candidate, Found
from skinlab.discrepancy.fit import Fit
from skinlab.discrepancy.motion import find_motion, has_motion
from skinlab.discrepancy.settings import ERRORS
from skinlab.discrepancy.text import describe
from skinlab.discrepancy.unknowns import Known, Unknowns
from skinlab.discrepancy.workflow import explain
from skinlab.mechanics.model_file import BASE
from skinlab.report.missing_effect import render

PULSE, WANDER = "learned_motion", "learned_wander"


@pytest.fixture
def found_of(monkeypatch):
    """Return a model with effects, whose errors show a pulse and are too large by these parts."""

    def made(effects, *, sd_um=0.0, moved_um=8.0, large=("pulse",)):
        known = tuple(Known(PULSE, f"{letter}1_um", 0.0, sd_um) for letter in "sc")
        unknowns = Unknowns(effects, known=known)
        k = len(unknowns)
        fit = Fit(
            unknowns, np.zeros(k), [], 0.0, 0.0, np.zeros((1, k)), settled=True, corrected=False
        )
        look = SimpleNamespace(
            nodes=[SimpleNamespace(sizes_um={"pulse": moved_um})],
            median=lambda size: 1e3 * (size.keywords["name"] in large),
        )
        search = SimpleNamespace(errors=SimpleNamespace(looks=[look]), linear=lambda fit: None)
        monkeypatch.setattr(motion, "_shown", lambda search, found: large[0] if large else "")
        monkeypatch.setattr(motion, "_squares_um2", lambda *_: np.full(3, moved_um**2))
        return search, Found(Candidate(fit, Residual(0.5, (), 0.5), 0.0), {})

    return made


def test_a_motion_that_the_model_has_is_not_offered_again(found_of):
    """It was added to the model that had it: an internal error."""
    assert find_motion(*found_of((PULSE,))) is None
    assert find_motion(*found_of((WANDER, PULSE))) is None
    assert find_motion(*found_of((), large=())) is None


def test_what_the_model_says_that_moves_is_no_error_that_is_too_large(found_of):
    assert has_motion(*found_of((PULSE,), sd_um=8.0))
    assert has_motion(*found_of((PULSE,)))  # of these curves: they say how large it is
    assert not has_motion(*found_of((PULSE,), sd_um=3.0))
    assert not has_motion(*found_of((WANDER,)))
    assert not has_motion(*found_of(()))
    assert not has_motion(*found_of((PULSE,), large=()))
    other = next(n for n in ERRORS.largest_um if n not in ("pulse", "breathing"))
    assert not has_motion(*found_of((PULSE,), large=("pulse", other)))
    assert has_motion(*found_of((PULSE, WANDER), large=("pulse", other)))


@pytest.mark.long
def test_a_motion_is_learned_adopted_and_known(table):
    plan = (RAMPS[0], RAMPS[0], RAMPS[0], RAMPS[1], RAMPS[1], RAMPS[2])
    hidden, rng = measured({}, plan), np.random.default_rng(8)

    def beating(curve, source):
        t, phase = curve.time_s, rng.uniform(0, 2 * np.pi)
        w = curve.deflection_mm + 0.014 * np.sin(2 * np.pi * 1.1 * t + phase)
        return replace(curve, deflection_mm=w, source=source)

    curves = tuple(beating(c, f"sha256:{i}") for i, c in enumerate(hidden.curves))
    first = explain(replace(hidden, curves=curves), table, finite_elements=False)
    assert (first.verdict.name, first.best.effects) == ("learned", (PULSE,))
    now, data = datetime(2026, 1, 1, tzinfo=UTC), {"0.csv": "sha256:0"}
    model = adopted(BASE, first, data=data, database_hash="", now=now)
    elsewhere = tuple(replace(c, source=None) for c in curves)
    for each in (curves, elsewhere):
        again = explain(replace(hidden, curves=each), table, model=model, finite_elements=False)
        assert again.learned_from_these == (each is curves)
        assert again.verdict.name == "none"
        said = json.loads(json.dumps(again.to_json(), allow_nan=False))
        assert f"{PULSE}.s1_um" in first.parameters(first.best)
        assert said["effects"] == []
        assert "Nothing is missing" in describe(again)
        assert "Nothing is missing" in render(again)
