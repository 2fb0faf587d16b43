"""`skinlab identify` of a session whose own results are of a model."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

import skinlab
from skinlab.cli.main import run
from skinlab.errors import InputError
from skinlab.recording.audit import Chain, note
from skinlab.recording.load_inputs import read_campaign_or_session, read_input
from skinlab.recording.session import example_session, read_session, write_session

MODEL = """
[model]
name = "no stiff skin"
[parameters.X1_MPa]
low = 0.005
high = 0.15
"""
OF_A_PLUGIN = MODEL + "[effects.seal_leak.leak_mbar]\nvalue = 3.0\n"


def told(capsys, *arguments):
    status = run(["identify", *map(str, arguments), "--method", "lm"])
    return status, capsys.readouterr().err


def decided(session, *deeds):
    """Return the session with these decisions of its operator: (what, curve, why)."""
    records = list(session.records)
    for what, curve, text in deeds:
        entry = note(9e9, 9e9, "me", what, {"curve": curve, "text": text})
        records.append(Chain(records).add(entry))
    return replace(session, records=tuple(records))


@pytest.fixture
def measured(tmp_path):
    """Write the example session as one that was measured with these settings."""
    session = read_session(example_session())

    def write(**settings):
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}.h5"
        known = session.meta["identification"] | settings
        write_session(path, replace(session, meta=session.meta | {"identification": known}))
        return path

    return write


@pytest.mark.parametrize("text", [MODEL, OF_A_PLUGIN], ids=["model", "of a plugin that is gone"])
def test_answers_by_the_law_alone_are_told_where_the_session_has_others(measured, capsys, text):
    """Only `model.name` of the JSON told them apart."""
    path = measured(model=text)
    says = f"skinlab: {path}: its own results are of the model 'no stiff skin', these are by the "
    assert told(capsys, path) == (0, f"{says}law alone; --model FILE gives the others\n")
    of_database = measured(model=text, database_path="/data/own.h5")
    assert told(capsys, of_database)[1].endswith("; --database /data/own.h5 gives the others\n")


def test_nothing_is_told_of_a_session_by_the_law_or_of_answers_by_a_model(
    measured, tmp_path, capsys
):
    model = tmp_path / "model.toml"
    model.write_text(MODEL)
    assert told(capsys, measured(model=None)) == (0, "")
    assert told(capsys, measured(model=MODEL), "--model", model) == (0, "")


def test_a_damaged_model_is_a_sentence(measured, capsys):
    status, err = told(capsys, measured(model="[model]\n"))
    assert status == 3
    assert "the session's field identification.model is damaged (" in err


def test_what_its_operator_left_out_of_a_session_answers_with_no_others(tmp_path, capsys):
    """The screen and the report left it out; `identify --joint` and `discrepancy` had it in."""
    session, path = read_session(example_session()), tmp_path / "visit.h5"
    out = ("curve excluded", 1, "the tape was loose")
    write_session(path, decided(session, out))
    says = f"skinlab: {path}:curve 1 is left out: who measured it said so (the tape was loose)\n"
    assert run(["identify", str(path), "--joint", "--json", "--method", "lm"]) == 0
    answer = capsys.readouterr()
    assert answer.err == says
    document = json.loads(answer.out)
    assert [one["file"] for one in document["curves"]] == [f"{path}:curve 1", f"{path}:curve 2"]
    assert document["joint"]["files"] == [f"{path}:curve 2"]
    campaign, _ = read_campaign_or_session(path)
    assert [curve.name for curve in campaign.curves] == [f"{path}:curve 2"]
    assert list(skinlab.read_session(path).left_out) == ["curve 1"]

    again = tmp_path / "again.h5"
    write_session(again, decided(session, out, ("curve included", 1, "")))
    assert not read_input(again, None).left_out

    none = tmp_path / "none.h5"
    write_session(none, decided(session, out, ("curve excluded", 2, "so it was")))
    with pytest.raises(InputError, match=r"none\.h5: all its curves were left out by who"):
        read_campaign_or_session(none)
    assert run(["identify", str(none), "--joint", "--method", "lm"]) == 3
    assert "all its curves were left out" in capsys.readouterr().err


def test_a_curve_that_was_cut_short_answers_with_no_whole_ones(tmp_path):
    session, path = read_session(example_session()), tmp_path / "visit.h5"
    first, second = session.curves
    cut = replace(session, curves=(replace(first, partial=True), second))
    write_session(path, cut)
    assert read_input(path, None).left_out == {f"{path}:curve 1": "it was cut short"}
    write_session(
        path, replace(cut, curves=(cut.curves[0], replace(second, partial=True))), replace=True
    )
    assert len(read_input(path, None).used) == 2
