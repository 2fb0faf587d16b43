"""What is said of an outcome: how likely each explanation is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinlab.discrepancy.adequacy import Residual
from skinlab.discrepancy.candidates import Candidate, behind_best
from skinlab.discrepancy.fit import Fit
from skinlab.discrepancy.odds import behind_words, each_behind
from skinlab.discrepancy.unknowns import Unknowns

MOTION, IN_STEP, ZERO = "learned_motion", "periodic_motion", "deflection_offset"


def candidate(effects, evidence=0.0, p_value=0.5):
    unknowns = Unknowns(tuple(effects))
    k = len(unknowns)
    fit = Fit(unknowns, np.zeros(k), [], 0.0, 0.0, np.zeros((1, k)), settled=True, corrected=False)
    return Candidate(fit, Residual(p_value, (), p_value), evidence)


def test_a_motion_that_counts_with_the_errors_is_compared_with_nothing():
    """What is behind it had been 7e-12 times less likely."""
    ones = [candidate([MOTION]), candidate([IN_STEP], 11.2), candidate([ZERO], 10.2)]
    behind = behind_best(ones, ())
    assert behind == [None, 0.0, pytest.approx(1.0)]
    first, second, third = each_behind(behind)
    assert first == "counts with the errors, and is not compared"
    assert (second, third) == ("the best of the others", "10 times less likely")
    # The model's own motion is in all of them.
    own = [candidate([MOTION, IN_STEP], 3.0), candidate([MOTION, ZERO], 1.0)]
    assert each_behind(behind_best(own, {MOTION})) == ["the best", "100 times less likely"]
    assert behind_best([replace(ones[0], log10_evidence=2.0)], ()) == [None]
    assert behind_best([], ()) == []


def test_what_is_ahead_is_never_said_to_be_behind():
    assert behind_words(-11.0) == "more than 10,000 times likelier"
    assert behind_words(0.0) == "the best"
    assert behind_words(2.0) == "100 times less likely"
