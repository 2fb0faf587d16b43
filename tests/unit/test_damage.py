"""Files that somebody damaged: a sentence and status 3, in little memory, nothing more lost."""

from __future__ import annotations

import json
import shutil
import sqlite3
import tracemalloc
from importlib.resources import files
from pathlib import Path

import h5py
import numpy as np
import pytest
from crashes import journal_of_example

from sim_device.files import load_skin_file
from skinlab.cli.main import run
from skinlab.curves.program import check_measurable, parse_program
from skinlab.errors import InputError
from skinlab.recording.audit import entries
from skinlab.recording.journal import Journal, read_journal
from skinlab.recording.recorder import recover
from skinlab.recording.records import Kind
from skinlab.recording.session import read_session, read_stored

EXAMPLE = Path(str(files("skinlab") / "data" / "example.h5"))
GEOMETRY = ["--aperture-mm", "6", "--thickness-mm", "1"]
RAMP = "time_s,pressure_mbar,deflection_mm\n" + "".join(
    f"{t / 10},{2 * t},{0.004 * t}\n" for t in range(51)
)


def refused(capfd, *arguments):
    """Return the sentence of a command that must end in status 3."""
    assert run([str(a) for a in arguments]) == 3
    said = capfd.readouterr().err
    assert "Traceback" not in said
    assert "internal error" not in said
    return said


# ---- HDF5 ------------------------------------------------------------------------------------


@pytest.fixture
def session(tmp_path):
    path = tmp_path / "s.h5"
    shutil.copy(EXAMPLE, path)
    return path


@pytest.mark.parametrize("elements", [3 * 10**8, 10**12])
@pytest.mark.parametrize("chunks", [None, (1 << 20,)])
@pytest.mark.parametrize("name", ["curves/0001/deflection_mm", "raw/data", "samples/utc_s"])
def test_sizes_are_looked_at_before_memory_is_taken(session, name, elements, chunks):
    with h5py.File(session, "r+") as file:
        kind = file[name].dtype
        del file[name]
        file.create_dataset(name, shape=(elements,), dtype=kind, chunks=chunks)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=f"{elements} elements"):
            read_stored(session)
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()


def test_the_same_holds_for_databases(tmp_path, capfd):
    path = tmp_path / "d.h5"
    shutil.copy(str(files("skinlab") / "data" / "dimensionless.h5"), path)
    with h5py.File(path, "r+") as file:
        del file["log_compliance"]
        file.create_dataset("log_compliance", shape=(10**6, 10**6, 1, 1), dtype="f4")
    assert "elements" in refused(capfd, "database", "info", path)


def test_a_text_that_is_no_utf_8_in_a_database(tmp_path, capfd):
    path = tmp_path / "d.h5"
    shutil.copy(Path(__file__).parents[1] / "data" / "v0.1" / "custom.h5", path)
    with h5py.File(path, "r+") as file:
        file.attrs.create("solver_version", b"\xff", dtype=h5py.string_dtype())
    assert "damaged" in refused(capfd, "database", "info", path)


@pytest.mark.parametrize("kind", ["i1", "c16", "f2", "S8", "bool"])
@pytest.mark.parametrize("name", ["curves/0001/time_s", "samples/pressure_mbar", "raw/host_time_s"])
def test_data_of_another_type_are_refused(session, name, kind):
    with h5py.File(session, "r+") as file:
        length = len(file[name])
        del file[name]
        file.create_dataset(name, data=np.zeros(length, dtype=kind))
    with pytest.raises(InputError, match=f"{name.split('/')[-1]} is of type"):
        read_stored(session)


def test_links_to_other_files_are_not_followed(session, tmp_path):
    with h5py.File(session, "r+") as file:
        del file["raw/data"]
        file["raw/data"] = h5py.ExternalLink(str(EXAMPLE), "raw/data")
    with pytest.raises(InputError, match="link"):
        read_stored(session)


