"""What version 0.1.0 wrote stays readable: each kind of file through the command that reads it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from skinlab.cli.main import run
from skinlab.mechanics.fem.suction import SOLVER_VERSION

OLD = Path(__file__).parents[1] / "data" / "v0.1"


def document(capsys, *arguments: object) -> dict:
    capsys.readouterr()
    status = run([str(a) for a in arguments])
    text = capsys.readouterr()
    assert status == 0, text.err
    return json.loads(text.out)


def test_a_session_is_whole_and_its_bytes_make_the_same_curve_again(capsys, tmp_path):
    session = OLD / "session.h5"
    assert run(["session", "verify", str(session)]) == 0
    found = document(capsys, "replay", session, "--speed", "max", "--json")["curves"]
    assert [c["points"] for c in found] == [40]
    assert run(["export", str(session), "--to", "csv", str(tmp_path / "csv")]) == 0


def test_a_crashs_journal_becomes_a_session(capsys, tmp_path):
    for file in OLD.glob("crashed.h5.journal*"):
        shutil.copy(file, tmp_path)
    assert run(["recover", str(tmp_path / "crashed.h5.journal"), "--out", f"{tmp_path}/r.h5"]) == 0
    assert run(["session", "verify", f"{tmp_path}/r.h5"]) == 0
    found = document(capsys, "identify", f"{tmp_path}/r.h5", "--json")["curves"]
    assert [c["points"] for c in found] == [20]


def test_a_custom_database_answers_with_the_skin_that_it_gave(capsys):
    arguments = ("identify", OLD / "curve.csv", "--aperture-mm", 6, "--thickness-mm", 1)
    found = document(capsys, *arguments, "--database", OLD / "custom.h5", "--json")
    values = found["curves"][0]["parameters"]
    assert values["X1_MPa"]["low"] <= 0.0301 <= values["X1_MPa"]["high"] * 1.01
    assert values["natural_tension.stretch"]["low"] == pytest.approx(1.0, abs=2e-3)
    assert run(["database", "info", str(OLD / "custom.h5")]) == 0
    # What an older solver computed is used, and is not said to be what today's would compute
    assert run(["database", "verify", str(OLD / "custom.h5"), "--samples", "2"]) == 1
    assert f"solver 3; this is screening-1, {SOLVER_VERSION}" in capsys.readouterr().err


def test_an_adopted_model_gives_the_same_curve(capsys):
    arguments = ["forward", "--direct", "--x1-mpa", "0.04", "--x2-mpa", "1.4", "--nu", "0.34"]
    arguments += ["--aperture-mm", "6", "--thickness-mm", "1", "--program", "ramp:60@20"]
    assert run([*arguments, "--model", str(OLD / "stretched.toml")]) == 0
    rows = capsys.readouterr().out.strip().splitlines()
    assert float(rows[-1].split(",")[2]) == pytest.approx(0.413847769, abs=2e-9)


def test_the_screens_settings_are_taken_over():
    from skinlab.acquisition.settings import recall

    taken = recall(OLD / "ui.json")
    assert taken["program"] == "ramp:100@20"
    assert "thickness_mm" not in taken  # 0.1.0 kept it with the machine; it is a person's
