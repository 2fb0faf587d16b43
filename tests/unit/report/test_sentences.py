"""Sentences about a result: each number is that of what the sentence speaks of."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skinlab.curves.curve import Curve, Setup
from skinlab.inference.error_judgement import ErrorModelSummary, PlacementSummary
from skinlab.inference.result import Identification, Value
from skinlab.inference.stored_results import StoredErrors, StoredResult
from skinlab.report.fitted import Fit
from skinlab.report.flags import explanations
from skinlab.report.measured import Judged, Measured
from skinlab.report.text import describe, explain

FLAGS = ("stated_noise_contradicted", "misfit_above_noise")
ZERO = np.zeros(4)


def report_says(residual_um: float, noise_um: float, why: str) -> str:
    """Return what a report says of a misfit."""
    model = StoredErrors("white", {"white_um": noise_um}, why)
    result = StoredResult(flags=FLAGS, rms_um=residual_um, noise_um=noise_um, error_model=model)
    residual_mm, noise_mm = np.full(4, 1e-3 * residual_um), np.full(4, 1e-3 * noise_um)
    curve = Curve("curve 1", Setup(6.0, 1.0), np.arange(4.0), ZERO, ZERO)
    fit = Fit(ZERO == 0.0, ZERO, residual_mm, noise_mm, ZERO, ZERO, {})
    points = explanations(Measured(1, curve, Judged(), result, fit))
    return next(p for p in points if p.startswith("misfit_above_noise"))


@pytest.mark.parametrize(
    ("residual_um", "noise_um", "why", "words"),
    [
        (
            6.0,
            8.0,
            "slow; stated 2 µm, found 8 µm; zeros",
            "more than the stated noise (3.0 times)",
        ),
        (30.0, 3.0, "correlated", "more than the noise (10.0 times)"),
        (30.0, 3.0, "stated 9 µm, found 3 µm", "more than the noise (10.0 times)"),
        (2.0, 3.0, "zeros of placements are off by 30 µm", "more than the noise:"),
    ],
)
def test_a_misfit_is_by_the_noise_that_it_is_more_than(residual_um, noise_um, why, words):
    """The report had said "clearly more than the noise (0.7 times)"."""
    assert words in report_says(residual_um, noise_um, why)
    result = Identification(
        "a.csv", None, None, flags=FLAGS, rms_um=residual_um,
        error_model=ErrorModelSummary("white", {}, why),
    )  # fmt: skip
    said, *more = explain(result, noise_um)
    assert (words.partition("(")[2].rstrip(")") or "clearly more than") in said
    assert ("the stated noise" in said) is ("the stated noise" in words)
    if "found" in why:
        assert more[0].endswith(f"({why.replace('slow; ', '').replace('; zeros', '')})")


def test_a_residual_with_placements_in_it_is_said_to_have_them():
    """A residual of 106 µm was said to be 1.3 times the stated noise, which is 3 µm."""
    size = {"value": 0.2, "low": 0.1, "high": 0.3}
    model = ErrorModelSummary("white", {"white_um": 4.0}, "stated 3 µm, found 4 µm")
    one = Identification(
        "", None, None, files=("a.csv", "b.csv"), flags=FLAGS, rms_um=106.0, error_um=4.6,
        noise_um=4.0, error_model=model, placement=PlacementSummary(size, size, 6),
    )  # fmt: skip
    said = describe(one)
    assert "rms residual 106 µm with what placements did, noise 4 µm" in said
    assert "The residual, less what placements did, is 1.3 times the stated noise: " in said
    alone = describe(dataclasses.replace(one, placement=None))
    assert "rms residual 106 µm, noise 4 µm" in alone
    assert "The residual is 1.3 times the stated noise: " in alone


def test_a_long_unit_is_apart_from_the_interval():
    """It was `1.5 µm/s90 % interval`."""
    values = {
        "X1_MPa": Value(0.03, 0.02, 0.04), "baseline_drift.drift_um_per_s": Value(1.5, 1.4, 1.6),
    }  # fmt: skip
    said = describe(Identification("c.csv", Setup(6.0, 1.0), None, parameters=values))
    assert "0.03 MPa 90 % interval 0.02 to 0.04" in said
    assert "1.5 µm/s 90 % interval 1.4 to 1.6" in said
