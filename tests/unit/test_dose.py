"""What a visit's suction adds up to, from the probe to the words."""

from __future__ import annotations

import json
import os
import shutil
from datetime import datetime
from pathlib import Path

import pytest

from drivers.dose import Dose
from drivers.line_dialect import line_dialect
from drivers.probe import Probe
from drivers.stream import follow_mark
from skinlab.acquisition.measure import measure as run_plan
from skinlab.acquisition.measurement_messages import Plan
from skinlab.acquisition.messages import Heard
from skinlab.acquisition.messages import Recording as RecordingNews
from skinlab.acquisition.pipeline import Pipeline
from skinlab.acquisition.sources import LiveSource
from skinlab.cli.main import run as skinlab
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.inference.identify import Identifier
from skinlab.recording.audit import entries
from skinlab.recording.dose import VISIT_S, dose_before, dose_of, loaded_before
from skinlab.recording.recorded_items import dialect_facts, recorded_items
from skinlab.recording.recorder import Recording, recover
from skinlab.recording.records import Kind, Record
from skinlab.recording.session import read_session, session_from_records
from skinlab.recording.stream import setup_to_json
from skinlab.tables.store import shipped_grid
from skinlab.tui.text import where_text
from skinlab.tui.ui_state import Board

PORT = "sim://?seed=1&speed=20"
SETUP = ["--aperture-mm", "6", "--thickness-mm", "1", "--program", "ramp:50@20,ramp:0@20"]


def measure(out, *options):
    return skinlab(["measure", "--port", PORT, *SETUP, "--out", str(out), *options])


@pytest.mark.long
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


LINE = """
[dialect]
name = "line"
pattern = '(?P<pressure>\\S+) (?P<deflection>\\S+)'
[columns.pressure]
unit = "mbar"
[columns.deflection]
unit = "mm"
[stream]
rate_hz = {rate}
"""


@pytest.mark.parametrize("rate", [2, 20, 200])
def test_of_an_instrument_with_a_wrong_clock_it_goes_by_the_hosts(tmp_path, rate):
    """It was shown, kept and carried over by the instrument's: a tenth, or ten times as much."""
    dialect = line_dialect(LINE.format(rate=rate), "line.toml")
    recording = Recording(tmp_path / "s.h5", Identifier(shipped_grid()), dialect=dialect)
    board = Board("port")
    show = Pipeline(None, [recording, lambda message: board.see(Heard((message,)))])
    meta = {**dialect_facts(dialect), "control": "none"}
    setup = Setup(6.0, 1.0)
    course = [0, 0, *range(0, 101, 2), *range(100, -1, -2), *[0] * 300]
    records = [
        Record(Kind.PLAN, 0.0, 0.0, json.dumps(setup_to_json(setup)).encode()),
        Record(Kind.MARK, 0.0, 0.0, follow_mark(None)),
    ]
    for k, mbar in enumerate(course):
        records.append(Record(Kind.RECEIVED, k / 20, k / 20, b"%d %f\n" % (mbar, 0.003 * mbar)))
    for item in recorded_items(records, dialect):
        show.handle(item)
    assert recording.dose.suction_mbar_s == pytest.approx(250, rel=0.03)
    assert recording.dose.time_s == pytest.approx(5.0, abs=0.6)
    assert board.dose == recording.dose
    recording.finish()
    # After a crash nothing is noted
    session = session_from_records(meta, records)
    assert len(session.curves) == 1
    assert dose_of(session).suction_mbar_s == pytest.approx(250, rel=0.03)


def test_the_header_says_it(monkeypatch):
    from drivers.events import Hello

    board = Board("port")
    board.hello = Hello("reference", 1, "rig", "1.0", "7", 6.0, 500, 60, 1, 1000, False)
    assert "mbar·s" not in where_text(board)
    monkeypatch.setattr(Board, "dose", Dose(1234.4, 25.2))
    assert "1234 mbar·s in 25 s" in where_text(board)


@pytest.mark.long
def test_another_session_of_the_same_site_goes_on(tmp_path, capsys):
    who = ["--subject", "P-7", "--site", "forearm"]
    assert measure(tmp_path / "a.h5", *who) == 0
    assert "before" not in capsys.readouterr().err
    assert measure(tmp_path / "b.h5", *who, "--json") == 0
    said = capsys.readouterr()
    assert "the site had 12" in said.err
    # A session says what was measured in it; the limit counts what came before it
    assert json.loads(said.out)["dose"]["suction_mbar_s"] == pytest.approx(125, rel=0.05)
    carried = [e for e in entries(read_session(tmp_path / "b.h5").records) if "carried" in e.what]
    assert carried[0].detail["sessions"] == ["a.h5"]
    assert measure(tmp_path / "c.h5", *who, "--dose-limit-mbar-s", "300") == 3
    assert "mbar·s that the site had" in capsys.readouterr().err
    assert not (tmp_path / "c.h5").exists()
    elsewhere = ["--subject", "P-7", "--site", "cheek", "--dose-limit-mbar-s", "130"]
    assert measure(tmp_path / "c.h5", *elsewhere) == 0


