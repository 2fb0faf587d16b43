"""What is said: how likely an explanation is, why none has a name, what was known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from skinlab.discrepancy.adequacy import Place, Residual
from skinlab.discrepancy.candidates import Candidate, Found, Partial, behind_best
from skinlab.discrepancy.discipline import Trial
from skinlab.discrepancy.fit import Fit
from skinlab.discrepancy.odds import behind_words, each_behind
from skinlab.discrepancy.text import partial_words, verdict_words
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.discrepancy.verdict import Verdict

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


def unknown(*candidates, trials=(), implausible="", base_p=1e-9):
    found = Found(candidate([], 0.0, base_p), {}, list(candidates), implausible=implausible)
    return verdict_words(
        SimpleNamespace(verdict=Verdict("unknown", []), found=found, trials=trials)
    )


def test_why_what_would_explain_has_no_name_is_said_with_the_verdict():
    """Nothing explained it, by the verdict, and below stood something that did."""
    good, bad = candidate([ZERO], 5.0), candidate([IN_STEP], 9.0, 1e-9)
    nothing = "Something is missing, and nothing in the library explains it to within the noise."
    assert unknown() == unknown(bad) == nothing
    stood = Trial("size", True, "it changes the fitted curves by 7 µm")
    again = Trial("again", False, "it is not there without c1.csv")
    no = "Something is missing. What would explain it to within the noise is not to be believed: "
    assert unknown(good, trials=(stood, again)) == f"{no}it is not there without c1.csv."
    assert unknown(bad, good) == f"{no}something that leaves more is 20 times likelier."
    assert "too little likelier than the model as it is" in unknown(candidate([ZERO], 0.3))
    pulse = "pulse of 7.5 µm (more than 5 µm is no error)"
    large = (
        "Something is missing. What leaves no more than errors is not to be believed, since these "
        f"are too large: {pulse}."
    )
    assert unknown(good, implausible=pulse) == unknown(implausible=pulse, base_p=0.5) == large
    assert unknown(bad, implausible=pulse) == nothing


@pytest.mark.parametrize(
    ("p_value", "place_p", "said"),
    [
        (1 / 23, 1 / 150_000, "no more than the errors, as they are known so far, could make"),
        (0.5, 0.5, "noise"),
        (1e-9, 1e-9, "more than noise"),
    ],
)
def test_what_is_interrupted_calls_no_place_that_stands_out_noise(p_value, place_p, said):
    place = Place("d8.csv", "unload", (84.0, 99.0), (5.0, 5.8), -127.8, 3.0, place_p)
    base = replace(candidate([]), left=Residual(p_value, (place,), p_value))
    _, first, *rest = partial_words(Partial(base)).split("\n")
    assert first.startswith(f"The model as it is leaves {said} (")
    assert any("-127.8" in line for line in rest) == (place_p < 0.01)
    assert ("Places that stand out all the same:" in rest) == said.startswith("no more")
