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
from skinlab.discrepancy.heldout import HeldOut
from skinlab.discrepancy.odds import behind_words, each_behind
from skinlab.discrepancy.outcome import Outcome
from skinlab.discrepancy.text import (
    _parameter_lines,
    doubt_words,
    gap_words,
    lead_words,
    learned_words,
    partial_words,
    verdict_words,
)
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


def test_what_is_less_likely_than_none_is_no_small_number_of_times_likelier():
    """An interrupted search said "2.4e-05 times likelier than none at all"."""
    base, one = candidate([]), candidate([ZERO], -3.0)
    *_, last = partial_words(Partial(base, [one])).split("\n")
    assert last.split(maxsplit=1) == [ZERO, "1,000 times less likely than none at all"]


def test_what_is_ahead_is_never_said_to_be_behind():
    assert behind_words(-11.0) == "more than 10,000 times likelier"
    assert behind_words(0.0) == "the best"
    assert behind_words(2.0) == "100 times less likely"


def unknown(*candidates, trials=(), implausible="", base_p=1e-9, kinds=()):
    found = Found(candidate([], 0.0, base_p), {}, list(candidates), implausible=implausible)
    return verdict_words(
        SimpleNamespace(
            verdict=Verdict("unknown", []), found=found, trials=trials, unlike_model=(), kinds=kinds
        )
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
    assert unknown(kinds=("sensor_curve", "time")) == (
        f"{nothing} Smooth functions of several kinds explain it equally well: sensor curve, time."
    )
    pulse = "pulse of 7.5 µm (more than 5 µm is no error)"
    large = (
        "Something is missing. What leaves no more than errors is not to be believed, since these "
        f"are too large: {pulse}."
    )
    assert unknown(good, implausible=pulse) == unknown(implausible=pulse, base_p=0.5) == large
    assert unknown(bad, implausible=pulse) == nothing


def test_what_may_be_chance_is_said_with_how_often_chance_does_it():
    found = Found(candidate([], 0.0, 1e-4), {}, [candidate([ZERO], 0.5, 1e-4)])
    none = SimpleNamespace(verdict=Verdict("none", []), found=found, trials=(), unlike_model=())
    said = verdict_words(none)
    assert said.startswith("Nothing is missing, as far as these data tell: ")
    assert "chance does so once in 10,000" in said
    # What stood all trials but for its size is no chance: it is too small to matter.
    none.trials = (Trial("size", False, "it changes the fitted curves by 0.3 µm"),)
    assert "though these data show more than noise" in verdict_words(none)


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


def doubted(*failed, base_p, effects=(ZERO,), would=1.3):
    """What is said of one that failed these trials; X1 is 1 (0.9 to 1.1), or `would` with it."""
    one = candidate(effects, 6.1)
    found = Found(candidate([], 0.0, base_p), {}, [one])
    trials = [Trial(name, name not in failed, f"about {name}") for name in ("size", "again")]
    outcome = SimpleNamespace(
        # As it comes out of the cache: another object than that among the candidates.
        verdict=Verdict("none", []), found=found, best=found.base, trials=trials,
        doubted=replace(one),
        learned=None,
        unlike_model=(),
        parameters=lambda c: {
            "X1_MPa": {"value": would if c.effects else 1.0, "low": 0.9, "high": 1.1}
        },
    )  # fmt: skip
    outcome.not_ruled_out = Outcome.not_ruled_out.fget(outcome)
    return verdict_words(outcome), doubt_words(outcome)


def test_what_is_there_and_small_is_not_said_to_be_absent():
    """A preload of 4 mbar moved curves by 0.4 µm, X2 by a quarter, and was 10⁶ times likelier."""
    verdict, (why, size, if_there) = doubted("size", base_p=0.5)
    assert verdict == doubted("size", base_p=1e-9)[0]
    assert verdict.startswith("Nothing is missing that would change the curves by 1 µm")
    assert (why, size) == (f"{ZERO} is too small for a name, because:", "  about size")
    assert if_there == (
        "If it is there all the same, other values are right: X1 1.3  (0.9 to 1.1)."
    )
    verdict, (why, again) = doubted("again", base_p=0.5, would=1.05)
    assert verdict.startswith("Nothing has a name: the model explains the data")
    assert (why, again) == (
        f"{ZERO} seemed to be there and gets no name, because:",
        "  about again",
    )


def test_of_several_effects_it_speaks_as_of_several():
    both = ("contact_preload", ZERO)
    _, (small, _, if_there) = doubted("size", base_p=0.5, effects=both)
    assert small == f"contact_preload and {ZERO} are too small for a name, because:"
    assert if_there.startswith("If they are there all the same, other values are right: ")
    _, (why, *_) = doubted("again", base_p=0.5, effects=both)
    assert why == f"contact_preload and {ZERO} seemed to be there and get no name, because:"
    best, second = candidate(both, 6.0), candidate([ZERO], 4.0)
    found = Found(candidate([]), {}, [best, second])
    named = SimpleNamespace(verdict=Verdict("named", [best]), best=best, found=found)
    assert lead_words(named)[0].startswith("They are 100 times likelier than the next, ")
    named.best, named.found = second, Found(candidate([]), {}, [second])
    assert lead_words(named)[0].startswith("It is 10,000 times likelier than none at all, ")


@pytest.mark.parametrize(
    ("evidence", "said"),
    [(1.12, "13 times likelier"), (-1.0, "10 times less likely"), (-1.5, None)],
)
def test_what_is_not_ruled_out_is_told_where_nothing_is_missing(evidence, said):
    """A preload of 13 mbar, 13 times likelier, was not mentioned: X2 was four times too large."""
    one, other = candidate(["contact_preload"], evidence), candidate([ZERO], 1.0, p_value=1e-9)
    found = Found(candidate([]), {}, [one, other])
    values = {id(found.base): 1.0, id(one): 1.3, id(other): 1.3}
    outcome = SimpleNamespace(
        verdict=Verdict("none", []), found=found, best=found.base, trials=(), doubted=None,
        learned=None,
        parameters=lambda c: {"X1_MPa": {"value": values[id(c)], "low": 0.9, "high": 1.1}},
    )  # fmt: skip
    outcome.not_ruled_out = Outcome.not_ruled_out.fget(outcome)
    with_it = "With it, other values are right: X1 1.3  (0.9 to 1.1)."
    expected = [f"contact_preload is not ruled out ({said} than none at all). {with_it}"]
    assert doubt_words(outcome) == (expected if said else [])


def test_what_is_learned_does_not_hide_effects_that_explain_as_well():
    """Three of the library were 3 to 13 times less likely, and "no effect explains the gap"."""
    learned, near, far = (
        candidate([name], e)
        for name, e in (("learned_opening", 7.8), ("aperture_error", 7.4), (ZERO, 6.3))
    )

    def said(*others):
        found = Found(candidate([], 0.0, 1e-9), {}, [learned, *others])
        family = SimpleNamespace(own_of_each=False)
        one = SimpleNamespace(share_of_gap=1.0, family=family, nearest=())
        return learned_words(SimpleNamespace(best=learned, found=found, learned=one))

    taken = "a smooth function was learned, which takes 100 % of it away."
    assert said(far) == [f"No effect of the library explains the gap as well; {taken}"]
    assert said(near) == [
        "These explain it as well, but did not stand the trials of a name: aperture_error; " + taken
    ]


def test_columns_of_parameters_stand_apart():
    """It had been "learned_sensor_curve c1 (µm)-101.9  (-110.2 to -93.61)"."""
    names = ("X1_MPa", "learned_sensor_curve.c1_um")
    value = {"value": -1.0189e-05, "low": -1.1021e-05, "high": -9.3613e-06}
    base = candidate([])
    outcome = SimpleNamespace(
        found=Found(base, {}, []), best=candidate(["learned_sensor_curve"]),
        verdict=Verdict("learned", [base]),
        parameters=lambda c: dict.fromkeys(names[: 1 + len(c.effects)], value),
    )  # fmt: skip
    said = "-1.019e-05  (-1.102e-05 to -9.361e-06)"
    head, first, second = _parameter_lines(outcome)
    column, after = first.index("-"), first.rindex(said)
    assert first == f"  {'X1 (MPa)':<{column - 2}}{said}  {said}"
    assert second == f"  {'learned_sensor_curve c1 (µm)':<{after - 2}}{said}"
    assert column == 2 + len("learned_sensor_curve c1 (µm)") + 2
    assert head.split() == ["before", "after"]
    assert column < head.index("before") < after < head.index("after")


@pytest.mark.parametrize(
    ("placement", "slow"),
    [(None, "errors that last"), (SimpleNamespace(), "placements and errors that last")],
)
def test_what_errors_that_last_did_is_not_put_down_to_placements(placement, slow):
    """Of 20 µm 9 were "errors of placement", where a campaign says that there is none."""
    gap = HeldOut(10.9, 2.0, 2.0, ("c2.csv",), 20.3)
    outcome = SimpleNamespace(
        gap_before=gap, gap_after=gap, placement=placement, verdict=Verdict("none", [])
    )
    assert gap_words(outcome) == (
        "Gap on conditions held out of the fit: 20.3 µm. "
        f"Less what {slow} may have done: 10.9 µm (5.5 × noise)."
    )