@pytest.mark.parametrize(
    ("where", "text"),
    [
        ("meta", "[" * 100_000),
        ("meta", json.dumps({"instrument": "text"})),
        ("meta", json.dumps({"imported": 3})),
        ("setup", "{" * 100_000),
        ("setup", "[1]"),
        ("result", json.dumps({"parameters": {"X1_MPa": {"value": "text"}}})),
        ("result", json.dumps({"flags": 7})),
    ],
)
def test_attributes_that_are_not_what_they_should_be(session, where, text):
    with h5py.File(session, "r+") as file:
        owner = file if where == "meta" else file["curves/0001"]
        owner.attrs[where] = text[:60_000]
    with pytest.raises(InputError, match=str(session)):
        read_stored(session)


# ---- text files ------------------------------------------------------------------------------


def test_deep_brackets_in_toml_are_a_sentence(tmp_path, capfd):
    (tmp_path / "c.csv").write_text(RAMP)
    deep = tmp_path / "deep.toml"
    for text in ("x = " + "[" * 50_000, "x = " + "{a=" * 50_000, "[" + "a." * 50_000 + "a]"):
        deep.write_text(text)
        refused(capfd, "identify", deep)
        refused(capfd, "identify", tmp_path / "c.csv", *GEOMETRY, "--model", deep)
        refused(capfd, "database", "build", "--spec", deep, "--out", tmp_path / "d.h5")
        with pytest.raises(ValueError, match=r"deep\.toml"):
            load_skin_file(deep)
        refused(capfd, "capture", "--port", "x", "--dialect", deep, "--out", tmp_path / "c.jsonl")


def test_bytes_that_are_no_text_are_a_sentence(tmp_path, capfd):
    (tmp_path / "c.csv").write_text(RAMP)
    file = tmp_path / "bytes.toml"
    file.write_bytes(b"[law]\xff\xfe")
    expected = f"{file}: byte 6 is not UTF-8; expected a text file"
    assert expected in refused(capfd, "identify", file)
    for option in ("--model", "--probe", "--prior"):
        assert expected in refused(capfd, "identify", tmp_path / "c.csv", *GEOMETRY, option, file)
    said = refused(capfd, "database", "build", "--spec", file, "--out", tmp_path / "d.h5")
    assert expected in said


def test_a_very_large_toml_is_a_sentence(tmp_path, capfd):
    (tmp_path / "m.toml").write_text("# x\n" * (5 << 20))
    assert run(["identify", str(tmp_path / "m.toml")]) == 3
    assert "20 MB of text; expected at most 16 MB" in capfd.readouterr().err


def test_a_zero_character_in_a_campaigns_path(tmp_path, capfd):
    path = tmp_path / "c.toml"
    path.write_text(
        '[campaign]\n[[curve]]\nfile = "a\\u0000b.csv"\naperture_mm = 6\nthickness_mm = 1\n'
    )
    assert "is not a file name" in refused(capfd, "identify", path)


@pytest.mark.parametrize("command", ["identify", "import"])
def test_a_field_of_a_csv_that_is_too_long(tmp_path, capfd, command):
    path = tmp_path / "c.csv"
    path.write_text(RAMP + "9," + "1" * 140_000 + ",1\n")
    out = ["--out", tmp_path / "s.h5"] if command == "import" else []
    refused(capfd, command, path, *GEOMETRY, *out)


def test_lm_on_a_curve_without_suction(tmp_path, capfd):
    path = tmp_path / "c.csv"
    rows = "".join(f"{t / 10},0,0\n" for t in range(51))
    path.write_text("time_s,pressure_mbar,deflection_mm\n" + rows)
    for method in ("lm", "gn", "auto"):
        assert run(["identify", str(path), *GEOMETRY, "--method", method]) in {0, 3}
    assert "internal error" not in capfd.readouterr().err


# ---- programs --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "program",
    [
        "mode2:500@20,2", "ramp:0.0001@0.0001", "ramp:0.05@1",
        "ramp:100@20,ramp:0@20,rest:0.1,ramp:500@10",
    ],
)  # fmt: skip
def test_a_mistake_in_a_program_is_bad_input_not_a_failed_probe(tmp_path, capfd, program):
    out = tmp_path / "s.h5"
    said = refused(
        capfd, "measure", "--port", "sim://?seed=1", *GEOMETRY, "--program", program, "--out", out
    )
    assert "expected at" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "program", ["mode2:100@20,5", "ramp:500@20,release,ramp:500@20", "ramp:100@20"]
)
def test_what_a_driver_takes_is_taken(program):
    check_measurable(parse_program(program))


