"""The tidy table: every file at any depth, once, whatever happens to the process."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from studies import rows_of, study

from skinlab.cli.main import cli
from skinlab.curves.campaign import read_campaign
from skinlab.errors import InputError
from skinlab.exchange.export import export
from skinlab.inference.identify import Identifier
from skinlab.recording.audit import Chain, note
from skinlab.recording.session import example_session, read_session, write_session
from skinlab.studies.compute import Task, compute, curves_and_noise, draws_of
from skinlab.studies.facts import pseudonym
from skinlab.studies.make_study import COLUMNS
from skinlab.studies.path_layout import PathLayout
from skinlab.studies.state import State
from skinlab.studies.table import Placements
from skinlab.versions import versions


def test_every_curve_is_a_row_and_every_broken_file_has_a_reason(cohort, made):
    out, done = made
    assert done.return_value == 3
    document = json.loads(done.stdout)
    rows, listed = rows_of(out / "curves.csv"), rows_of(cohort / "curves.csv")
    good = [r for r in listed if not r["file"].startswith("broken/")]
    assert [r["file"] for r in rows] == sorted(r["file"] for r in good)
    known = {r["file"]: r for r in good}
    for row in rows:
        for name in ("subject", "site", "visit", "operator", "probe", "placement", "program"):
            assert row[name] == known[row["file"]][name]
        low, value, high = (float(row[f"X1_MPa{e}"]) for e in ("_low", "", "_high"))
        assert low <= value <= high
        assert row["model_hash"].startswith("sha256:")
        assert len(row["sha256"]) == 64
        assert float(row["age_years"]) >= 20
    failures = rows_of(out / "failures.csv")
    assert document["failures"] == failures
    assert {f["file"] for f in failures} == {r["file"] for r in listed} - set(known)
    assert all(f["file"].split("/")[-1] in f["reason"] for f in failures)
    assert document["curves"] == len(rows)


def test_parquet_has_the_same_table(made):
    out, _ = made
    table = pq.read_table(out / "curves.parquet").to_pylist()
    rows = rows_of(out / "curves.csv")
    assert [r["file"] for r in table] == [r["file"] for r in rows]
    assert [r["X2_MPa"] for r in table] == [float(r["X2_MPa"]) for r in rows]
    assert isinstance(table[0]["cycle"], int)
    assert table[0]["partial"] is False


def test_files_are_for_their_owner_only(made):
    out, _ = made
    assert all(path.stat().st_mode & 0o077 == 0 for path in out.iterdir())


@pytest.mark.long
def test_a_wanted_change_is_answered_with_the_number_of_repeats(cohort, made, tmp_path):
    out = tmp_path / "again"
    shutil.copytree(made[0], out)
    done = study(cohort, "--out", out, "--workers", 1, "--mdc-percent", 10)
    row = next(
        row for row in json.loads((out / "study.json").read_text())["repeats"]
        if row["quantity"] == "X1_MPa" and row["facet"] == "placement"
    )  # fmt: skip
    curve = next(
        float(r["value"]) for r in rows_of(out / "agreement.csv")
        if r["quantity"] == "X1_MPa" and r["facet"] == "placement" and r["k"] == "1"
        and r["measure"] == "MDC95" and r["scale"] == "log"
    )  # fmt: skip
    assert row["repeats"] == math.ceil((curve / math.log(1.1)) ** 2 - 1e-9)
    assert f"{row['repeats']} placement" in done.output
    with pytest.raises(InputError, match="--mdc-percent 0: expected more than 0"):
        study(cohort, "--out", out, "--mdc-percent", 0)


def test_only_what_changed_is_computed_again(cohort, made, tmp_path):
    folder, out = tmp_path / "curves", tmp_path / "study"
    shutil.copytree(cohort, folder)
    shutil.copytree(made[0], out)
    before = (out / "curves.csv").read_bytes()
    times = _stamps(out)
    study(folder, "--out", out, "--workers", 1)
    assert (out / "curves.csv").read_bytes() == before
    assert _stamps(out) == times
    changed = folder / "P001" / "forearm" / "v1_p1_c1.csv"
    text = changed.read_text().replace("0.05,", "0.051,", 1)
    changed.write_text(text)
    (folder / "P002" / "forearm" / "v1_p1_c1.csv").unlink()
    listed = (folder / "curves.csv").read_text().replace("P003,forearm,1,op2", "P003,forearm,1,op1")
    (folder / "curves.csv").write_text(listed)  # a label is no reason to compute again
    study(folder, "--out", out, "--workers", 1)
    after = _stamps(out)
    assert {n for n in after if after[n] != times.get(n)} == {"P001/forearm/v1_p1_c1.csv"}
    rows = rows_of(out / "curves.csv")
    assert "P002/forearm/v1_p1_c1.csv" not in {r["file"] for r in rows}
    assert not any(
        r["operator"] == "op2" for r in rows if r["subject"] == "P003" and r["visit"] == "1"
    )
    reasons = {f["file"]: f["reason"] for f in rows_of(out / "failures.csv")}
    assert "not there" in reasons["P002/forearm/v1_p1_c1.csv"]


def _stamps(out):
    """Return the hash that each file's rows were computed from."""
    with closing(sqlite3.connect(out / "study.sqlite")) as state:
        return dict(state.execute("SELECT name, done FROM source WHERE error IS NULL"))


