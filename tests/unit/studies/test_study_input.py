"""Files as people have them: read where nothing is open, else listed with what is wrong."""

from __future__ import annotations

import csv
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from studies import rows_of, study

from skinlab.cli.main import run
from skinlab.errors import InputError
from skinlab.studies.campaigns import tasks_of
from skinlab.studies.facts import checked
from skinlab.studies.labels import doubtful_labels
from skinlab.studies.path_layout import PathLayout, pairs_of
from skinlab.studies.sources import Plan, Source, find_sources
from skinlab.studies.state import State

DOCS = Path(__file__).parents[3] / "docs"
HEAD = ["time_s", "pressure_mbar", "deflection_mm"]
SETUP = ("--aperture-mm", 6, "--thickness-mm", 1.2, "--workers", 1)


@pytest.fixture(scope="module")
def curve(cohort):
    """The rows (n, 3) of a good curve."""
    with (cohort / "P001" / "forearm" / "v1_p1_c1.csv").open(newline="") as stream:
        return np.array(list(csv.reader(stream))[1:], dtype=float)


def write(path, rows, head=HEAD, separator=",", decimal="."):
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [separator.join(f"{v:.9g}".replace(".", decimal) for v in row) for row in rows]
    path.write_text("\n".join([separator.join(head), *lines]) + "\n")


def test_what_nothing_is_open_in_is_read_and_all_else_is_listed_and_counted(curve, tmp_path):
    folder, out = tmp_path / "in", tmp_path / "out"
    for k in range(8):
        noise = np.random.default_rng(k).normal(0, [0, 0, 0.003], curve.shape)
        write(folder / f"subject=P{k}" / "good.csv", curve + noise)
    write(folder / "as_it_is.csv", curve)
    write(folder / "below_zero.csv", curve * [1, -1, 1])
    write(folder / "semicolons.csv", curve, separator=";", decimal=",")
    write(folder / "unit_line.csv", curve)
    head, rest = (folder / "unit_line.csv").read_text().split("\n", 1)
    (folder / "unit_line.csv").write_text(f"{head}\ns,mbar,mm\n{rest}")
    write(folder / "inward.csv", curve * [1, 1, -1])
    there_and_back = np.vstack([curve, curve[-2::-1] * [-1, 1, 1] + [10, 0, 0]])
    write(folder / "kpa.csv", there_and_back * [1, 0.1, 1])
    (folder / "list.csv").write_text('file,program\nkpa.csv,"ramp:100@20,ramp:0@20"\n')
    write(folder / "pascal.csv", curve * [1, 100, 1])
    write(folder / "no_unit.csv", curve, head=["Time", "Pressure", "Deflection"])
    write(folder / "site" / "vented.csv", np.column_stack([curve[:, 0], curve[::-1, 1:]]))
    (folder / "photo.jpg").write_bytes(b"x")
    done = study(folder, "--out", out, *SETUP)
    assert done.return_value == 3
    rows = {row["file"]: row for row in rows_of(out / "curves.csv")}
    read = ("as_it_is.csv", "below_zero.csv", "semicolons.csv", "unit_line.csv")
    values = [float(rows[name]["X1_MPa"]) for name in read]
    assert values == pytest.approx([values[0]] * 4, rel=1e-9)
    reasons = {row["file"]: row["reason"] for row in rows_of(out / "failures.csv")}
    expected = {
        "inward.csv": "answer it with `skinlab import`, by --deflection-sign",
        "kpa.csv": "does not follow its program ramp:100@20,ramp:0@20: it goes to 10 mbar",
        "pascal.csv": "is its unit right?",
        "no_unit.csv": "the unit of the time (column 'Time') is not known; answer it with",
        "site/vented.csv": "to fit in phases load",
        "photo.jpg": "left alone",
    }
    assert reasons.keys() == expected.keys()
    assert all(expected[name] in reason for name, reason in reasons.items())
    assert rows["site/vented.csv"]["error"] in reasons["site/vented.csv"]
    document = json.loads((out / "study.json").read_text())
    told = (DOCS / "study.md").read_text(encoding="utf-8").partition("## study.json")[2]
    assert [key for key in document if key != "schema" and f"`{key}`" not in told] == []
    counts = ("curves", "curves_identified", "curves_copied", "files_not_used", "files_left_alone")
    assert [document[name] for name in counts] == [13, 12, 3, 5, 1]
    assert f"12 of 13 curves identified: {out / 'curves.csv'}" in done.output
    assert f"5 files could not be used, see {out / 'failures.csv'}" in done.output
    prior = tomllib.loads((out / "study.toml").read_text())
    assert (prior["people"], prior["curves"]) == (8, 8)
    assert prior["source"] == "out, 12 of 13 curves identified"


