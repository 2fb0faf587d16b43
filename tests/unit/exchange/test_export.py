"""A session as tidy files, and back."""

from __future__ import annotations

import csv
import json
import stat
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from skinlab.cli.main import cli
from skinlab.curves.campaign import read_campaign
from skinlab.curves.csv import read_curve
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.exchange.export import FORMATS, export
from skinlab.inference.identify import Identifier
from skinlab.recording.audit import Chain, note
from skinlab.recording.load_inputs import read_campaign_or_session, read_input
from skinlab.recording.session import (
    Session,
    example_session,
    read_session,
    stated_noise,
    write_session,
)
from skinlab.recording.stream import setup_from_json
from skinlab.studies.compute import curves_and_noise
from skinlab.studies.sources import Plan, Source, find_sources

NUMBERS = ("time_s", "pressure_mbar", "deflection_mm")


@pytest.fixture(scope="module")
def session(table):
    rng = np.random.default_rng(0)
    time_s = np.arange(40) / 7 + 1e-7 * rng.random(40)
    program = parse_program("ramp:100@20")
    whole = Curve(
        'a "quoted", name', Setup(6, 1.1, program, 1, 1, 0.1), time_s, 100 / 6 * time_s,
        np.cumsum(rng.random(40)) / 100, segment=np.zeros(40, dtype=np.intp),
    )  # fmt: skip
    partial = replace(
        whole, name="µ", setup=Setup(2, 0.9, None, 3, 2, placement="a"), segment=None, partial=True
    )
    results = (Identifier(table)(whole).to_json(), None)
    return Session({"site": 'fore"arm', "subject": "P-1"}, (), (whole, partial), results)


def test_csv_reads_back_to_the_same_bits(session, tmp_path):
    export(session, "csv", tmp_path / "new" / "folder")
    campaign = read_campaign(tmp_path / "new" / "folder" / "campaign.toml")
    assert campaign.title == 'fore"arm'
    (again,) = campaign.curves  # the other one was cut short, and counts with none
    assert again.setup == session.curves[0].setup
    for number, curve in enumerate(session.curves, start=1):
        path = tmp_path / "new" / "folder" / f"curve_{number:04d}.csv"
        again = read_curve(path, curve.setup)
        for name in NUMBERS:
            np.testing.assert_array_equal(getattr(again, name), getattr(curve, name))
    assert len(read_input(tmp_path / "new" / "folder", None).curves) == 1
    with (tmp_path / "new" / "folder" / "curves.csv").open(newline="", encoding="utf-8") as file:
        first, second = csv.DictReader(file)
    value = session.results[0]["parameters"]["X1_MPa"]["value"]
    assert float(first["X1_MPa"]) == value
    assert (first["name"], first["samples"], first["partial"]) == (
        'a "quoted", name',
        "40",
        "false",
    )
    assert (second["X1_MPa"], second["partial"], second["program"]) == ("", "true", "")
    assert [first[name] for name in ("subject", "visit", "site")] == ["P-1", "", 'fore"arm']


def test_effects_have_their_columns_behind_those_of_the_law(session, tmp_path):
    """Values of a model's effects were in session.json, and in no table."""
    first = session.results[0]
    lag = {"value": 0.1, "low": 0.05, "high": 0.2}
    with_effect = {**first, "parameters": {"pressure_lag.lag_s": lag} | first["parameters"]}
    export(replace(session, results=(first, with_effect)), "csv", tmp_path)
    with (tmp_path / "curves.csv").open(newline="", encoding="utf-8") as file:
        without, row = csv.DictReader(file)
    own = [f"pressure_lag.lag_s{end}" for end in ("", "_low", "_high")]
    assert [row[name] for name in own] == ["0.1", "0.05", "0.2"]
    assert [without[name] for name in own] == ["", "", ""]
    assert list(row).index("nu_high") + 1 == list(row).index(own[0])


def test_json_reads_back_to_the_same_bits(session, tmp_path):
    (path,) = export(session, "json", tmp_path)
    document = json.loads(path.read_text(encoding="utf-8"))
    assert document["schema"] == "skinlab.export/1"
    assert document["meta"] == session.meta
    for curve, result, entry in zip(
        session.curves, session.results, document["curves"], strict=True
    ):
        again = Curve(
            entry["name"],
            setup_from_json(entry["setup"]),
            *(np.array(entry[name]) for name in NUMBERS),
            segment=entry["segment"],
            partial=entry["partial"],
        )
        assert (again.name, again.setup, again.partial) == (curve.name, curve.setup, curve.partial)
        for name in NUMBERS:
            np.testing.assert_array_equal(getattr(again, name), getattr(curve, name))
        np.testing.assert_array_equal(again.phase, curve.phase)
        assert entry["phase"] == curve.phase.tolist()
        assert entry["result"] == result


