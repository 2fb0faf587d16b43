"""Has a skin changed: placements, visits and a control site count."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.stats import t as t_distribution

from skinlab.cli.main import cli
from skinlab.curves.curve import Setup
from skinlab.errors import InputError
from skinlab.inference.error_judgement import PlacementSummary
from skinlab.inference.posterior import Draws
from skinlab.inference.result import Identification, Value
from skinlab.studies.change import Side, changes, in_words

CONDITIONS = frozenset({(6.0, "ramp:100@20")})
HEAD = "condition,quantity,scale,component,variance,freedom\n"
WORDS = '"6 mm, ramp:100@20",X1_MPa,log'


def side(x1, placements=1, sd=0.01, seed=0, learned=None, operator="a", conditions=CONDITIONS):
    """Return a session; `learned` is the scatter of placements that its curves show together."""
    values = np.exp(np.log(x1) + sd * np.random.default_rng(seed).standard_normal((4000, 1)))

    class Left:
        draws = Draws(values, values, np.full(4000, 1 / 4000), np.zeros(4000), 0)

    found = None
    if learned is not None:
        found = PlacementSummary(dict.fromkeys(("value", "low", "high"), learned), {}, placements)
    answer = Identification(
        "s.h5", Setup(6.0, 1.0), None, parameters={"X1_MPa": Value(x1)}, uncertainty=Left,
        placement=found,
    )  # fmt: skip
    return Side(answer, placements, operator, "", conditions)


def verdict(*sides, **options):
    (one,) = changes(*sides, **options).parameters
    return one


def test_a_difference_that_placing_anew_explains_is_no_change():
    # 10 %: ten times the curves' own noise, and less than a placement's.
    one = verdict(side(0.030), side(0.033), placement_scatter=0.08)
    assert one.verdict == "not_shown"
    assert one.smallest == pytest.approx(1.96 * np.sqrt(2 * (0.08**2 + 0.01**2)), rel=0.02)
    assert verdict(side(0.03), side(0.05), placement_scatter=0.08).verdict == "changed"
    assert verdict(side(0.03), side(0.033, seed=1), placement_scatter=0.2).verdict == "cannot_say"


def test_more_placements_show_smaller_changes():
    sizes = [verdict(side(0.03, n), side(0.03, n), placement_scatter=0.08).smallest for n in (1, 4)]
    assert sizes[1] == pytest.approx(sizes[0] / 2, rel=0.05)


def test_the_sessions_own_repeats_say_how_much_placements_scatter():
    found = [
        verdict(side(0.03, 5, learned=s), side(0.03, 5, learned=s)).smallest for s in (0.25, 0.02)
    ]
    assert found[0] > 2 * found[1]


def test_what_placements_do_counts_once():
    """Curves that were fitted together have it in their interval, where it was added again."""
    one_sd, scatter, n = 0.01, 0.06, 4
    wide = np.hypot(one_sd, scatter / np.sqrt(n))
    together = side(0.03, n, sd=wide, learned=scatter)
    found = verdict(together, together, placement_scatter=scatter).smallest
    assert found == pytest.approx(1.96 * np.sqrt(2) * wide, rel=0.03)
    # None at all, stated: the curves' own share is left.
    without = side(0.03, n, sd=one_sd, learned=0.0)
    smallest = verdict(without, without, placement_scatter=0.0).smallest
    assert smallest == pytest.approx(1.96 * np.sqrt(2) * one_sd, rel=0.03)


@pytest.fixture
def study(tmp_path):
    rows = [("subject", 0.09, 20), ("visit", 0.0025, 20), ("operator", 0.01, 2)]
    rows += [("within", 0.0064, 40), ("of which identification", 0.0004, "")]
    text = "".join(f"{WORDS},{name},{v},{f}\n" for name, v, f in rows)
    (tmp_path / "components.csv").write_text(HEAD + text)
    return tmp_path


def test_a_study_says_what_a_visit_and_another_operator_add(study):
    same = verdict(side(0.03), side(0.03), study=study)
    other = verdict(side(0.03), side(0.03, operator="b"), study=study)
    variance = 2 * 0.0025 + 2 * (0.0064 - 0.0004) + 2 * 0.01**2
    # 20 degrees of freedom behind the visit, 40 behind the placement: 60 behind their sum.
    assert same.smallest == pytest.approx(2.0 * np.sqrt(variance), rel=0.03)
    # Two operators' difference is two degrees of freedom: its size is hardly known.
    variance += 2 * 0.01
    parts = np.array([[2 * 0.0025, 20], [2 * 0.006, 40], [2 * 0.01, 2]]).T
    freedom = parts[0].sum() ** 2 / (parts[0] ** 2 / parts[1]).sum()
    reach = t_distribution.ppf(0.975, freedom) * np.sqrt(variance)
    assert other.smallest == pytest.approx(reach, rel=0.03)
    found = changes(side(0.03), side(0.03), study=study)
    assert "components of variance" in found.basis
    assert "smallest change that could have been shown" in in_words(found)[0]


def test_a_study_that_is_none_is_said(tmp_path):
    with pytest.raises(InputError, match=r"components.csv: cannot be read"):
        verdict(side(0.03), side(0.03), study=tmp_path)
    (tmp_path / "components.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match=r"expected the components.csv of a study"):
        verdict(side(0.03), side(0.03), study=tmp_path)


def test_a_control_site_takes_away_what_the_day_does(study):
    day = 1.25  # all skin is a quarter stiffer that day
    alone = verdict(side(0.03, 4), side(0.03 * day, 4), study=study)
    paired = verdict(
        side(0.03, 4),
        side(0.03 * day, 4),
        study=study,
        control=(side(0.04, 4), side(0.04 * day, 4)),
    )
    assert alone.verdict == "changed"
    assert paired.verdict == "not_shown"
    assert paired.change == pytest.approx(0.0, abs=1e-3)


def in_a_valley(*factors):
    """Return sides whose X1 and X2 trade off: what they do together is known ten times better."""
    rng = np.random.default_rng(0)
    valley = rng.standard_normal((4000, 1)) * np.array([[0.2, -0.4]])
    sides = []
    for factor in factors:
        values = (
            np.array([0.03, 1.5]) * factor * np.exp(valley + 0.01 * rng.standard_normal((4000, 2)))
        )

        class Left:
            draws = Draws(values, values, np.full(4000, 1 / 4000), np.zeros(4000), 0)

        found = {"X1_MPa": Value(0.03), "X2_MPa": Value(1.5)}
        answer = Identification("s", Setup(6.0, 1.0), None, parameters=found, uncertainty=Left)
        sides.append(Side(answer, 2, "", "", CONDITIONS))
    return sides


def test_what_intervals_of_x1_explain_is_no_scatter_less_of_the_common_factor(tmp_path):
    # Placing anew scatters by 8 %; the intervals of X1 are as wide, along the valley.
    rows = [("visit", 0.0001, 20), ("within", 0.0064, 40), ("of which identification", 0.0062, "")]
    lines = [
        f'"6 mm, ramp:100@20",{q},log,{r[0]},{r[1]},{r[2]}'
        for q in ("X1_MPa", "X2_MPa")
        for r in rows
    ]
    (tmp_path / "components.csv").write_text(HEAD + "\n".join(lines))
    whole = changes(*in_a_valley(1.0, 1.12), study=tmp_path).stiffness
    assert whole.verdict == "not_shown"
    assert whole.smallest >= 2.0 * np.sqrt(2 * (0.0001 + 0.0064 / 2))


def test_a_common_factor_is_told_where_no_single_stiffness_is():
    judged = changes(*in_a_valley(1.0, 1.5), placement_scatter=0.06)
    assert [one.verdict for one in judged.parameters] == ["cannot_say", "cannot_say"]
    assert judged.stiffness.verdict == "changed"
    assert judged.stiffness.change == pytest.approx(np.log(1.5), abs=0.05)
    assert judged.to_json()["stiffness"]["change"] == pytest.approx(50.0, abs=5.0)


def test_other_openings_are_refused(study):
    two = frozenset({(2.0, "ramp:100@20")})
    with pytest.raises(InputError, match="expected the same openings"):
        changes(side(0.03), side(0.03, conditions=two))
    with pytest.raises(InputError, match="control site measured differently"):
        changes(side(0.03), side(0.03), control=(side(0.03), side(0.03, conditions=two)))
    with pytest.raises(InputError, match="expected the same opening and program"):
        changes(side(0.03, conditions=two), side(0.03, conditions=two), study=study)


def test_a_scatter_that_is_none_is_refused():
    done = CliRunner().invoke(
        cli, ["compare", "a.h5", "b.h5", "--placement-scatter", "much"], standalone_mode=False
    )
    assert "expected auto, or 0 to below 1" in str(done.exception)
