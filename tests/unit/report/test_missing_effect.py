"""The report of what is missing."""

from __future__ import annotations

import pytest
from shown import outcome as named_outcome

from skinlab.discrepancy.adequacy import Place, Residual
from skinlab.discrepancy.text import parameter_table, stated_noise_words, values_words
from skinlab.discrepancy.verdict import Verdict
from skinlab.inference.error_judgement import ErrorModelSummary
from skinlab.report import missing_effect
from skinlab.report.missing_effect import draw_residuals, render
from skinlab.report.pictures import style
from skinlab.tui.missing import outcome_rows, verdict_lines

PLACE = Place("curve 1", "load", (10.0, 20.0), (0.5, 1.0), 30.0, 2.0, 1.0)


@pytest.fixture
def outcome(monkeypatch):
    """What names a lag."""
    monkeypatch.setattr(missing_effect, "to_data_uri", lambda *_: "data:image/png;base64,AA==")
    found = named_outcome()
    found.found.signatures = {}
    return found


@pytest.fixture
def unknown(outcome):
    base = outcome.found.base
    base.adequate, base.left = False, Residual(1e-9, (), 1e-9)
    outcome.verdict, outcome.best = Verdict("unknown", []), base
    return outcome


def fits_drawn(outcome):
    with style():
        axes = draw_residuals(outcome).axes
    return [text.get_text() for text in axes[0].get_legend().get_texts()]


def test_a_named_effect_has_a_before_and_an_after(outcome):
    text = render(outcome)
    assert "The change is the bias that the missing effect caused" in text
    assert "before and after the effect was added" in text
    heads, rows = parameter_table(outcome)
    assert heads == ["parameter", "before", "after"]
    assert rows[0] == ("X1 (MPa)", "0.02  (0.019 to 0.021)", "0.026  (0.024 to 0.029)")
    assert fits_drawn(outcome) == ["before", "after"]


def test_where_nothing_is_found_nothing_has_changed(unknown):
    """Two equal columns were "the bias that the missing effect caused"."""
    text = render(unknown)
    assert "bias" not in text
    assert "the effect was added" not in text
    assert "Residuals of every curve against time, of the model as it is" in text
    assert parameter_table(unknown) == (
        ["parameter", "value"],
        [("X1 (MPa)", "0.02  (0.019 to 0.021)")],
    )
    assert fits_drawn(unknown) == ["the model as it is"]


def test_explanations_that_are_tied_have_values_of_their_own(outcome):
    """The first one's were "after", and "the bias that the missing effect caused"."""
    best, second = outcome.found.candidates
    outcome.verdict, outcome.where = Verdict("ambiguous", [best, second]), [PLACE]
    of_second = {"X1_MPa": {"value": 0.04, "low": 0.03, "high": 0.05}}
    known = outcome.parameters
    outcome.parameters = lambda one: of_second if one is second else known(one)
    text = render(outcome, "forearm <left>")
    assert "forearm &lt;left&gt;: skinlab missing-effect report" in text
    assert "bias" not in text
    assert "Which of these is true is open, and so are the values" in text
    assert "no place stands out by itself" in text
    assert "against time, of the model as it is, and with pressure_lag" in text
    heads, rows = parameter_table(outcome)
    assert heads == ["parameter", "before", "with pressure_lag", "with baseline_drift"]
    assert rows[0][2:] == ("0.026  (0.024 to 0.029)", "0.04  (0.03 to 0.05)")
    assert fits_drawn(outcome) == ["before", "with pressure_lag"]
    screen = "\n".join("".join(text for text, _ in row) for row in outcome_rows(outcome, 80))
    assert "which explanation is true is open" in screen
    assert "with baseline_drift" in screen
    assert " after" not in screen

    outcome.verdict = Verdict("ambiguous", [best, second, best, second])
    assert "by the first 3 of 4 that are tied" in values_words(outcome)


def test_noise_that_is_more_than_stated_is_told(outcome):
    """Of 3 µm stated and 29 µm found it was "the model explains them to within the noise"."""
    for record in outcome.found.records:
        record.noise_is_stated, record.coarse = True, 4  # each the mean of four readings
    for white_um, told in ((7.9, False), (8.1, True)):
        outcome.error_model = ErrorModelSummary("white", {"white_um": white_um}, "")
        assert bool(stated_noise_words(outcome)) is told
    said = "Each reading is off by 8.1 µm, where a noise of 4 µm is stated"
    assert said in render(outcome)
    assert said in "\n".join(verdict_lines(outcome))
    outcome.found.records[0].noise_is_stated = False
    assert not stated_noise_words(outcome)


def test_where_nothing_is_missing_no_explanation_is_the_best(unknown):
    """A zero that was off was "the best", of a campaign where nothing was missing."""
    assert "Explanations that were fitted" in render(unknown)
    unknown.verdict = Verdict("none", [])
    assert "Explanations that were fitted" not in render(unknown)