def test_every_export_says_which_file_it_is_of(session, tmp_path):
    """Of a folder of exports nobody could tell which visit was which."""
    visit = tmp_path / "people" / "P-1 visit 2.h5"
    visit.parent.mkdir()
    write_session(visit, session)

    def exported(kind):
        done = CliRunner().invoke(cli, ["export", str(visit), "--to", kind, str(tmp_path / kind)])
        assert done.exit_code == 0, done.output
        return tmp_path / kind

    document = json.loads((exported("json") / "session.json").read_text(encoding="utf-8"))
    assert document["session_file"] == "P-1 visit 2.h5"
    with (exported("csv") / "curves.csv").open(newline="", encoding="utf-8") as file:
        assert [row["session_file"] for row in csv.DictReader(file)] == ["P-1 visit 2.h5"] * 2
    listed = [s for s in find_sources(Plan((tmp_path / "csv",))) if isinstance(s, Source)]
    assert [one.facts["subject"] for one in listed] == ["P-1", "P-1"]
    assert not any("session_file" in one.facts for one in listed)  # it is no label of a study
    assert "P-1 visit 2.h5" in (exported("html") / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("kind", FORMATS)
def test_nothing_is_overwritten_and_the_files_are_their_owners(session, kind, tmp_path):
    paths = export(session, kind, tmp_path)
    assert all(stat.S_IMODE(path.stat().st_mode) == 0o600 for path in paths)
    before = paths[-1].read_bytes()
    with pytest.raises(InputError, match="exists already"):
        export(session, kind, tmp_path)
    assert paths[-1].read_bytes() == before
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        export(session, kind, tmp_path / "file" / "folder")


@pytest.mark.parametrize("kind", FORMATS)
def test_an_empty_session(kind, tmp_path):
    paths = export(Session({}, (), (), ()), kind, tmp_path)
    assert "campaign.toml" not in [path.name for path in paths]


def test_a_stated_noise_goes_along_with_its_session(session, tmp_path):
    meta = {"identification": {"noise_um": 1.5, "pressure_noise_mbar": 0.0}}
    path = tmp_path / "s.h5"
    write_session(path, replace(session, meta=meta))
    export(read_session(path), "csv", tmp_path / "exported")
    for file in (path, tmp_path / "exported"):
        given, campaign = read_input(file, None), read_campaign_or_session(file)[0]
        for one in (given, campaign):
            assert (one.noise_um, one.pressure_noise_mbar) == (1.5, 0.0)
            for curve in one.curves:
                assert (curve.noise_um, curve.pressure_noise_mbar) == (1.5, 0.0)
    _, noise = curves_and_noise(path, {})
    assert noise == (1.5, 0.0)
    _, noise = curves_and_noise(path, {"noise_um": 3.0})  # a study's table
    assert noise == (3.0, 0.0)
    with pytest.raises(InputError, match="identification is damaged"):
        stated_noise({"identification": {"noise_um": -1}})


def test_a_curve_that_its_operator_left_out_says_so_in_every_export(tmp_path):
    """It was `final` in FHIR, and one of the campaign's."""
    session, path = read_session(example_session()), tmp_path / "visit.h5"
    deed = note(9e9, 9e9, "me", "curve excluded", {"curve": 2, "text": "a loose tape"})
    records = (*session.records, Chain(session.records).add(deed))
    write_session(path, replace(session, records=records))

    def exported(kind):
        done = CliRunner().invoke(cli, ["export", str(path), "--to", kind, str(tmp_path / kind)])
        assert done.exit_code == 0, done.output
        return tmp_path / kind

    entries = json.loads((exported("fhir") / "fhir.json").read_text("utf-8"))["entry"]
    kept, out = (e["resource"] for e in entries if e["resource"]["resourceType"] == "Observation")
    assert (kept["status"], out["status"]) == ("final", "entered-in-error")
    assert "left out by who measured it: a loose tape" in [n["text"] for n in out["note"]]
    curves = json.loads((exported("parameters") / "parameters.json").read_text("utf-8"))["curves"]
    assert [one.get("left_out") for one in curves] == [None, "a loose tape"]
    with (exported("csv") / "curves.csv").open(encoding="utf-8", newline="") as file:
        told = [row["left_out"] for row in csv.DictReader(file)]
    assert told == ["", "a loose tape"]
    campaign, _ = read_campaign_or_session(tmp_path / "csv")
    assert [Path(curve.name).name for curve in campaign.curves] == ["curve_0001.csv"]
