"""A population as prior: it narrows, it gives way, and a session replays with it."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import as_file, files

import numpy as np
import pytest

import skinlab
from skinlab.acquisition.replay import identifier_of
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.inference.population import (
    SCHEMA,
    UNLIKE,
    Prior,
    PriorFile,
    coordinates_of,
    decode_prior,
    to_coordinates,
    with_prior,
)
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials import get_law
from skinlab.recording.recorder import identification_settings
from skinlab.recording.session import read_session
from skinlab.studies.population import to_toml
from skinlab.tables.store import shipped_table

TRUE = np.array([0.03, 1.2, 0.3])
SETUP = Setup(6.0, 1.2, parse_program("ramp:100@20"))
NAMES = get_law().names


@pytest.fixture(scope="module")
def identifier():
    return Identifier(shipped_table())


@pytest.fixture(scope="module")
def curve():
    time_s = np.arange(0.0, 5.01, 0.1)
    pressure = 20.0 * time_s
    table = shipped_table()
    model = table.model(Geometry(6.0, 1.2), pressure)
    noise = np.random.default_rng(1).normal(0.0, 2e-3, len(time_s))
    return Curve("c.csv", SETUP, time_s, pressure, model.deflection_mm(TRUE[None])[0] + noise)


def prior_of(identifier, middle, sd=(0.15, 0.15, 0.02)):
    kinds = coordinates_of(NAMES)
    file = PriorFile(
        schema=SCHEMA,
        parameters=list(NAMES),
        coordinates=kinds,
        mean=to_coordinates(np.array(middle), kinds).tolist(),
        covariance=np.diag(np.square(sd)).tolist(),
        freedom=30.0,
        people=33,
        curves=66,
        model_hash=identifier.provenance().model_hash,
    )
    return Prior(file, to_toml(file))


def test_coordinates_are_those_that_the_law_is_searched_in():
    assert coordinates_of(NAMES) == ["log", "log", "linear"]


def test_a_population_narrows_and_its_draws_are_the_answers(identifier, curve):
    alone = identifier(curve)
    known = with_prior(identifier, prior_of(identifier, TRUE))(curve)
    for name, true in zip(NAMES, TRUE, strict=True):
        before, after = alone.parameters[name], known.parameters[name]
        assert after.low <= true <= after.high
        assert after.high - after.low < before.high - before.low
    assert known.optimum == alone.optimum  # the fit is the curve's own
    assert not any(flag.startswith("not_identifiable") for flag in known.flags)
    draws = known.uncertainty.draws
    assert draws.weight.sum() == pytest.approx(1.0)
    x = draws.parameters[:, 0]
    assert draws.weight[x <= known.parameters[NAMES[0]].value].sum() == pytest.approx(0.5, abs=0.01)
    assert known.derived.keys() == alone.derived.keys()
    assert known.derived != alone.derived


def test_a_population_that_says_nothing_changes_nothing(identifier, curve):
    alone = identifier(curve)
    wide = with_prior(identifier, prior_of(identifier, TRUE, sd=(50.0, 50.0, 50.0)))(curve)
    for name in NAMES:
        one, other = alone.parameters[name], wide.parameters[name]
        assert (one.value, one.low, one.high) == pytest.approx(
            (other.value, other.low, other.high), rel=1e-3
        )
    assert wide.flags == alone.flags


def test_a_skin_unlike_the_population_keeps_its_own_answer(identifier, curve):
    alone = identifier(curve)
    far = with_prior(identifier, prior_of(identifier, 3.0 * TRUE * [1, 1, 1 / 3]))(curve)
    assert far.flags == (*alone.flags, UNLIKE)
    assert far.parameters == alone.parameters


def test_a_session_says_its_prior(identifier):
    with as_file(files("skinlab") / "data" / "example.h5") as path:
        session = read_session(path)
    knowing = with_prior(identifier, prior_of(identifier, TRUE))
    meta = session.meta | {"identification": identification_settings(knowing)}
    again, warning = identifier_of(replace(session, meta=meta))
    assert warning is None
    assert again.population == knowing.population
    meta["identification"]["prior"] = {"toml": 3}
    with pytest.raises(InputError, match="damaged"):
        identifier_of(replace(session, meta=meta))
    meta["identification"]["prior"] = {"toml": "schema = 1"}
    with pytest.raises(InputError, match=r"identification\.prior"):
        identifier_of(replace(session, meta=meta))


def test_only_a_prior_of_the_same_model_is_taken(identifier, curve):
    prior = prior_of(identifier, TRUE)
    other = replace(identifier, kappa="consistent")
    with pytest.raises(InputError, match="another model"):
        with_prior(other, prior)(curve)
    with pytest.raises(InputError, match="expected 3 numbers"):
        decode_prior(prior.text.replace("covariance = [", "covariance = [[0.0],"), "x.toml")
    with pytest.raises(InputError, match=r"x\.toml.*freedom"):
        decode_prior(prior.text.replace("freedom = 30.0", "freedom = 1.0"), "x.toml")


def test_python_takes_it_as_the_command_line_does(identifier, curve, tmp_path):
    prior = prior_of(identifier, TRUE)
    file = tmp_path / "study.toml"
    file.write_text(prior.text)
    found = skinlab.identify(curve, prior=file).parameters
    expected = with_prior(identifier, prior)(curve).parameters
    assert {n: (found[n].low, found[n].high) for n in NAMES} == {
        n: (v.low, v.high) for n, v in expected.items()
    }
