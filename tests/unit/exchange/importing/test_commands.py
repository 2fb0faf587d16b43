"""`import`, `export`, `replay` of what was imported, in process."""

from __future__ import annotations

import json

import numpy as np
import pytest

from skinlab.cli.main import run
from skinlab.recording.session import read_session

HEADER = "t (s);p (mbar);w (mm)\n"
ROWS = "".join(f"{0.1 * i:.1f};{2 * i};{0.006 * i:.3f}\n" for i in range(51))
TWO = "t (s);w (mm)\n" + "".join(f"{0.1 * i:.1f};{0.006 * i:.3f}\n" for i in range(51))
SKIN = ["--aperture-mm", "6", "--thickness-mm", "1"]
RAMP = ["--program", "ramp:100@20"]


@pytest.fixture
def call(capsys, tmp_path, monkeypatch):
    """Run a command in an own folder with three exports; a pipe is no terminal."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.txt").write_text(HEADER + ROWS)
    (tmp_path / "b.txt").write_text(TWO.replace(".", ","), encoding="utf-16")
    (tmp_path / "bad.txt").write_text(HEADER + ROWS.replace("2.5;50;", "2.5;x;"))

    def call(*arguments):
        status = run([str(a) for a in arguments])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return status, captured.out, captured.err

    return call


def values(entries):
    """What was identified, without the intervals: those look at all curves of an input together."""
    return [{n: v["value"] for n, v in entry["parameters"].items()} for entry in entries]


def test_several_files_become_one_session(call):
    status, out, err = call(
        "import", "a.txt", "b.txt", "--aperture-mm", "6", "--aperture-mm", "2", "--thickness-mm",
        "1", *RAMP, "--cycle", "1", "--cycle", "2", "--repeat", "3",
        "--placement", "left", "--out", "s.h5",
    )  # fmt: skip
    assert (status, out) == (0, "session: s.h5\n")
    assert "a.txt: UTF-8, separator semicolon, decimal point; time: column 't (s)' in s" in err
    assert "b.txt: UTF-16, separator semicolon, decimal comma" in err
    first, second = read_session("s.h5").curves
    assert (first.name, second.name) == ("a.txt", "b.txt")
    assert (first.setup.aperture_mm, second.setup.aperture_mm) == (6.0, 2.0)
    assert (first.setup.cycle, second.setup.cycle) == (1, 2)
    assert (first.setup.repeat, second.setup.repeat) == (3, 3)
    assert (first.setup.placement, second.setup.placement) == ("left", "left")
    assert str(second.setup.program) == "ramp:100@20"
    np.testing.assert_allclose(second.pressure_mbar, 2.0 * np.arange(51), atol=1e-9)


def test_an_imported_session_is_one_like_any_other(call):
    assert call("import", "a.txt", "b.txt", *SKIN, *RAMP, "--out", "s.h5")[0] == 0
    status, out, _ = call("session", "info", "s.h5")
    assert status == 0
    assert "imported" in out
    assert "from 2 files of other software; no instrument was connected" in out
    assert "session imported" in out  # the audit trail
    assert call("session", "verify", "s.h5")[0] == 0
    status, out, _ = call("identify", "s.h5", "--json")
    assert status == 0
    identified = json.loads(out)["curves"]
    assert [entry["file"] for entry in identified] == ["s.h5:a.txt", "s.h5:b.txt"]
    for speed in ("1", "max"):
        status, out, err = call("replay", "s.h5", "--speed", speed, "--verify", "--json")
        assert status == 0
        assert "imported curves: there are no bytes to replay" in err
        replayed = json.loads(out)["curves"]
        assert values(replayed) == values(identified)
    assert call("export", "s.h5", "--to", "csv", "tidy")[0] == 0
    status, out, _ = call("identify", "tidy", "--json")
    # Repeats of a campaign say more of the noise than each curve of a session alone.
    again = json.loads(out)["curves"]
    assert [entry["optimum"] for entry in again] == [entry["optimum"] for entry in identified]


def test_the_good_ones_come_first_and_the_json_says_which_failed(call):
    status, out, err = call("import", "bad.txt", "a.txt", *SKIN, "--out", "s.h5", "--json")
    assert status == 3
    document = json.loads(out)
    assert document["session"] == "s.h5"
    bad, good = document["files"]
    assert bad["error"] == (
        "bad.txt: line 27: p (mbar) is 'x', expected a number (decimal sign: a point)"
    )
    assert bad["error"] in err
    assert (good["error"], good["points"]) == (None, 51)
    assert len(read_session("s.h5").curves) == 1


def test_nothing_good_leaves_no_session(call, tmp_path):
    status, out, _ = call("import", "bad.txt", "absent.txt", *SKIN, "--out", "s.h5", "--json")
    assert status == 3
    assert json.loads(out)["session"] is None
    assert not (tmp_path / "s.h5").exists()


@pytest.mark.parametrize(
    ("arguments", "status", "says"),
    [
        (["import", "a.txt", *SKIN], 2, "--out"),
        (["import", "a.txt", "--out", "s.h5"], 2, "--aperture-mm"),
        (
            ["import", "a.txt", *SKIN, "--cycle", 1, "--cycle", 2, "--out", "s.h5"],
            2,
            "2 times for 1",
        ),
        (["import", "a.txt", *SKIN, "--time-unit", "h", "--out", "s.h5"], 2, "--time-unit"),
        (["import", "a.txt", *SKIN, "--subject", "Jane", "--out", "s.h5"], 3, "pseudonym"),
        (["import", "a.txt", *SKIN, "--cycle", 0, "--out", "s.h5"], 3, "cycle 0: expected"),
        (["import", "a.txt", *SKIN, "--program", "up", "--out", "s.h5"], 3, "is not a segment"),
        (["import", "a.txt", *SKIN, "--out", "a.txt"], 3, "exists already"),
        (["import", "a.txt", *SKIN, "--out", "s.txt"], 3, "s.txt: expected a name that ends with"),
        (["watch", ".", *SKIN, "--out", "s.txt"], 3, "s.txt: expected a name that ends with .h5"),
        (
            ["import", "b.txt", *SKIN, *RAMP, "--program-start-s", 6, "--out", "s.h5"],
            3,
            "0 samples while the program ran, which started at 6 s",
        ),
        (
            ["import", "a.txt", *SKIN, "--program-start-s", 1, "--out", "s.h5"],
            2,
            "--program-start-s is for --program",
        ),
        (
            ["import", "a.txt", *SKIN, "--deflection-sign", "-", "--out", "s.h5"],
            3,
            "expected a dome, which is positive: leave out --deflection-sign -\n",
        ),
        (["import", "b.txt", *SKIN, "--out", "s.h5"], 3, "no column of the pressure"),
        (["watch", "absent", *SKIN], 3, "absent: no such folder"),
        (["watch", ".", *SKIN, "--settle-s", 0], 3, "expected 0.1-3600"),
        (["watch", ".", *SKIN, "--out", "a.txt"], 3, "exists already"),
        (["export", "absent.h5", "--to", "csv", "d"], 3, "absent.h5"),
        (["export", "absent.h5", "--to", "docx", "d"], 2, "'csv', 'json'"),
        (["capture", "--port", "sim://", "--out", "a.txt"], 3, "never overwritten"),
        (["capture", "--port", "/dev/absent", "--out", "c"], 4, "there is no such port"),
        (["capture", "--port", "sim://", "--through", "tcp:99999", "--out", "c"], 2, "65535"),
        (["capture", "--port", "sim://", "--framing", "9X9", "--out", "c"], 2, "framing"),
    ],
)
def test_mistakes_give_one_sentence_and_leave_nothing(call, tmp_path, arguments, status, says):
    before = sorted(tmp_path.iterdir())
    got, _, err = call(*arguments)
    assert got == status
    assert says in err
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("name", "status"), [("a.txt", 2), ("other.csv", 3), ("comma.csv", 3), ("utf16.csv", 3)]
)
def test_what_only_import_reads_is_refused_with_the_advice_to_import_it(
    call, tmp_path, name, status
):
    (tmp_path / "other.csv").write_text(HEADER + ROWS)
    ours = "time_s;pressure_mbar;deflection_mm\n" + ROWS
    (tmp_path / "comma.csv").write_text(ours.replace(".", ",").replace(";", ","))
    (tmp_path / "utf16.csv").write_text(ours.replace(";", ","), encoding="utf-16")
    got, _, err = call("identify", name, *SKIN)
    assert got == status
    assert name in err
    assert "`skinlab import` makes a session of what other software exported" in err


def test_a_missing_column_is_told_before_too_few_samples(call, tmp_path):
    (tmp_path / "few.csv").write_text("time_s,pressure_mbar\n0,0\n0.1,1\n0.2,2\n")
    status, _, err = call("import", "few.csv", *SKIN, "--out", "s.h5")
    assert status == 3
    assert "few.csv: line 1: no column of the deflection" in err
    (tmp_path / "few.csv").write_text("a,b,c\n0,0,0\n0.1,1,0\n0.2,2,0\n")
    assert (
        "few.csv: 3 samples; expected at least 5"
        in call("import", "few.csv", *SKIN, "--out", "s.h5")[2]
    )  # and nobody is asked which column is which


@pytest.mark.parametrize("kind", ["fhir", "parameters"])
def test_an_export_without_parameters_says_so(call, kind):
    assert call("import", "a.txt", *SKIN, "--out", "s.h5")[0] == 0
    status, _, err = call("export", "s.h5", "--to", kind, "d")
    assert status == 0
    assert "s.h5: no curve has parameters: not identified yet; `skinlab identify s.h5" in err


def test_a_file_that_is_given_twice_is_taken_once(call):
    status, out, err = call("import", "a.txt", "a.txt", "b.txt", *SKIN, *RAMP, "--out", "s.h5")
    assert (status, out) == (3, "session: s.h5\n")
    assert "a.txt: the same readings are given twice; expected each curve once" in err
    assert [curve.name for curve in read_session("s.h5").curves] == ["a.txt", "b.txt"]


@pytest.mark.parametrize(
    "command",
    [["replay", "s.h5"], ["compare", "s.h5", "s.h5"], ["export", "s.h5", "p", "--to=parameters"]],
)
def test_a_database_that_is_asked_for_is_used_where_nothing_was_identified(call, command):
    assert call("import", "a.txt", *SKIN, "--out", "s.h5")[0] == 0
    status, _, err = call(*command, "--database", "a.txt")
    assert status == 3
    assert "a.txt: not readable as HDF5" in err


def test_capture_ends_by_itself(call):
    status, _, err = call("capture", "--port", "sim://", "--seconds", "0", "--out", "c.jsonl")
    assert status == 0
    assert "c.jsonl: 0 bytes from the instrument, 0 bytes from the software" in err
