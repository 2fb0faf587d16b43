"""`skinlab identify` of a session whose own results are of a model."""

from __future__ import annotations

from dataclasses import replace

import pytest

from skinlab.cli.main import run
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