# ---- journals --------------------------------------------------------------------------------


@pytest.fixture
def journal(tmp_path):
    """A journal of the example's records, as a crash leaves one."""
    path = tmp_path / "s.h5.journal"
    journal_of_example(path).close()
    return path


def change(path, statement, *values):
    db = sqlite3.connect(path)
    db.execute(statement, values)
    db.commit()
    db.close()


def numbers(path, kind):
    db = sqlite3.connect(path)
    found = [n for (n,) in db.execute("SELECT number FROM record WHERE kind = ?", (int(kind),))]
    db.close()
    return found


def test_a_damaged_record_costs_itself(journal, tmp_path, capfd):
    received = numbers(journal, Kind.RECEIVED)
    result = numbers(journal, Kind.RESULT)[0]
    change(journal, "UPDATE record SET kind = 99 WHERE number = ?", received[0])
    change(journal, "UPDATE record SET host_time_s = 'text' WHERE number = ?", received[5])
    change(journal, "UPDATE record SET data = 300000000 WHERE number = ?", received[1])
    change(journal, "UPDATE record SET data = ? WHERE number = ?", b"[" * 100_000, result)
    out = tmp_path / "out.h5"
    assert run(["recover", str(journal), "--out", str(out)]) == 0
    said = capfd.readouterr().err
    for number in (received[0], received[1], received[5], result):
        assert f"record {number}" in said or "a result" in said
    session = read_session(out)
    assert len(session.curves) == 2
    assert [r is None for r in session.results] == [True, False]
    trail = entries(session.records)
    assert trail[-1].what == "recovered"
    assert len(trail[-1].detail["skipped"]) == 4
    kept = [r for r in session.records if r.kind is not Kind.AUDIT]
    example = [r for r in read_session(EXAMPLE).records if r.kind is not Kind.AUDIT]
    assert len(kept) == len(example) - 2


def test_a_plan_that_cannot_be_read_makes_no_curve_of_another_setup(journal, tmp_path):
    plan = numbers(journal, Kind.PLAN)[1]
    change(journal, "UPDATE record SET data = '{}' WHERE number = ?", plan)
    change(journal, "UPDATE record SET data = CAST(data AS BLOB) WHERE number = ?", plan)
    session, skipped = recover(journal, tmp_path / "o.h5")
    assert len(session.curves) == 1
    assert any("a plan" in sentence for sentence in skipped)


def test_pages_that_are_damaged_cost_their_records_only(journal, tmp_path):
    whole = len(read_journal(journal).records)
    raw = bytearray(journal.read_bytes())
    page = int.from_bytes(raw[16:18], "big")
    middle = len(raw) // page // 2 * page
    raw[middle : middle + page] = b"\xff" * page
    journal.write_bytes(raw)
    read = read_journal(journal)
    assert whole - 120 <= len(read.records) < whole
    assert read.skipped


def test_facts_that_are_damaged_are_taken_from_the_audit_trail(tmp_path):
    path = tmp_path / "j"
    writer = Journal(path, {"site": "forearm", "subject": "P7"})
    writer.audit(0.0, "me", "session opened", site="forearm", subject="P7")
    writer.close()
    change(path, "UPDATE meta SET value = '[[[' WHERE key = 'site'")
    read = read_journal(path)
    assert read.meta == {"site": "forearm", "subject": "P7"}
    assert read.skipped


def test_the_second_start_on_one_out_is_told_that_the_first_goes_on(tmp_path, capfd):
    out = tmp_path / "s.h5"
    first = Journal(tmp_path / "s.h5.journal", {})
    said = refused(
        capfd, "measure", "--port", "sim://?seed=1", *GEOMETRY,
        "--program", "ramp:100@20", "--out", out,
    )  # fmt: skip
    assert "recording there now" in said
    assert "skinlab recover" not in said
    assert "recording there now" in refused(capfd, "recover", first.path)
    first.close()
    with pytest.raises(InputError, match="skinlab recover"):
        Journal(first.path, {})
