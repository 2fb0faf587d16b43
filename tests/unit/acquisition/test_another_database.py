"""Measured, replayed and reported with a database of another law: that of the example plugin."""

from __future__ import annotations

import dataclasses
import json
from types import SimpleNamespace

import pytest
from fung_table import dimensionless
from skinlab_example.fung import LAW

from skinlab.acquisition.analysis import Analysis
from skinlab.acquisition.messages import Explaining
from skinlab.acquisition.replay import identifier_of
from skinlab.cli.main import run
from skinlab.errors import InputError
from skinlab.mechanics.materials import with_law
from skinlab.recording.session import read_session, write_session
from skinlab.tables.store import read

SKIN = """
[skin]
law = "fung"
parameters = { C1_MPa = 0.066, C2 = 11.0, nu = 0.33 }
"""
TRUTH = {"C1_MPa": 0.066, "C2": 11.0, "nu": 0.33}
GEOMETRY = ["--aperture-mm", "6", "--thickness-mm", "1"]


@pytest.fixture(scope="module", autouse=True)
def law():
    with with_law(LAW):
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fung")


@pytest.fixture(scope="module")
def database(folder, tmp_path_factory):
    return dimensionless(tmp_path_factory, folder)


@pytest.fixture(scope="module")
def skin(folder):
    (folder / "skin.toml").write_text(SKIN, encoding="utf-8")
    return folder / "skin.toml"


@pytest.fixture(scope="module")
def path(folder, database, skin):
    out = folder / "visit.h5"
    port = f"sim://?seed=3&speed=10&skin={skin}"
    program = ["--program", "ramp:60@20", "--repeats", "2", "--rest-s", "0"]
    told = ["measure", "--port", port, *GEOMETRY, *program, "--database", str(database)]
    assert run([*told, "--out", str(out), "--json"]) == 0
    return out


@pytest.mark.long
def test_the_truth_is_inside_the_intervals(path):
    results = read_session(path).results
    assert len(results) == 2
    inside = [
        found["low"] <= TRUTH[name] <= found["high"]
        for result in results
        for name, found in result["parameters"].items()
    ]
    assert len(inside) == 6
    assert sum(inside) >= 5


@pytest.mark.long
def test_a_replay_finds_the_database_that_the_session_names(path, database, capsys):
    assert read_session(path).meta["identification"]["database_path"] == str(database)
    assert run(["replay", str(path), "--verify"]) == 0
    told = capsys.readouterr()
    assert "2 curves and 2 stored results agree bit for bit" in told.out
    assert "C1 " in told.out
    assert "X1" not in told.out
    assert "database" not in told.err


@pytest.mark.long
def test_a_database_that_is_gone_or_another_one_is_a_sentence(path, database, tmp_path, capsys):
    session = read_session(path)
    settings = session.meta["identification"]

    def elsewhere(**changed):
        out = tmp_path / f"{len(list(tmp_path.iterdir()))}.h5"
        meta = session.meta | {"identification": settings | changed}
        write_session(out, dataclasses.replace(session, meta=meta))
        return out

    gone = elsewhere(database_path=str(tmp_path / "gone.h5"))
    with pytest.raises(InputError, match=r"then in .*gone\.h5 .*; name it with --database"):
        identifier_of(read_session(gone))
    assert run(["replay", str(gone), "--verify"]) == 3
    assert "--database" in capsys.readouterr().err
    assert run(["replay", str(gone), "--verify", "--database", str(database)]) == 0
    cut = tmp_path / "cut.h5"
    cut.write_bytes(database.read_bytes()[:1000])
    with pytest.raises(InputError, match=r"cut\.h5") as caught:  # it is there: no other name helps
        identifier_of(read_session(elsewhere(database_path=str(cut))))
    assert "--database" not in str(caught.value)
    other = elsewhere(database_hash="sha256:1")
    with pytest.raises(InputError, match="where now is another one; name it with --database"):
        identifier_of(read_session(other))
    capsys.readouterr()
    assert run(["replay", str(other), "--database", str(database)]) == 0
    assert "identified with another database, sha256:1" in capsys.readouterr().err


def speaks_of_that_law(path, tmp_path):
    assert run(["export", str(path), str(tmp_path / "out"), "--to", "html"]) == 0
    text = next((tmp_path / "out").glob("*.html")).read_text("utf-8")
    for part in ("C1", "C2", "Law fung", LAW.formula):
        assert part in text
    assert "X1" not in text
    assert "from a file" not in text


@pytest.mark.long
def test_the_report_speaks_of_that_law(path, tmp_path, empty_pictures):
    speaks_of_that_law(path, tmp_path)


@pytest.mark.long
def test_the_reports_pictures_speak_of_that_law_too(path, tmp_path):
    speaks_of_that_law(path, tmp_path)


@pytest.mark.long
def test_a_comparison_is_of_that_law(path, capsys):
    assert run(["compare", str(path), str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert "C1_MPa" in json.dumps(found)


@pytest.mark.long
def test_what_is_missing_is_looked_for_in_that_law_and_database(path, database, tmp_path):
    asked = []

    def explain(campaign, model, tell, database_path):
        tell("screening")
        asked.append((model.model.law, database_path))

    heard = []
    trail = SimpleNamespace(recorded_with=None, audit=None)
    identifier, _ = identifier_of(read_session(path))
    explain.cancel = lambda: None
    analysis = Analysis(
        tmp_path, heard.append, trail, make_identifier=lambda: identifier, explain=explain
    )
    analysis.explain(read_session(path).curves)
    assert asked == [("fung", database.resolve())]
    assert [type(one) for one in heard] == [Explaining]
    analysis.close()


def test_without_a_screen_ui_measures_with_it(database, skin, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("TEXTUAL_DRIVER", "")
    told = ["ui", "--sessions", str(tmp_path), "--database", str(database)]
    assert run([*told, "--port", f"sim://?seed=1&speed=10&skin={skin}"]) in (0, 3)
    (saved,) = tmp_path.glob("*.h5")
    session = read_session(saved)
    assert session.meta["identification"]["database_hash"] == read(database).content_hash
    assert run([*told, "--database", str(tmp_path / "none.h5")]) == 3
    assert "none.h5" in capsys.readouterr().err
