"""Reference ranges: refused where they do not apply, right where they do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from studies import stiffness_table as table

from skinlab.errors import InputError
from skinlab.studies.reference import place, read_reference, reference_of, to_toml
from skinlab.studies.table import Columns

INPUTS = Path(__file__).parents[2] / "data" / "inputs"
TEXT = (INPUTS / "reference.toml").read_text()
WHERE = {"site": "cheek", "aperture_mm": 2.0, "program": "mode1:450,3,3"}


@pytest.fixture
def reference(tmp_path):
    path = tmp_path / "reference.toml"
    path.write_text(TEXT)
    return read_reference(path)


def test_a_value_has_its_percentile(reference):
    (placed,) = place(reference, {"R0": 0.26}, **WHERE)
    assert (placed.percentile, placed.beyond) == (50.0, "")
    assert placed.words == "at the 50th percentile"
    (narrow,) = place(reference, {"R0": 0.28}, **WHERE, sex="f", age_years=30)
    assert narrow.percentile == 50.0
    assert "women, 20 to 40 years, n = 30" in narrow.range.words
    (low,) = place(reference, {"R0": 0.1}, **WHERE)
    assert low.words == "below the 5th percentile"
    assert place(reference, {"R7": 0.4}, **WHERE) == []


def test_what_is_not_comparable_is_refused(reference):
    for change, words in (
        ({"aperture_mm": 6.0}, "an opening of 6 mm; it has 2 mm"),
        ({"program": "ramp:100@20"}, "the program ramp:100@20"),
        ({"program": None}, r"program not stated \(a campaign.toml states it"),
        ({"site": "heel"}, "no site 'heel'"),
    ):
        with pytest.raises(InputError, match=words):
            place(reference, {"R0": 0.26}, **{**WHERE, **change})


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('licence = "CC0"\n', "", "licence is missing"),
        ("50 = 0.26", "50 = 0.19", "must increase"),
        ("aperture_mm = 2.0", "aperture_mm = 3.0", "no probe has this opening"),
        ("n = 75", "n = 75\ncolour = 1", "unknown field"),
        ("skinlab.reference/1", "x", "expected 'skinlab.reference/1'"),
    ],
)
def test_a_wrong_file_names_its_field(tmp_path, old, new, words):
    path = tmp_path / "wrong.toml"
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        read_reference(path)


def test_one_is_made_of_a_study_one_person_one_value(tmp_path):
    whole = table(people=40)
    made, missing = reference_of(whole, "own")
    assert missing == []
    (one,) = made.range
    assert one.n == 40
    y = np.log(whole.number("X1_MPa"))
    means = [y[whole.text["subject"] == s].mean() for s in np.unique(whole.text["subject"])]
    assert one.percentiles["50"] == pytest.approx(float(np.exp(np.median(means))), rel=1e-5)
    path = tmp_path / "own.toml"
    path.write_text(to_toml(made))
    assert read_reference(path).range[0].percentiles == one.percentiles
    few, missing = reference_of(table(people=10), "own")
    assert few is None
    assert missing == [
        "arm, 6 mm, ramp:100@20, all ages, sex any: no reference range of 10 people; expected at "
        "least 20"
    ]


def test_a_group_of_nobody_is_no_group_that_was_left_out():
    """Of each opening and program there was a sentence for people of 0 to 20 years of whom none."""
    whole = table(people=40)
    ages = np.full(len(whole), "30")
    text = {**whole.text, "age_years": ages}
    aged = Columns(text, (*whole.names, "age_years"))
    made, missing = reference_of(aged, "own", bands=((0.0, 20.0), (20.0, 40.0)))
    assert missing == []
    assert [one.age_years for one in made.range] == [None, (20.0, 40.0)]
