"""What can be said of a curve before it is measured."""

from __future__ import annotations

import pytest

from skinlab.acquisition.analysis import Analysis
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.inference.identify import Identifier
from skinlab.inference.result import Identification
from skinlab.report.verdict import Step, judge
from skinlab.tables.store import shipped_grid

RAMP = parse_program("ramp:100@20")


def analysis(tmp_path, table):
    return Analysis(tmp_path, lambda _: None, None, make_identifier=lambda: Identifier(table))


def test_a_curve_of_which_the_database_does_not_speak_is_told_before_it_is_measured(
    tmp_path, table
):
    """It was measured, had no answer, and the next step was to measure it again."""
    beside = analysis(tmp_path, table)
    thick = Setup(2.0, 9.0, RAMP)
    assert beside.complaint(thick) is None  # nothing is known yet
    known = beside.identifier
    assert beside.complaint(Setup(6.0, 1.0, RAMP)) is None
    assert beside.complaint(Setup(6.0, 1.0)) is None
    said = beside.complaint(thick)
    assert said.startswith("no answer: ")
    assert "thickness" in said
    assert known is beside.identifier

    old = analysis(tmp_path, shipped_grid())
    assert old.identifier
    assert old.complaint(Setup(6.0, 1.0, RAMP)) is None
    higher = Setup(6.0, 1.0, parse_program("ramp:200@20"))
    assert old.complaint(higher) == "part of the curve will lie outside the database"


@pytest.mark.parametrize(
    ("flags", "step"),
    [(("outside_database",), Step.CHECK_SETTINGS), ((), Step.MEASURE_AGAIN)],
)
def test_what_has_no_answer_is_not_measured_again_as_it_was(flags, step):
    result = Identification("curve 1", None, "aperture_mm 8, and this is of 6", flags=flags)
    assert judge(result, (), None, partial=False).step is step
