"""A population learned from posteriors, and what it makes of a single curve."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.inference.population import (
    UNLIKE,
    PopulationIdentifier,
    Prior,
    read_prior,
    with_prior,
)
from skinlab.inference.samples import choose, group
from skinlab.studies.population import Posterior, learn, to_toml
from skinlab.studies.reference import read_reference
from skinlab.tables.store import shipped_table

NAMES = ("X1_MPa", "X2_MPa", "nu")
SETUP = Setup(6.0, 1.2, parse_program("ramp:100@20"))
MEAN = np.array([np.log(0.03), np.log(1.5), 0.32])
SD = np.array([0.25, 0.3, 0.03])


def posteriors(people=60, open_by=(0.1, 0.4, 0.08), seed=0):
    """Return what curves that leave so much open say of people of a known population."""
    rng = np.random.default_rng(seed)
    for k in range(people):
        true = MEAN + SD * rng.standard_normal(3) + (0.2 * (k % 2) - 0.1) * np.array([1, 0, 0])
        centre = true + np.array(open_by) * rng.standard_normal(3)
        draws = centre + np.array(open_by) * rng.standard_normal((256, 3))
        draws[:, :2] = np.exp(draws[:, :2])
        yield Posterior(f"P{k}", "ab"[k % 2], 30.0 + k, draws)


def test_the_population_comes_back_though_every_curve_leaves_it_open():
    found = learn(posteriors(300), NAMES, "sha256:x", "test")
    assert found.mean == pytest.approx(MEAN, abs=0.08)
    sd = np.sqrt(np.diag(found.covariance))
    # Not the scatter of the curves' values, which is 0.5 for X2.
    assert sd[:2] == pytest.approx(np.hypot(SD[:2], 0.35 * np.array([0.1, 0.4])), rel=0.25)
    assert found.sites["b"].shift[0] - found.sites["a"].shift[0] == pytest.approx(0.2, abs=0.08)
    assert abs(found.per_decade[0]) < 0.05
    assert found.people == 300


def test_how_people_are_called_does_not_matter():
    """Eight drawn with replacement are now and then few: by other names X2 was 1.6 times wider."""
    few = list(posteriors(8, open_by=(0.1, 0.3, 0.08), seed=7))
    learned = [
        learn([replace(p, subject=f"P{(int(p.subject[1:]) * k) % 8}") for p in few], NAMES, "", "")
        for k in (1, 3, 5, 7)
    ]
    sd = np.sqrt([np.diag(one.covariance) for one in learned])
    assert (sd.max(axis=0) < 1.15 * sd.min(axis=0)).all()


def test_few_people_are_no_population():
    assert learn(posteriors(7), NAMES, "sha256:x", "test") is None


@pytest.fixture(scope="module")
def identifier():
    return Identifier(shipped_table())


@pytest.fixture(scope="module")
def knowing(identifier):
    file = learn(posteriors(100), NAMES, identifier.provenance().model_hash, "test")
    return with_prior(identifier, Prior(file, to_toml(file), "a"))


def curve_of(identifier, parameters, seed=1):
    time_s = np.arange(101) * 0.05
    blank = Curve("c", SETUP, time_s, 20 * time_s, np.zeros(101))
    model = group([choose(blank, ("load",), identifier.database)])[0].model(
        identifier.database, "paper"
    )
    clean = model.deflection_mm(np.array([parameters]))[0]
    noise = 0.003 * np.random.default_rng(seed).standard_normal(101)
    return Curve("c", SETUP, time_s, 20 * time_s, clean + noise)


def deviation_of_x2(result):
    draws = result.uncertainty.draws
    log_x2 = np.log(draws.parameters[:, 1])
    return np.sqrt(draws.weight @ np.square(log_x2 - draws.weight @ log_x2))


@pytest.mark.long
def test_it_narrows_curves_of_the_population(identifier, knowing):
    true = dict(zip(NAMES, (0.032, 1.6, 0.31), strict=True))
    ratios = []
    for seed in range(3):
        curve = curve_of(identifier, tuple(true.values()), seed)
        found, alone = knowing(curve), identifier(curve)
        known = found.parameters
        for name in NAMES:
            value = known[name]
            assert value.low <= value.value <= value.high
            assert value.low * 0.95 <= true[name] <= value.high * 1.05
        ratios.append(deviation_of_x2(found) / deviation_of_x2(alone))
        assert UNLIKE not in found.flags
        assert found.derived["kappa_MPa"] > 0
    assert max(ratios) < 1.0
    assert np.median(ratios) < 0.8
    assert knowing(curve).to_json()["parameters"] == found.to_json()["parameters"]


def test_a_skin_unlike_the_population_is_flagged_and_not_pulled_in(identifier, knowing):
    curve = curve_of(identifier, (0.15, 2.0, 0.3))
    alone, known = identifier(curve), knowing(curve)
    assert UNLIKE in known.flags
    assert known.to_json()["parameters"] == alone.to_json()["parameters"]


def test_a_prior_of_another_model_or_site_is_refused(identifier, knowing, tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(knowing.population.text)
    assert isinstance(with_prior(identifier, read_prior(path)), PopulationIdentifier)
    with pytest.raises(InputError, match="no site 'heel'; expected one of: a, b"):
        read_prior(path, "heel")
    path.write_text(knowing.population.text.replace("sha256:", "sha256:0", 1))
    with pytest.raises(InputError, match="another model"):
        with_prior(identifier, read_prior(path))(curve_of(identifier, (0.03, 1.5, 0.3)))
    path.write_text(knowing.population.text.replace("freedom", "freedoms", 1))
    with pytest.raises(InputError, match="freedoms"):
        read_prior(path)


def test_the_files_of_a_study_are_told_apart(knowing, tmp_path):
    """It was "unknown field `title`; did you mean sites?"."""
    prior, reference = tmp_path / "study.toml", tmp_path / "reference.toml"
    prior.write_text(knowing.population.text)
    inputs = Path(__file__).parents[2] / "data" / "inputs"
    reference.write_text((inputs / "reference.toml").read_text())
    with pytest.raises(InputError, match=r"schema: 'skinlab.reference/1', expected 'skinlab.prior"):
        read_prior(reference)
    with pytest.raises(InputError, match=r"schema: 'skinlab.prior/1', expected 'skinlab.reference"):
        read_reference(prior)


def test_without_site_or_age_it_is_wider(knowing):
    file = knowing.population.file
    one = Prior(file, "", "a", 50.0).moments()[1]
    all_ = Prior(file, "").moments()[1]
    assert (np.diag(all_) > np.diag(one)).all()