@pytest.mark.parametrize("column", ["Subject", "File"])
def test_samples_with_a_column_that_says_whose_they_are_are_a_curve(curve, column, tmp_path):
    """They had been a table of people, and of files: the curve was dropped without a word."""
    folder = tmp_path / "in"
    write(folder / "c.csv", curve, head=["Time (s)", "Pressure (mbar)", "Deflection (mm)"])
    head, *rows = (folder / "c.csv").read_text().splitlines()
    text = [f"{head},{column}", *(f"{row},P1" for row in rows)]
    (folder / "c.csv").write_text("\n".join(text) + "\n")
    (folder / "people.csv").write_text("subject,blood pressure (mmHg),height (cm)\nP1,120,180\n")
    done = study(folder, "--out", tmp_path / "out", *SETUP)
    assert done.return_value == 0, done.output
    assert [row["file"] for row in rows_of(tmp_path / "out" / "curves.csv")] == ["c.csv"]


def test_a_layout_is_of_the_whole_path_inside_each_folder(curve, tmp_path):
    for folder, person, site in (("a", "P1", "arm"), ("b", "P2", "leg"), ("b", "P3", "leg")):
        write(tmp_path / folder / person / site / "v1.csv", curve)
    write(tmp_path / "b" / "2026" / "P4" / "leg" / "v1.csv", curve)
    out = tmp_path / "out"
    folders = (tmp_path / "a", tmp_path / "b")
    done = study(*folders, "--out", out, "--layout", "{subject}/{site}/v{visit}", *SETUP)
    rows = rows_of(out / "curves.csv")
    assert [(r["file"], r["subject"], r["site"]) for r in rows] == [
        ("a/P1/arm/v1.csv", "P1", "arm"),
        ("b/P2/leg/v1.csv", "P2", "leg"),
        ("b/P3/leg/v1.csv", "P3", "leg"),
    ]
    (failure,) = rows_of(out / "failures.csv")
    assert failure["file"] == "b/2026/P4/leg/v1.csv"
    assert "does not say what 2026/ is" in failure["reason"]
    assert "{any}/{subject}/{site}/v{visit}" in failure["reason"]
    assert done.return_value == 3


@pytest.mark.parametrize(
    ("layout", "path", "found"),
    [
        ("{any}/{subject}/v{visit}", "x/P1/v2", {"subject": "P1", "visit": "2"}),
        ("{subject}_{any}", "P1_scan_3", {"subject": "P1"}),
        ("{any}_{subject}", "scan_3_P1", {"subject": "P1"}),
        ("{subject}/v{visit}", "x/P1/v2", "or {any}/{subject}/v{visit} if"),
        ("{subject}/{site}/{visit}", "P1/v2", "the whole path inside the folder"),
        ("{subject}_{site}", "P_1_arm", "two ways: subject may be 'P' or 'P_1'"),
        ("{subject}/{site}_{visit}", "P_1/arm_2", {"subject": "P_1", "site": "arm", "visit": "2"}),
    ],
)
def test_a_path_fits_a_layout_in_one_way_or_a_sentence_says_why(layout, path, found):
    if isinstance(found, dict):
        assert PathLayout.of(layout).facts(path) == found
        return
    with pytest.raises(InputError) as refused:
        PathLayout.of(layout).facts(path)
    assert found in str(refused.value)


def test_parts_of_a_path_that_contradict_each_other_are_refused():
    assert pairs_of("subject=P1/site=arm,visit=2/who=x") == {
        "subject": "P1",
        "site": "arm",
        "visit": "2",
    }
    assert pairs_of("subject=P1/subject=P1") == {"subject": "P1"}
    with pytest.raises(InputError, match="subject=P1 and subject=P2 in one path"):
        pairs_of("subject=P1/subject=P2/c")


def test_a_wrong_option_is_refused_before_anything_is_lost(curve, tmp_path):
    write(tmp_path / "in" / "c.csv", curve)
    study(tmp_path / "in", "--out", tmp_path / "out", *SETUP)
    before = (tmp_path / "out" / "curves.csv").read_bytes()
    wrong = ("--aperture-mm", 0.6, "--thickness-mm", 1)
    with pytest.raises(InputError, match=r"stated for all files: aperture_mm 0\.6"):
        study(tmp_path / "in", "--out", tmp_path / "out", *wrong)
    study(tmp_path / "in", "--out", tmp_path / "out", *SETUP)
    assert (tmp_path / "out" / "curves.csv").read_bytes() == before


