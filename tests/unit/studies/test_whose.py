"""Whose skin is compared: other people are refused, other sites and unknown people are said."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from skinlab.cli.main import run
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.recording.session import read_session
from skinlab.studies.comparison import section, since
from skinlab.studies.whose import Whose, check_whose
from skinlab.tui.comparing import compare_with

A1, A2 = (Whose(f"a{k}.h5", "P-1", "cheek", file_hash=f"a{k}") for k in (1, 2))
ARM1, ARM2 = (Whose(f"arm{k}.h5", "P-1", "arm", file_hash=f"arm{k}") for k in (1, 2))
B = Whose("b.h5", "P-2", "cheek")
NOBODY = Whose("n.h5", "", "cheek")


def test_one_person_at_one_site_needs_no_word():
    assert check_whose(A1, A2) == ()
    assert check_whose(A1, replace(A2, subject="p-1")) == ()
    assert check_whose(A1, A2, (ARM1, ARM2)) == ()


def test_two_people_are_refused_unless_they_are_asked_for():
    with pytest.raises(InputError, match=r"a1\.h5 is of P-1 and b\.h5 of P-2; .*between-people"):
        check_whose(A1, B)
    (said,) = check_whose(A1, B, between_people=True)
    assert "between two people (P-1 and P-2), not a change" in said
    with pytest.raises(InputError, match="both of P-1; expected two people"):
        check_whose(A1, A2, between_people=True)


@pytest.mark.parametrize("control", [(B, ARM2), (ARM1, B), (B, B)])
def test_a_control_of_another_person_is_refused(control):
    with pytest.raises(InputError, match="expected a control site of the same person"):
        check_whose(A1, A2, control)
    with pytest.raises(InputError, match="same person"):
        check_whose(NOBODY, A2, control)


@pytest.mark.parametrize(
    ("sessions", "control", "says"),
    [
        ((A1, ARM1), None, "The sites differ (cheek and arm)"),
        ((A1, replace(A2, site="")), None, "Nobody stated the site of a2.h5."),
        ((NOBODY, A2), None, "Nobody stated whose skin was measured: n.h5."),
        ((A1, A2), (ARM1, replace(ARM2, site="leg")), "sites of the control differ (arm and leg)"),
        ((A1, A2), (replace(ARM1, site="cheek"), ARM2), "to be a control of: cheek."),
        ((A1, A1), None, "a1.h5 and a1.h5 are one session"),
        ((A1, A2), (ARM1, ARM1), "The control is one session (arm1.h5)"),
        (
            (replace(A1, measured_utc="2026-02-01T09"), A2),
            (replace(ARM1, measured_utc="2026-02-03T09"), ARM2),
            "arm1.h5 was measured on 2026-02-03, a1.h5 on 2026-02-01",
        ),
        ((A1, replace(A2, simulated=True)), None, "Of a simulated skin, unlike the others: a2.h5"),
        (
            (replace(A1, measured_utc="2026-02-01"), replace(A2, measured_utc="2026-01-01")),
            None,
            "a1.h5 was measured after a2.h5",
        ),
    ],
)
def test_what_else_differs_is_said(sessions, control, says):
    assert any(says in sentence for sentence in check_whose(*sessions, control))


@pytest.fixture(scope="module")
def folder(cohort, tmp_path_factory):
    """Sessions of two people, and one of nobody: their names are file, subject and site."""
    folder = tmp_path_factory.mktemp("sessions")
    curves = sorted(cohort.glob("P00*/forearm/*_c1.csv"))
    for curve, name in zip(curves, ("a1 P-1 cheek", "a2 P-1 arm", "b P-2 cheek"), strict=False):
        file, subject, site = name.split()
        told = ["--subject", subject, "--site", site, "--aperture-mm", "6", "--thickness-mm", "1"]
        assert run(["import", str(curve), *told, "--out", str(folder / f"{file}.h5")]) == 0
    return folder


def test_the_command_refuses_other_people_and_a_control_that_is_none(folder, capsys):
    a1, a2, b = (str(folder / f"{name}.h5") for name in ("a1", "a2", "b"))
    copy = shutil.copy(a1, folder / "copy.h5")
    for told, status, says in (
        ([a1, b], 3, "a1.h5 is of P-1 and b.h5 of P-2"),
        ([a1, a2, "--control", b, a1], 3, "control b.h5 is of P-2 and a1.h5 of P-1"),
        ([a1, a2, "--control", copy, a2], 3, "control copy.h5 is the same session as a1.h5"),
        ([a1, b, "--between-people", "--control", a1, b], 2, "exclude each other"),
    ):
        assert run(["compare", *told]) == status
        assert says in capsys.readouterr().err


def test_other_sites_are_said_in_text_json_report_and_on_the_screen(folder, capsys, table):
    a1, a2, b = (folder / f"{name}.h5" for name in ("a1", "a2", "b"))
    says = "The sites differ (cheek and arm): a difference of places is in it."
    assert run(["compare", str(a1), str(a2)]) == 0
    assert capsys.readouterr().out.startswith(f"{says}\n")
    assert run(["compare", str(a1), str(b), "--between-people", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    page = (Path(__file__).parents[3] / "docs/study.md").read_text(encoding="utf-8")
    of_json = page.partition("### compare --json")[2].partition("\n## ")[0]
    whole = (document, document["change"], *document["change"]["parameters"].values())
    whole += tuple(document["parameters"].values())
    named = {key for one in whole for key in one} - {"schema"} - set(document["parameters"])
    assert not [key for key in named if f"`{key}`" not in of_json]
    assert document["schema"] in of_json
    (note,) = document["notes"]
    assert note.startswith("The difference is between two people")
    identifier = Identifier(table)
    assert section(since(identifier, a1, a2)).paragraphs[0].startswith(says)
    curves = read_session(b).curves
    lines = compare_with(a1, curves, identifier, "", None, ("P-2", "cheek")).lines
    assert "between two people (P-1 and P-2)" in lines[1]
