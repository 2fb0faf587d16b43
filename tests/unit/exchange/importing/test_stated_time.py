"""When imported curves were measured: as somebody states it, and never the moment of import."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta, timezone

import pytest

import skinlab
from skinlab.cli.main import run
from skinlab.errors import InputError
from skinlab.exchange.fhir import to_fhir
from skinlab.exchange.importing.stated_time import stated_time
from skinlab.recording.session import Session, example_session, measured_utc, read_session
from skinlab.report.session_report import SessionReport

NOW = datetime(2026, 3, 1, 23, 30, tzinfo=UTC)
BERLIN = timezone(timedelta(hours=1))
ROWS = "".join(f"{0.1 * i:.1f};{2 * i};{0.006 * i:.3f}\n" for i in range(51))


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        ("2026-03-01", "2026-03-01"),
        ("2026-03-02", "2026-03-02"),  # it is that day in Berlin already
        ("2026-03-01T10:20", "2026-03-01T09:20:00+00:00"),
        ("2026-03-01 10:20:30", "2026-03-01T09:20:30+00:00"),
        ("2026-03-01T10:20Z", "2026-03-01T10:20:00+00:00"),
        ("2026-03-01T10:20-05:00", "2026-03-01T15:20:00+00:00"),
    ],
)
def test_a_day_stays_a_day_and_a_time_becomes_utc(text, kept):
    assert stated_time(text, NOW, BERLIN) == kept


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("2026-03-03", "in the future"),
        ("2026-03-02T00:31", "in the future"),
        ("9999-12-31T23:59-23:59", "in the future"),
        ("2026-02-30", "no such day"),
        ("2026-03-01T25:00", "no such day or time"),
        ("2026-03-01T10:20+99:00", "no such day or time"),
        ("0001-01-01T00:00+23:00", "before 1970"),
        ("1.3.2026", "expected the day of the measurement"),
        ("20260301", "expected the day"),
        ("2026-W09-1", "expected the day"),
        ("", "expected the day"),
    ],
)
def test_what_is_no_day_of_a_measurement_is_refused(text, says):
    with pytest.raises(InputError, match=says):
        stated_time(text, NOW, BERLIN)


def test_a_measured_session_was_measured_when_it_began_and_an_imported_one_when_stated():
    meta = read_session(example_session()).meta
    assert measured_utc(meta) == meta["created_utc"]
    assert measured_utc({"created_utc": "2026-03-01", "imported": []}) == ""
    assert measured_utc({"imported": [], "measured_utc": "2020-01-01"}) == "2020-01-01"
    assert measured_utc({}) == ""


@pytest.fixture
def imported(tmp_path, capsys, monkeypatch):
    """Import a curve with these options; return status, what it said, and the session's path."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.txt").write_text("t (s);p (mbar);w (mm)\n" + ROWS)

    def call(*options):
        skin = ("--aperture-mm", "6", "--thickness-mm", "1", "--out", "s.h5")
        status = run(["import", "a.txt", *skin, *options])
        return status, capsys.readouterr().err, tmp_path / "s.h5"

    return call


def test_the_day_is_kept_and_told_apart_from_the_import(imported, capsys):
    status, _, path = imported("--measured", "2020-02-03")
    assert status == 0
    session = read_session(path)
    assert session.meta["measured_utc"] == "2020-02-03"
    assert session.meta["created_utc"] > "2020-02-03"
    assert '"effectiveDateTime": "2020-02-03"' in to_fhir(session)["fhir.json"]
    assert skinlab.read_session(path).measured_utc == "2020-02-03"
    assert run(["session", "info", "s.h5"]) == 0
    assert "\n  measured 2020-02-03\n" in capsys.readouterr().out


def test_without_it_no_day_is_told(imported, capsys):
    status, _, path = imported()
    assert status == 0
    session = read_session(path)
    assert "effectiveDateTime" not in to_fhir(session)["fhir.json"]
    assert skinlab.read_session(path).measured_utc == ""
    assert run(["session", "info", "s.h5"]) == 0
    assert "measured on a day that nobody stated" in capsys.readouterr().out


def test_a_report_and_a_comparison_tell_the_day_or_that_nobody_stated_it(
    imported, tmp_path, capsys
):
    for name, options in (("open.h5", ()), ("day.h5", ("--measured", "2020-02-03"))):
        path = imported("--subject", "P-1", *options)[2].rename(tmp_path / name)
        session = Session(read_session(path).meta, (), (), ())
        page = SessionReport(session, "not needed").html()
        assert ("nobody stated when it was measured" in page) == (name == "open.h5")
        assert ("Subject P-1 · 2020-02-03<" in page) == (name == "day.h5")
    assert run(["compare", "open.h5", "day.h5", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["measured_utc"] == [None, "2020-02-03"]


@pytest.mark.parametrize("text", ["yesterday", "2999-01-01", "2026-02-30"])
def test_a_wrong_day_is_wrong_usage_and_nothing_is_written(imported, text):
    status, said, path = imported("--measured", text)
    assert status == 2
    assert f"'--measured': '{text}'" in said
    assert not path.exists()
