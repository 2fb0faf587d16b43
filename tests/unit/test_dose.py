"""What a visit's suction adds up to, from the probe to the words."""

from __future__ import annotations

import json

import pytest

from drivers.dose import Dose
from skinlab.cli.main import run as skinlab
from skinlab.recording.dose import dose_of
from skinlab.recording.session import read_session
from skinlab.tui.text import where_text
from skinlab.tui.ui_state import Board

PORT = "sim://?seed=1&speed=20"
SETUP = ["--aperture-mm", "6", "--thickness-mm", "1", "--program", "ramp:50@20,ramp:0@20"]


def measure(out, *options):
    return skinlab(["measure", "--port", PORT, *SETUP, "--out", str(out), *options])


def test_measured_recorded_and_said(tmp_path, capsys):
    path = tmp_path / "visit.h5"
    status = measure(path, "--repeats", "2", "--rest-s", "0", "--json")
    document = json.loads(capsys.readouterr().out)
    assert status == 0
    # Twice 125 mbar·s in 5 s, of which 0.25 s at each end are below 5 mbar
    assert document["dose"]["suction_mbar_s"] == pytest.approx(250, rel=0.03)
    assert document["dose"]["time_s"] == pytest.approx(9.0, abs=0.5)
    session = read_session(path)
    assert dose_of(session).suction_mbar_s == document["dose"]["suction_mbar_s"]
    assert skinlab(["session", "info", str(path)]) == 0
    said = capsys.readouterr().out
    assert f"dose of the site: {document['dose']['suction_mbar_s']:.0f} mbar·s" in said
    assert skinlab(["replay", str(path), "--speed", "max", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["dose"] == document["dose"]


def test_without_the_note_it_is_that_of_the_curves(tmp_path, capsys):
    path = tmp_path / "visit.h5"
    measure(path)
    assert "dose of the site: 12" in capsys.readouterr().out
    session = read_session(path)
    noted = dose_of(session)
    started = next(k for k, r in enumerate(session.records) if b'"run started"' in r.data)
    object.__setattr__(session, "records", session.records[: started + 1])
    assert dose_of(session).suction_mbar_s == pytest.approx(noted.suction_mbar_s, rel=0.02)


@pytest.mark.parametrize(
    ("limit", "said"),
    [("200", "2 times ramp:50@20,ramp:0@20 needs a dose of 250 mbar·s, more than the 200 mbar·s"),
     ("0", "dose_limit_mbar_s 0: expected a positive number"),
     ("nan", "dose_limit_mbar_s nan: expected a positive number")],
)  # fmt: skip
def test_refused_before_any_suction(tmp_path, capsys, limit, said):
    path = tmp_path / "visit.h5"
    assert measure(path, "--repeats", "2", "--dose-limit-mbar-s", limit) == 3
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_header_says_it():
    from drivers.events import Hello

    board = Board("port")
    board.hello = Hello("reference", 1, "rig", "1.0", "7", 6.0, 500, 60, 1, 1000, False)
    before = where_text(board)
    board.dose.total = Dose(1234.4, 25.2)
    assert where_text(board) == f"{before}; 1234 mbar·s in 25 s"