@pytest.mark.long
def test_a_killed_study_goes_on_and_ends_in_the_same_bytes(cohort, made, tmp_path):
    out = tmp_path / "study"
    command = [sys.executable, "-m", "skinlab", "study", str(cohort), "--out", str(out)]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    kept = 0
    for _ in range(2):
        process = subprocess.Popen(
            [*command, "--workers", "2", "--resume"],
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        while process.poll() is None and _kept(out) < kept + 4:
            time.sleep(0.05)
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert _kept(out) > kept or process.returncode != -signal.SIGKILL
        kept = _kept(out)
    last = subprocess.run([*command, "--workers", "1", "--resume"], env=environment, check=False)
    assert last.returncode == 3
    assert (out / "curves.csv").read_bytes() == (made[0] / "curves.csv").read_bytes()
    assert (out / "components.csv").read_bytes() == (made[0] / "components.csv").read_bytes()


def _kept(out):
    """Return how many curves are kept; copied, because the study holds its own file."""
    path = out / "study.sqlite"
    if not path.exists():
        return 0
    copy = out.parent / "look"
    shutil.rmtree(copy, ignore_errors=True)
    try:
        shutil.copytree(out, copy)
        with closing(sqlite3.connect(copy / "study.sqlite")) as state:
            return state.execute("SELECT COUNT(*) FROM curve").fetchone()[0]
    except (sqlite3.Error, OSError, shutil.Error):
        return 0


def test_every_kind_of_broken_file_is_listed_and_nothing_stops_the_rest(cohort, tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    one = (cohort / "P001" / "forearm" / "v1_p1_c1.csv").read_text()
    (folder / "good.csv").write_text(one)
    head, *lines = one.splitlines()
    contents = {
        "empty.csv": b"",
        "binary.csv": np.random.default_rng(1).bytes(5000),
        "zeros.csv": bytes(5000),
        "half.csv": one[: len(one) // 30].encode(),
        "nan.csv": "\n".join([head, *lines[:5], "0.25,nan,0.1", *lines[6:]]).encode(),
        "names.csv": one.replace("deflection_mm", "deflection").encode(),
        "page.csv": b"<html><body>Not found</body></html>",
        "json.csv": b'{"time_s": [1, 2, 3]}',
        "table.csv": b"subject,age\nP1," + b"9" * 200_000 + b"\n",
        "file.csv": b'file,aperture_mm\n"' + b"x" * 200_000 + b"\n",
        "long.csv": (head + "\n" + "1," * 100_000).encode(),
        "book.xlsx": b"PK\x03\x04" + np.random.default_rng(1).bytes(500),
        "session.h5": b"\x89HDF\r\n\x1a\n" + np.random.default_rng(1).bytes(500),
        "campaign.toml": b"[campaign]\n[[curve]]\nnone = 1\n",
        "visit.journal": b"{}",
        "notes.json": b"{}",
        "latin.csv": "Zeit;Höhe\n1;2\n".encode("latin-1"),
    }
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    (folder / "folder.csv").mkdir()
    (folder / "nowhere.csv").symlink_to(folder / "gone.csv")
    (folder / "itself.csv").symlink_to(folder / "itself.csv")
    (folder / "above").symlink_to(tmp_path, target_is_directory=True)
    os.mkfifo(folder / "pipe.csv")
    with (folder / "huge.csv").open("wb") as huge:
        huge.write(head.encode() + b"\n")
        huge.truncate(65 << 20)
    links = {"folder.csv", "nowhere.csv", "itself.csv", "above", "pipe.csv", "huge.csv"}
    setup = ("--aperture-mm", 6, "--thickness-mm", 1.2)
    done = study(folder, "--out", tmp_path / "out", "--workers", 1, *setup)
    assert done.return_value == 3
    assert [r["file"] for r in rows_of(tmp_path / "out" / "curves.csv")] == ["good.csv"]
    reasons = {r["file"]: r["reason"] for r in rows_of(tmp_path / "out" / "failures.csv")}
    assert set(reasons) == {*contents, *links}
    assert not any("internal error" in reason for reason in reasons.values())
    assert all(name in reason for name, reason in reasons.items())
    assert "larger than 64 MB" in reasons["huge.csv"]
    assert not any(str(tmp_path) in reason for reason in reasons.values())
    head = (tmp_path / "out" / "components.csv").read_text().splitlines()
    assert head == [COLUMNS["components.csv"].replace(" ", ",")]  # of one curve
    assert "link to a folder" in reasons["above"]
    assert reasons["notes.json"].startswith("left alone: ")
    assert "22 files could not be used" in done.output
    assert "1 file left alone" in done.output


def test_files_of_other_kinds_are_listed_and_no_failure(cohort, tmp_path):
    (tmp_path / "in").mkdir()
    shutil.copy(cohort / "P001" / "forearm" / "v1_p1_c1.csv", tmp_path / "in" / "c.csv")
    (tmp_path / "in" / "photo.jpg").write_bytes(b"x")
    setup = ("--aperture-mm", 6, "--thickness-mm", 1.2)
    done = study(tmp_path / "in", "--out", tmp_path / "out", "--workers", 1, *setup)
    assert done.return_value == 0
    assert [r["file"] for r in rows_of(tmp_path / "out" / "failures.csv")] == ["photo.jpg"]


@pytest.mark.long
def test_where_nothing_is_new_no_file_is_made_again(cohort, made, tmp_path):
    out, first = made
    marks = {path.name: path.stat().st_ino for path in out.iterdir()}
    again = study(cohort, "--out", out, "--workers", 1, "--json")
    assert again.stdout == first.stdout
    assert again.return_value == first.return_value
    left = {path.name for path in out.iterdir() if path.stat().st_ino == marks[path.name]}
    assert left >= {"report.html", "study.json", "agreement.csv", "ro-crate-metadata.json"}
    out = tmp_path / "study"
    shutil.copytree(made[0], out)
    (out / "agreement.csv").write_text("mine")
    (out / "trends.csv").unlink()
    study(cohort, "--out", out, "--workers", 1)
    for name in ("agreement.csv", "trends.csv", "report.html"):
        assert (out / name).read_bytes() == (made[0] / name).read_bytes()


def test_other_settings_are_refused_with_resume_and_computed_again_without(cohort, made, tmp_path):
    out = tmp_path / "study"
    shutil.copytree(made[0], out)
    with pytest.raises(InputError, match="seed: 0 then, 7 now"):
        study(cohort, "--out", out, "--workers", 1, "--resume", "--seed", 7)


@pytest.mark.parametrize("what", ["numpy", "code", "plugin mine"])
def test_what_other_software_computed_is_not_gone_on_with(
    cohort, made, tmp_path, monkeypatch, what
):
    """Rows had stayed when a plugin's error model changed, and stated the numpy of now."""
    out = tmp_path / "study"
    shutil.copytree(made[0], out)
    now = versions()
    monkeypatch.setattr("skinlab.studies.run.versions", lambda: now | {what: "another"})
    with pytest.raises(InputError, match=f"{what}: .* then, another now"):
        study(cohort, "--out", out, "--workers", 1, "--resume")


def test_two_studies_do_not_write_to_one_folder(cohort, made, tmp_path):
    out = tmp_path / "study"
    with State(out), pytest.raises(InputError, match="one at a time"):
        study(cohort, "--out", out, "--workers", 1)


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="asks Linux for open files")
def test_a_study_that_is_refused_is_not_kept_open(tmp_path):
    with State(tmp_path):
        pass
    with closing(sqlite3.connect(tmp_path / "study.sqlite")) as db, db:
        db.execute("UPDATE meta SET value = 'another' WHERE name = 'schema'")
    with pytest.raises(InputError, match="another; expected") as refused:
        State(tmp_path)
    held = [os.readlink(x) for x in Path("/proc/self/fd").iterdir() if x.exists()]
    assert not any(name.startswith(str(tmp_path)) for name in held), refused


def test_a_folder_of_something_else_is_left_alone(cohort, tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(InputError, match="not empty, and no study"):
        study(cohort, "--out", tmp_path)


@pytest.mark.long
def test_sessions_campaigns_exports_and_paths_say_whose_curves_they_are(cohort, tmp_path):
    folder = tmp_path / "in"
    one = (cohort / "P001" / "forearm" / "v1_p1_c1.csv").read_text()
    for path in ("subject=A1/site=cheek/visit=2/c.csv", "B2/back/v3_p4.csv", "plain/x.csv"):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(one + "\n")
    german = folder / "D1" / "export.txt"
    german.parent.mkdir()
    lines = [line.split(",") for line in one.splitlines()[1:]]
    german.write_text(
        "Zeit [s]\tDruck [mbar]\tHöhe [mm]\n"
        + "\n".join("\t".join(v.replace(".", ",") for v in row) for row in lines),
        encoding="latin-1",
    )
    (folder / "camp").mkdir()
    (folder / "camp" / "d.csv").write_text(one)
    (folder / "camp" / "campaign.toml").write_text(
        '[campaign]\ntitle = "x"\n[[curve]]\nfile = "d.csv"\naperture_mm = 6.0\n'
        'thickness_mm = 1.5\nsubject = "C3"\nprogram = "ramp:100@20"\n'
    )
    (folder / "names.csv").write_text("subject,group\nA1,control\n")
    (folder / ".hidden.csv").write_text("no")
    (tmp_path / "x.csv").write_text(one)
    CliRunner().invoke(
        cli,
        f"import {tmp_path / 'x.csv'} --aperture-mm 6 --thickness-mm 1.1 --subject E5 --site leg "
        f"--placement left --out {folder / 'visit.h5'}",
    )
    assert read_session(folder / "visit.h5").meta["subject"] == "E5"
    out = tmp_path / "out"
    study(folder, "--out", out, "--workers", 1, "--aperture-mm", 6, "--thickness-mm", 1.2)
    rows = {r["file"]: r for r in rows_of(out / "curves.csv")}
    by_path = rows["subject=A1/site=cheek/visit=2/c.csv"]
    assert (by_path["subject"], by_path["site"], by_path["visit"]) == ("A1", "cheek", "2")
    assert by_path["group"] == "control"
    assert rows["camp/d.csv"]["subject"] == "C3"
    assert float(rows["camp/d.csv"]["thickness_mm"]) == 1.5
    assert (rows["visit.h5"]["subject"], rows["visit.h5"]["site"]) == ("E5", "leg")
    assert float(rows["visit.h5"]["thickness_mm"]) == 1.1
    assert rows["visit.h5"]["placement"] == "left"
    assert rows["visit.h5"]["visit"] == "visit.h5"  # nobody said the day
    same = float(rows["camp/d.csv"]["X1_MPa"]), float(rows["D1/export.txt"]["X1_MPa"])
    assert same[0] != same[1]  # another thickness
    assert rows["D1/export.txt"]["error"] == ""
    # The same readings, of which somebody stated whose they are.
    assert rows["plain/x.csv"]["same_as"] == rows["B2/back/v3_p4.csv"]["same_as"] == "camp/d.csv"
    layout = tmp_path / "layout"
    done = study(
        folder / "B2", "--out", layout, "--workers", 1, "--aperture-mm", 6, "--thickness-mm", 1.2,
        "--layout", "{site}/v{visit}_p{placement}", "--json",
    )  # fmt: skip
    row = rows_of(layout / "curves.csv")[0]
    assert (row["site"], row["visit"], row["placement"]) == ("back", "3", "4")
    assert json.loads(done.stdout)["curves"] == 1


def test_without_aperture_a_curve_is_listed_and_the_sentence_says_what_to_do(cohort, tmp_path):
    (tmp_path / "in").mkdir()
    shutil.copy(cohort / "P001" / "forearm" / "v1_p1_c1.csv", tmp_path / "in" / "c.csv")
    study(tmp_path / "in", "--out", tmp_path / "out", "--workers", 1)
    (failure,) = rows_of(tmp_path / "out" / "failures.csv")
    assert "aperture_mm and thickness_mm" in failure["reason"]
    assert "or both stated for all curves" in failure["reason"]


def test_a_wrong_value_in_a_table_names_its_line(cohort, tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    shutil.copy(cohort / "P001" / "forearm" / "v1_p1_c1.csv", folder / "c.csv")
    (folder / "list.csv").write_text("file;aperture_mm;thickness_mm\nc.csv;5;1\n")
    study(folder, "--out", tmp_path / "out", "--workers", 1)
    (failure,) = rows_of(tmp_path / "out" / "failures.csv")
    assert "line 2: aperture_mm 5: no probe has this opening" in failure["reason"]


def test_a_layout_says_what_is_wrong_with_it():
    for wrong in ("{who}", "plain", "{site}/{site}"):
        with pytest.raises(InputError, match=r"^layout "):
            PathLayout.of(wrong)


def test_names_do_not_reach_the_table():
    assert pseudonym("P-017") == "P-017"
    code = pseudonym("Anna Meier")
    assert code == pseudonym("Anna Meier") != pseudonym("Anna Maier")
    assert code.startswith("S")
    assert code[1:].isdigit()


def test_placements_begin_where_cycles_do_not_go_up_and_stated_ones_stay():
    one = {"subject": "P1", "visit": "1", "site": "a", "operator": "", "probe": ""}
    placements = Placements()
    rows = [{**one, "aperture_mm": 6.0, "cycle": c, "placement": None} for c in (1, 2, 1, 1, 2)]
    assert [placements.of(r) for r in rows] == ["1", "1", "2", "3", "3"]
    # Of preconditioned skin no curve is of a first cycle.
    later = [{**one, "aperture_mm": 2.0, "cycle": c, "placement": None} for c in (4, 5, 4, 4)]
    assert [placements.of(r) for r in later] == ["1", "1", "2", "3"]
    assert placements.of({**rows[0], "placement": "x"}) == "x"
    assert placements.of({**rows[0], "subject": "P2"}) == "1"


def test_draws_stand_for_their_weights():
    class Result:
        class uncertainty:  # noqa: N801 -- stands for an attribute
            class draws:  # noqa: N801
                parameters = np.array([[1.0, 5.0], [2.0, 6.0], [3.0, 7.0]])
                weight = np.array([0.5, 0.25, 0.25])

        parameters = {"a": 1, "b": 2}  # noqa: RUF012

    drawn = draws_of(Result, 8)
    assert drawn.tolist() == [[1, 5]] * 4 + [[2, 6]] * 2 + [[3, 7]] * 2


@pytest.mark.filterwarnings("ignore")  # dask's own
def test_a_dask_cluster_gives_the_same_table(cohort, made, tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        study(cohort, "--out", tmp_path / "study", "--dask", cluster.scheduler_address)
    table = (tmp_path / "study" / "curves.csv").read_bytes()
    assert table == (made[0] / "curves.csv").read_bytes()


def test_without_dask_a_sentence_says_what_to_install(cohort, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'skinlab\[dask\]'"):
        study(cohort, "--out", tmp_path / "study", "--dask", "tcp://127.0.0.1:8786")


def test_without_pictures_all_else_is_written(cohort, made, tmp_path, monkeypatch):
    out = tmp_path / "study"
    shutil.copytree(made[0], out)
    monkeypatch.setattr("skinlab.studies.make_study.have_pictures", lambda: False)
    done = study(cohort, "--out", out, "--workers", 1)
    assert "pip install 'skinlab[pictures]'" in done.stderr
    assert not (out / "report.html").exists()
    assert (out / "components.csv").read_bytes() == (made[0] / "components.csv").read_bytes()
    assert "report.html" not in json.loads((out / "study.json").read_text())["files"]


def test_what_its_operator_left_out_of_a_session_is_in_no_study(tmp_path, table):
    """Its row was one of the person's."""
    session, path = read_session(example_session()), tmp_path / "visit.h5"
    records = list(session.records)
    for curve in (2, 1):
        deed = note(9e9, 9e9, "me", "curve excluded", {"curve": curve, "text": "a loose tape"})
        records.append(Chain(records).add(deed))
        write_session(path, replace(session, records=tuple(records)), replace=True)
        (found,) = compute(Identifier(table, method="lm"), [Task(1, path, {})])
        if curve == 2:
            assert [json.loads(row.text)["curve"] for row in found.rows] == ["curve 1"]
            assert [one.name for one in curves_and_noise(path, {})[0]] == ["curve 1"]
    assert found.rows == ()
    assert found.error.endswith("left out by who measured them; expected one at least")


def test_the_export_of_a_session_is_studied_as_the_session(tmp_path):
    """Its table did not say whose the curves are; what was left out or cut short counted."""
    session, path = read_session(example_session()), tmp_path / "in" / "visit.h5"
    first, second = session.curves
    numbers = ("time_s", "pressure_mbar", "deflection_mm")
    begun = {name: getattr(first, name)[:60] for name in numbers}
    cut = replace(first, name="curve 3", partial=True, segment=None, **begun)
    deed = note(9e9, 9e9, "me", "curve excluded", {"curve": 2, "text": "a loose tape"})
    records = (*session.records, Chain(session.records).add(deed))
    path.parent.mkdir()
    curves, results = (first, second, cut), (*session.results, None)
    write_session(path, replace(session, records=records, curves=curves, results=results))
    files = export(read_session(path), "csv", tmp_path / "exported")
    whose = ("subject", "site", "visit", "operator", "probe", "partial", "X1_MPa")
    told = []
    for folder in ("in", "exported"):
        done = study(tmp_path / folder, "--out", tmp_path / f"{folder}_out", "--workers", 1)
        rows = rows_of(tmp_path / f"{folder}_out" / "curves.csv")
        told.append([tuple(row[name] for name in whose) for row in rows])
        assert done.return_value == 0, done.output
    assert told[0] == told[1]
    assert [row[:3] for row in told[0]] == [("SIM-1", "simulated forearm", told[0][0][2])] * 2
    assert [row[5] for row in told[0]] == ["false", "true"]
    (failure,) = rows_of(tmp_path / "exported_out" / "failures.csv")
    assert failure["reason"].endswith("curve_0002.csv: its operator left it out: a loose tape")
    assert failure["reason"].startswith("left alone: ")
    together = read_campaign(next(f for f in files if f.suffix == ".toml"))
    assert [Path(one.name).name for one in together.curves] == ["curve_0001.csv"]
