"""A population as the prior of a measurement: kept in the session, used by its replay."""

from __future__ import annotations

import json

import numpy as np
import pytest

from skinlab.cli.main import run
from skinlab.inference.identify import Identifier
from skinlab.recording.session import read_session
from skinlab.studies.population import Posterior, learn, to_toml
from skinlab.tables.store import shipped_table

NAMES = ("X1_MPa", "X2_MPa", "nu")


def population(folder):
    """Write the study.toml of forty people."""
    rng = np.random.default_rng(3)
    people = []
    for k in range(40):
        mean = np.array([np.log(0.025), np.log(2.5), 0.3]) + rng.normal(0, (0.2, 0.25, 0.03))
        draws = mean + rng.normal(0, (0.1, 0.3, 0.05), (256, 3))
        draws[:, :2] = np.exp(draws[:, :2])
        people.append(Posterior(f"P{k}", "forearm", None, draws))
    found = learn(people, NAMES, Identifier(shipped_table()).provenance().model_hash, "test")
    path = folder / "study.toml"
    path.write_text(to_toml(found))
    return path


@pytest.mark.long
def test_measured_with_a_prior_and_replayed_to_the_same_bits(tmp_path, capsys):
    prior = population(tmp_path)
    common = ["measure", "--port", "sim://?seed=1&speed=20", "--aperture-mm", "6"]
    common += ["--thickness-mm", "1", "--program", "ramp:100@20", "--site", "forearm", "--json"]
    results = []
    for name, more in (("alone", []), ("known", ["--prior", str(prior)])):
        session = tmp_path / f"{name}.h5"
        assert run([*common, *more, "--out", str(session)]) == 0
        document = json.loads(capsys.readouterr().out)
        results.append(document["curves"][0]["parameters"]["X2_MPa"])
    (alone, known) = ((r["high"] - r["low"]) / r["value"] for r in results)
    assert known < 0.8 * alone
    prior.unlink()  # the session has it
    assert run(["replay", str(session), "--speed", "max", "--verify"]) == 0


def test_the_screen_takes_a_prior_and_a_study_or_says_what_is_wrong(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("TEXTUAL_DRIVER", "")
    prior = population(tmp_path)
    told = ["ui", "--sessions", str(tmp_path), "--port", "sim://?seed=1&speed=20"]
    assert run([*told, "--prior", str(prior)]) in (0, 3)
    (saved,) = tmp_path.glob("*.h5")
    assert read_session(saved).meta["identification"]["prior"]["toml"] == prior.read_text()
    assert run([*told, "--prior", str(tmp_path / "none.toml")]) == 3
    assert run([*told, "--study", str(tmp_path)]) == 3
    assert "components.csv: cannot be read" in capsys.readouterr().err
