"""Evidence of many campaigns: what is weak in each is plain in all, and chance stays chance."""

from __future__ import annotations

import numpy as np
import pytest

from skinlab.studies.campaigns import evidence, pool, section
from skinlab.studies.make_study import COLUMNS

NAMES = ["baseline_drift", "deflection_offset", "tape_slip"]
# Drift and offset look alike; slip is another thing.
GRAM = np.array([[9.0, 6.0, 0.5], [6.0, 16.0, 0.0], [0.5, 0.0, 4.0]])


def campaigns(size, count=50, seed=0, probe="b1"):
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(GRAM)
    for k in range(count):
        score = GRAM @ np.array([size, 0.0, 0.0]) + root @ rng.standard_normal(3)
        yield {
            "campaign": f"{probe} {k}",
            "labels": {"probe": probe, "site": "arm"},
            "error": None,
            "p_value": float(rng.random()),
            "scores": {"names": NAMES, "score": score.tolist(), "gram": GRAM.tolist()},
            "outcome": {
                "verdict": "none",
                "effects": [],
                "gap": {"before_um": 3.0, "after_um": 3.0, "noise_um": 3.0},
            },
        }


def test_an_effect_too_weak_in_each_campaign_is_plain_in_fifty():
    # 0.25 typical sizes are 0.75 standard deviations in one campaign.
    found = evidence(list(campaigns(0.25)))
    held = found.found
    assert [(r["effect"], r["shared_by"], r["group"]) for r in held] == [
        ("baseline_drift", "probe", "b1")
    ]
    assert held[0]["low"] < 0.25 < held[0]["high"]
    alike = next(r for r in found.pooled if r["effect"] == "deflection_offset")
    assert alike["instead_of"] == "baseline_drift"
    assert not any(r["holds"] for r in found.campaigns)
    for name, rows in (("missing_effects", found.campaigns), ("pooled_effects", found.pooled)):
        assert {tuple(row) for row in rows} == {tuple(COLUMNS[f"{name}.csv"].split())}


def test_the_probe_that_has_it_is_named_and_the_other_is_not():
    both = [*campaigns(0.3, seed=1), *campaigns(0.0, seed=2, probe="b2")]
    held = {(r["effect"], r["group"]) for r in evidence(both).found}
    assert ("baseline_drift", "b1") in held
    assert ("baseline_drift", "b2") not in held


def test_with_nothing_there_false_discoveries_are_rare():
    wrong = sum(bool(evidence(list(campaigns(0.0, 20, seed))).found) for seed in range(100, 160))
    assert wrong <= 8  # 5 % of 60 studies, and chance


def test_scatter_between_campaigns_widens_the_interval():
    rng = np.random.default_rng(0)
    size, deviation = rng.normal(0.0, 1.0, 30), np.full(30, 0.1)
    _, error, freedom = pool(size, deviation)
    assert error == pytest.approx(1.0 / np.sqrt(30), rel=0.3)
    assert freedom == 29
    _, exact, _ = pool(np.full(30, 2.0), deviation)
    assert exact == pytest.approx(0.1 / np.sqrt(30))


@pytest.mark.long
def test_the_report_shows_what_holds_and_counts_the_rest():
    found = evidence([*campaigns(0.3, seed=1), *campaigns(0.0, seed=2, probe="b2")])
    shown = section(found)
    rows = {tuple(row[:2]): row[-1] for row in shown.tables[0].rows}
    assert rows["baseline_drift", "probe b1"] == "yes"
    assert all(words == "yes" or "explains it" in words for words in rows.values())
    assert f"{len(found.pooled) - len(rows)} pooled sizes more do not hold" in shown.paragraphs[1]
    assert shown.figures[0].source.startswith("data:image/svg")


def test_campaigns_that_failed_are_listed():
    good = list(campaigns(0.0, 4))
    found = evidence([*good, {"campaign": "bad", "labels": {}, "error": "too short"}])
    assert found.campaigns[-1]["error"] == "too short"
    assert len(found.campaigns) == 5