def test_a_curve_counts_once_however_its_files_are_called(curve, tmp_path):
    folder, out = tmp_path / "in", tmp_path / "out"
    write(folder / "a_raw.csv", curve)
    write(folder / "b" / "subject=P1" / "c.csv", curve, separator=";")
    write(folder / "b" / "subject=P2" / "c.csv", curve)
    write(folder / "b" / "subject=P2" / "other.csv", curve * [1, 1, 1.1])
    told = ["--aperture-mm", "6", "--thickness-mm", "1.2", "--subject", "P-1"]
    assert run(["import", str(folder / "a_raw.csv"), *told, "--out", str(folder / "v.h5")]) == 0
    done = study(folder, "--out", out, *SETUP)
    same = {row["file"]: row["same_as"] for row in rows_of(out / "curves.csv")}
    first = "b/subject=P1/c.csv"  # nobody stated whose a_raw.csv is
    others = dict.fromkeys(("a_raw.csv", "b/subject=P2/c.csv", "v.h5"), first)
    assert same == {first: "", "b/subject=P2/other.csv": "", **others}
    assert "3 curves a second time (same_as)" in done.output
    says = f"b/subject=P2/c.csv has the same readings as {first}, and another subject"
    assert says in done.output
    with State(out) as state:
        files = {path for task in tasks_of(state, "") for path, _ in task.files}
    assert files == {str(folder / name) for name in (first, "b/subject=P2/other.csv")}
    assert any(says in note for note in json.loads((out / "study.json").read_text())["notes"])


def test_a_folder_without_curves_is_no_study_and_loses_none(curve, tmp_path):
    good, empty, out = tmp_path / "good", tmp_path / "empty", tmp_path / "out"
    write(good / "c.csv", curve)
    empty.mkdir()
    (empty / "photo.jpg").write_bytes(b"x")
    study(good, "--out", out, *SETUP)
    before = (out / "curves.csv").read_bytes()
    with pytest.raises(InputError, match=r"empty: no curve is in it; expected \.asc"):
        study(empty, "--out", out, *SETUP)
    assert (out / "curves.csv").read_bytes() == before
    done = study(good, empty, "--out", tmp_path / "both", *SETUP)
    assert done.return_value == 3
    assert [r["file"] for r in rows_of(tmp_path / "both" / "curves.csv")] == ["good/c.csv"]
    reasons = {r["file"]: r["reason"] for r in rows_of(tmp_path / "both" / "failures.csv")}
    assert "no curve is in it" in reasons["empty"]


def test_the_folder_of_another_study_is_left_alone(curve, tmp_path):
    write(tmp_path / "in" / "c.csv", curve)
    study(tmp_path / "in", "--out", tmp_path / "in" / "first", *SETUP)
    done = study(tmp_path / "in", "--out", tmp_path / "second", *SETUP)
    assert done.return_value == 0
    (alone,) = rows_of(tmp_path / "second" / "failures.csv")
    assert (alone["file"], alone["reason"][:10]) == ("first", "left alone")


def test_a_table_as_a_spreadsheet_saves_it_is_read(curve, tmp_path):
    write(tmp_path / "in" / "c.csv", curve)
    (tmp_path / "in" / "list.csv").write_text(
        "File;Subject;Thickness_mm;aperture_mm;score\nc.csv;P1;1,25;6;2,5\n"
    )
    study(tmp_path / "in", "--out", tmp_path / "out", "--workers", 1)
    (row,) = rows_of(tmp_path / "out" / "curves.csv")
    assert (row["subject"], float(row["thickness_mm"]), row["score"]) == ("P1", 1.25, "2.5")


def test_a_file_outside_of_a_tables_folder_is_told(tmp_path):
    """Its row was left aside in silence, and with it whose curve it is."""
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "c.csv").write_text("time_s,pressure_mbar,deflection_mm\n")
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "t.csv").write_text("file,subject\n../a/c.csv,P1\n")
    plan = Plan((tmp_path,), {"aperture_mm": 6, "thickness_mm": 1}, None, tmp_path / "out")
    found = {one.name: one.error for one in find_sources(plan) if isinstance(one, Source)}
    assert found["a/c.csv"] is None
    assert found["b/t.csv"] == (
        f"{tmp_path}/b/t.csv: line 2: ../a/c.csv is outside of the table's folder; expected a "
        "file in it"
    )


def test_a_cycle_is_a_whole_number():
    with pytest.raises(
        InputError, match=r"t\.csv: line 2: cycle is '1\.0', expected a whole number"
    ):
        checked({"cycle": "1.0"}, "t.csv: line 2")


def test_labels_that_may_be_wrong_are_said():
    text = {
        "file": ["a", "b", "c", "d"],
        "same_as": ["", "", "", "b"],
        "subject": ["P1", "p1", "P2", "p1"],
        "site": ["arm", "left arm", "leftarm", "left arm"],
        "visit": [""] * 4,
        "operator": [""] * 4,
        "probe": [""] * 4,
    }
    columns = {name: np.array(values, dtype=str) for name, values in text.items()}
    assert doubtful_labels(columns, {}) == [
        "subject: P1, p1 are taken for different ones; write one alike",
        "site: left arm, leftarm are taken for different ones; write one alike",
    ]
    people = {
        "P1": {"age_years": "3_0", "sex": "w"},
        "P2": {"age_years": "30", "sex": "m"},
        "P9": {"sex": "x"},
    }
    assert doubtful_labels(columns, people)[2:] == [
        "a table of people names P9, of whom there is no curve",
        "the tables of people do not name p1",
        "P1: age_years is '3_0', expected a number; it is not used",
        "sex is 'w' of P1; expected f or m: no range of women or of men counts them",
    ]