@pytest.fixture(scope="module")
def visit(tmp_path_factory):
    """A folder with a measured session and a file that is none."""
    folder = tmp_path_factory.mktemp("visit")
    measure(folder / "a.h5", "--subject", "P-7", "--site", "forearm")
    (folder / "b.h5").write_text("no session")
    return folder


@pytest.mark.parametrize(
    ("subject", "site", "later_h", "simulated", "counts"),
    [("P-7", "forearm", 11, True, True), ("P-7", "forearm", 13, True, False),
     ("P-7", "forearm", 1, False, False), ("P-8", "forearm", 1, True, False),
     ("", "forearm", 1, True, False), ("P-7", "", 1, True, False)],
)  # fmt: skip
def test_what_belongs_to_one_visit(visit, subject, site, later_h, simulated, counts):
    begun = datetime.fromisoformat(read_session(visit / "a.h5").meta["created_utc"])
    now_s = begun.timestamp() + 3600 * later_h
    found, names = dose_before(visit, subject, site, now_s, simulated=simulated)
    assert (found.suction_mbar_s > 100) == (names == ["a.h5"]) == counts
    assert loaded_before(visit, subject, site, now_s, simulated=simulated) == names


@pytest.mark.parametrize("name", ["a.hdf5", "a.H5"])
def test_a_session_counts_whatever_sessions_names_end_with(visit, tmp_path, name):
    """Only names that end with .h5 were looked at; `measure --out a.hdf5` was taken."""
    shutil.copy(visit / "a.h5", tmp_path / name)
    begun = datetime.fromisoformat(read_session(tmp_path / name).meta["created_utc"])
    of = (tmp_path, "P-7", "forearm", begun.timestamp() + 60)
    found, names = dose_before(*of, simulated=True)
    assert found.suction_mbar_s > 100
    assert names == loaded_before(*of, simulated=True) == [name]


def test_a_copy_counts_once(visit, tmp_path):
    for name in ("a.h5", "a copy.h5"):
        shutil.copy(visit / "a.h5", tmp_path / name)
    begun = datetime.fromisoformat(read_session(visit / "a.h5").meta["created_utc"])
    found, names = dose_before(tmp_path, "P-7", "forearm", begun.timestamp() + 60, simulated=True)
    assert found == dose_of(read_session(visit / "a.h5"))
    assert len(names) == 1


def test_what_a_crash_left_counts(tmp_path):
    """After a crash the next session of the site began at 0."""
    begun_s = 1.7e9
    live, left = tmp_path / "live", tmp_path / "left"
    live.mkdir()
    left.mkdir()
    recording = Recording(
        live / "a.h5",
        Identifier(shipped_grid()),
        subject="P-7",
        site="forearm",
        now=lambda: begun_s,
    )
    with Probe("sim://?seed=1&speed=50", on_bytes=recording.journal.raw) as probe:
        probe.open()
        source = LiveSource(probe, recording.journal)
        plan = Plan(Setup(6.0, 1.0, parse_program("ramp:50@20,ramp:0@20")))
        run_plan(source, plan, Pipeline(None, [recording]))
    recording.journal.flush()
    for part in ("a.h5.journal", "a.h5.journal-wal"):
        shutil.copy(live / part, left / part)
        os.utime(left / part, (begun_s, begun_s))
    whose = ("P-7", "forearm")

    def before(folder, whose=whose, later_s=60.0):
        found, names = dose_before(folder, *whose, begun_s + later_s, simulated=True)
        assert loaded_before(folder, *whose, begun_s + later_s, simulated=True) == names
        return found.suction_mbar_s, names

    had, names = before(left)
    assert had == pytest.approx(125, rel=0.05)
    assert names == ["a.h5.journal"]
    assert before(live) == (0, [])  # still recorded
    assert before(left, ("P-7", "cheek")) == (0, [])
    assert before(left, later_s=VISIT_S + 60) == (0, [])
    recover(left / "a.h5.journal", left / "a.h5", who="nurse")
    assert before(left) == (pytest.approx(had), ["a.h5"])
    os.utime(left / "a.h5", (begun_s - 9, begun_s - 9))  # as one that was saved before the crash
    assert before(left)[0] == pytest.approx(had)
    recording.finish()


def test_the_screen_goes_on_from_what_the_site_had_before_the_program_was_started():
    """It began at 0, while the limit counted all of it."""
    board = Board(PORT)
    board.visit = ("P-7", "forearm")
    board.see(RecordingNews(Path("s.h5"), Dose(39.0, 2.0)))
    assert board.dose == Dose(39.0, 2.0)
    board.see(RecordingNews(Path("s.h5"), Dose(10.0, 1.0)))  # what was seen here says more
    assert board.dose == Dose(39.0, 2.0)
