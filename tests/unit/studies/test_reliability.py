"""Components of variance, ICC and limits of agreement, against published examples and libraries."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from studies import stiffness_table as table

from skinlab.studies.agreement import bland_altman, shrout_fleiss
from skinlab.studies.analysis import FACETS
from skinlab.studies.components import components
from skinlab.studies.design import WITHIN, effect
from skinlab.studies.make_study import COLUMNS
from skinlab.studies.reliability import reliability, repeats_for
from skinlab.studies.report import flags_of, people_of
from skinlab.studies.table import Columns

# Shrout and Fleiss 1979, table 2: six targets, four judges.
JUDGES = np.array(
    [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]],
    dtype=float,
)
# Pinheiro and Bates 2000, Rails: travel times of ultrasound, three in each of six rails.
RAILS = np.array([55, 53, 54, 26, 37, 32, 78, 91, 85, 92, 100, 96, 49, 51, 50, 80, 85, 83.0])
# Davies 1947, Dyestuff (lme4): yields of six batches, five preparations each.
DYESTUFF = np.array(
    [1545, 1440, 1440, 1520, 1580, 1540, 1555, 1490, 1560, 1495, 1595, 1550, 1605, 1510, 1560,
     1445, 1440, 1595, 1465, 1545, 1595, 1630, 1515, 1635, 1625, 1520, 1455, 1450, 1480, 1445.0]
)  # fmt: skip
# Bland and Altman 1986: peak flow of 17 people, first reading of each of two meters (l/min).
LARGE = [494, 395, 516, 434, 476, 557, 413, 442, 650, 433, 417, 656, 267, 478, 178, 423, 427]
MINI = [512, 430, 520, 428, 500, 600, 364, 380, 658, 445, 432, 626, 260, 477, 259, 350, 451]


def test_icc_of_shrout_and_fleiss():
    found = {icc.form: icc for icc in shrout_fleiss(JUDGES)}
    published = {
        "ICC(1,1)": 0.17, "ICC(2,1)": 0.29, "ICC(3,1)": 0.71,
        "ICC(1,k)": 0.44, "ICC(2,k)": 0.62, "ICC(3,k)": 0.91,
    }  # fmt: skip
    assert {n: round(found[n].value, 2) for n in published} == published


@pytest.mark.long
def test_icc_intervals_are_pingouins():
    # Slow to import, and every process of the tests imports each file
    import pandas as pd
    import pingouin

    long = pd.DataFrame(
        [(t, j, v) for t, row in enumerate(JUDGES) for j, v in enumerate(row)],
        columns=["target", "judge", "value"],
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table = pingouin.intraclass_corr(long, targets="target", raters="judge", ratings="value")
    interval = next(c for c in table.columns if c.startswith("CI95"))
    for ours, (_, theirs) in zip(shrout_fleiss(JUDGES), table.iterrows(), strict=True):
        assert ours.value == pytest.approx(theirs["ICC"], abs=5e-4)
        assert [ours.low, ours.high] == pytest.approx(list(theirs[interval]), abs=6e-3)


def test_limits_of_agreement_of_bland_and_altman():
    found = bland_altman(np.array(MINI, dtype=float), np.array(LARGE, dtype=float))
    assert found.bias == pytest.approx(-2.1, abs=0.05)
    assert found.sd == pytest.approx(38.8, abs=0.05)
    # The paper takes 2 deviations for 1.96: −79.7 to 75.5.
    assert found.bias - 2 * found.sd == pytest.approx(-79.7, abs=0.1)
    assert [found.bias_low, found.bias_high] == pytest.approx([-22.0, 17.8], abs=0.1)
    assert found.lower_low < found.lower < found.lower_high < found.bias_low
    assert found.upper - found.bias == pytest.approx(found.bias - found.lower)


def test_intervals_of_limits_hold_the_true_limit():
    rng = np.random.default_rng(3)
    held = 0
    for _ in range(400):
        found = bland_altman(np.zeros(12), rng.normal(0.3, 1.0, 12))
        held += found.upper_low <= 0.3 + 1.959964 <= found.upper_high
    assert 0.92 <= held / 400 <= 0.98


@pytest.mark.parametrize(
    ("values", "each", "between", "within"),
    [(RAILS, 3, 24.80547**2, 4.020779**2), (DYESTUFF, 5, 1764.05, 2451.25)],
)
def test_components_of_published_examples(values, each, between, within):
    group = np.repeat(np.arange(6), each)
    found = components(values, [effect("group", group)])
    assert [p.variance for p in found.parts] == pytest.approx([between, within], rel=1e-5)
    for part in found.parts:
        assert part.low < part.variance < part.high
    assert found.mean == pytest.approx(values.mean())
    # An interval of the residual is exact: its mean square is a chi-square.
    from scipy.stats import chi2

    freedom = 6 * (each - 1)
    exact = within * freedom / chi2.ppf([0.95, 0.05], freedom)
    assert [found.parts[1].low, found.parts[1].high] == pytest.approx(exact, rel=0.02)


def crossed(seed=0, lost=0.15):
    """Return values and labels of a small cohort that is neither whole nor nested."""
    rng = np.random.default_rng(seed)
    grid = np.array(
        [(s, i, v, (p + v + s) % 2, p, c)
         for s in range(7) for i in (0, 1) for v in (0, 1) for p in (0, 1) for c in (0, 1)]
    )  # fmt: skip
    grid = grid[rng.random(len(grid)) >= lost]
    s, i, v, o, p, _ = grid.T
    effects = [
        effect("subject", s),
        effect("subject:site", s, i),
        effect("visit", s, v),
        effect("operator", o),
        effect("placement", s, i, v, p),
    ]
    y = rng.normal(0, 0.1, len(s))
    for one, sd in zip(effects, (0.5, 0.3, 0.3, 0.4, 0.2), strict=True):
        y = y + rng.normal(0, sd, one.levels)[one.codes]
    return y, effects


@pytest.mark.long
def test_crossed_and_unbalanced_components_are_those_of_statsmodels():
    y, effects = crossed()
    found = components(y, effects)
    import pandas as pd
    import statsmodels.formula.api as smf

    frame = pd.DataFrame({"y": y, "one": 1, **{f"e{k}": e.codes for k, e in enumerate(effects)}})
    formula = {e.name: f"0 + C(e{k})" for k, e in enumerate(effects)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = smf.mixedlm("y ~ 1", frame, groups="one", vc_formula=formula).fit(reml=True)
    theirs = dict(zip(fit.model.exog_vc.names, fit.vcomp, strict=True)) | {WITHIN: fit.scale}
    for part in found.parts:
        assert part.variance == pytest.approx(theirs[part.name], rel=0.05, abs=1e-4)


def test_no_value_depends_on_unit_or_order():
    y, effects = crossed(1)
    one = components(y, effects)
    other = components(1e-6 * y + 3.0, effects)
    for a, b in zip(one.parts, other.parts, strict=True):
        assert b.variance == pytest.approx(1e-12 * a.variance, rel=1e-3, abs=1e-18)
        assert b.share_high == pytest.approx(a.share_high, rel=1e-3)


@pytest.mark.long
def test_small_cohorts_intervals_hold_the_truth():
    """Of 60 cohorts here; of 200, with more effects, in benchmarks/study.py."""
    true = {"subject": 0.25, "operator": 0.16, WITHIN: 0.04}
    held = dict.fromkeys(true, 0)
    sums = 0
    for seed in range(60):
        rng = np.random.default_rng([9, seed])
        s, o = np.repeat(np.arange(8), 6), np.tile([0, 1, 2], 16)
        effects = [effect("subject", s), effect("operator", o)]
        y = rng.normal(0, 0.2, 48)
        for one, sd in zip(effects, (0.5, 0.4), strict=True):
            y = y + rng.normal(0, sd, one.levels)[one.codes]
        found = components(y, effects, seed=seed)
        for part in found.parts:
            held[part.name] += part.low <= true[part.name] <= part.high
        low, high = found.sum_interval({"operator": 1.0, WITHIN: 1.0})
        sums += low <= 0.2 <= high
    assert min(held.values()) >= 48
    assert sums >= 48


def test_two_probes_that_agree_by_luck_may_still_differ():
    target, probe = np.repeat(np.arange(8), 8), np.tile([0, 1], 32)
    people = effect("subject", target), effect("probe", probe)
    for seed in range(10):
        rng = np.random.default_rng([7, seed])
        y = rng.normal(0, 0.3, 8)[target] + rng.normal(0, 0.1, 64)
        y[probe == 1] += (y[probe == 0] - y[probe == 1]).mean() + 1e-4 * seed / 10
        part = {p.name: p for p in components(y, people, seed=seed).parts}["probe"]
        assert part.low == 0
        # Were probes to scatter by 0.1, so would they agree in one of twenty pairs and more.
        assert math.sqrt(part.high) > 0.1
        assert part.share_high > 0.05


def test_what_cannot_be_told_apart_is_said():
    s = np.repeat(np.arange(6), 4)
    y = np.random.default_rng(0).normal(size=24)
    found = components(
        y, [effect("subject", s), effect("probe", s), effect("visit", np.arange(24))]
    )
    assert [p.name for p in found.parts] == ["subject", WITHIN]
    assert any("probe cannot be separated from subject" in note for note in found.notes)
    assert any("visit cannot be separated from within" in note for note in found.notes)
    with pytest.raises(ValueError, match="all the same"):
        components(np.ones(5), [])


def test_one_curve_a_person_has_no_components_and_a_reason():
    """It was "not enough values to unpack", which is no reason to who reads a study."""
    y = np.random.default_rng(0).normal(size=24)
    with pytest.raises(ValueError, match=r"subject cannot be .* from within: each has one curve$"):
        components(y, [effect("subject", np.arange(24)), effect("site", np.zeros(24, dtype=int))])
    with pytest.raises(ValueError, match="differ in nothing that is stated"):
        components(y, [effect("subject", np.zeros(24, dtype=int))])
    whole = table()
    text = {**whole.text, "operator": np.full(len(whole), "op")}
    rows = (whole.text["visit"] == "1") & (whole.text["placement"] == "1")
    found = reliability(Columns(text, whole.names).where(rows))
    assert not found.components
    (why,) = (note for note in found.notes if "no components of variance" in note)
    assert "each has one curve" in why


def test_the_figures_follow_from_the_components():
    found = reliability(table())
    one = found.of("X1_MPa")
    assert one.scale == "log"
    parts = {p.name: p.variance for p in one.found.parts}
    rows = {
        (r["facet"], r["measure"], r["k"]): r
        for r in found.agreement
        if r["scale"] == "log" and r["by"] == "components"
    }
    error = parts["visit"] + parts[WITHIN]
    assert rows["visit", "SEM", 1]["value"] == pytest.approx(math.sqrt(error))
    assert rows["visit", "MDC95", 1]["value"] == pytest.approx(1.96 * math.sqrt(2 * error))
    icc = rows["visit", "ICC(2,1)", 1]
    assert icc["value"] == pytest.approx(parts["subject"] / (parts["subject"] + error))
    assert icc["low"] < icc["value"] < icc["high"]
    two = math.sqrt(parts["visit"] + parts[WITHIN] / 2)
    assert rows["visit", "SEM", 2]["value"] == pytest.approx(two)
    facet = next(f for f in FACETS if f.name == "placement")
    # The number of repeats gives the wanted change, and one fewer does not.
    wanted = 100 * math.expm1(1.96 * math.sqrt(2 * parts[WITHIN] / 3)) * 1.001
    assert repeats_for(one, wanted, facet) == 3
    visit = next(f for f in FACETS if f.name == "visit")
    assert repeats_for(one, 1.0, visit) is None
    assert {r["facet"] for r in found.bland_altman} == {"operator", "visit"}


def test_every_figure_has_its_column_and_every_column_is_on_the_page():
    """A table of nothing had one column that was called `empty`."""
    whole = table()
    flagged = Columns({**whole.text, "flags": np.full(len(whole), "frozen")}, whole.names)
    found = reliability(flagged)
    made = {
        "components.csv": found.components, "agreement.csv": found.agreement,
        "bland_altman.csv": found.bland_altman, "bland_altman_pairs.csv": found.pairs,
        "trends.csv": found.trends, "people.csv": people_of(flagged, found.of("X1_MPa")),
        "flags.csv": flags_of(flagged),
    }  # fmt: skip
    for name, rows in made.items():
        keys = dict.fromkeys(key for row in rows for key in row)
        assert list(keys) == COLUMNS[name].split(), name
    page = (Path(__file__).parents[3] / "docs/study.md").read_text(encoding="utf-8")
    for name, columns in COLUMNS.items():
        told = ", ".join(f"`{column}`" for column in columns.split())
        assert f"| `{name}` | {told} |" in page


def test_days_are_each_persons_first_and_second_visit():
    whole = table()
    person = [int(name[1:]) for name in whole.text["subject"].tolist()]
    days = np.array(
        [
            f"2026-{1 + k % 9:02d}-{5 * int(v):02d}"
            for k, v in zip(person, whole.text["visit"], strict=True)
        ]
    )
    found = reliability(Columns({**whole.text, "visit": days}, whole.names))
    assert found.bland_altman == reliability(whole).bland_altman
    assert {r["facet"] for r in found.bland_altman} == {"operator", "visit"}
    assert found.components == reliability(whole).components


def test_sessions_without_a_day_are_visits_of_their_own_and_in_no_order():
    dated = table()
    days = np.array([f"2026-01-{10 * int(v):02d}" for v in dated.text["visit"].tolist()])
    whole = Columns({**dated.text, "visit": days}, dated.names)
    undated = (dated.text["subject"] == "P0") | (dated.text["subject"] == "P1")
    names = np.array(
        [f"{s}_{v}.h5" for s, v in zip(whole.text["subject"], days, strict=True)], dtype=str
    )
    some = {n: np.where(undated, names, whole.text[n].astype("U40")) for n in ("file", "visit")}
    found = reliability(Columns({**whole.text, **some}, whole.names))
    assert found.notes[0].startswith("4 imported sessions without the day of the measurement")
    # Each is a visit, as before, whatever it is called; but nobody's first or second.
    assert found.components == reliability(whole).components
    rest = whole.where(~undated)
    for rows in ("bland_altman", "trends"):
        of_visits = [
            [r for r in getattr(one, rows) if "visit" in str(r.get("facet") or r.get("against"))]
            for one in (found, reliability(rest))
        ]
        assert of_visits[0] == of_visits[1]
        assert of_visits[0]


def test_what_is_left_out_or_taken_as_one_is_said():
    whole = table()
    many = np.array([f"op{k}" for k in range(len(whole))])
    text = {**whole.text, "operator": many, "program": np.full(len(whole), "")}
    notes = " ".join(reliability(Columns(text, whole.names)).notes)
    assert "first 45 of 1770 pairs of operators" in notes
    assert "curves of different programs" in notes


def test_a_copied_or_cut_curve_or_one_that_tells_nothing_does_not_count():
    whole = table()
    text = {n: np.concatenate([v, v[:6]]).astype("U40") for n, v in whole.text.items()}
    text["same_as"][-6:-4] = "f0.csv"
    text["partial"][-4:-2] = "true"
    text["flags"][-2:] = "crease not_identifiable:X1_MPa"
    again = reliability(Columns(text, whole.names))
    assert again.components == reliability(whole).components
