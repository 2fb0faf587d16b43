"""What a terminal obeys, nobody sees, or a spreadsheet computes, becomes visible text."""

from __future__ import annotations

import json
import tomllib
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinlab.io.documents import toml_text
from skinlab.text import csv_cell, inert, inert_lines, json_text, needs

UNSEEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}


@given(st.text(alphabet=st.characters(exclude_categories=()), max_size=200))
def test_nothing_is_left_that_acts_or_hides(text):
    for shown in (inert(text), inert_lines(text).replace("\n", ""), csv_cell(text)):
        assert not {unicodedata.category(c) for c in shown} & UNSEEN
        shown.encode("utf-8")


@given(st.text(alphabet=st.characters(exclude_categories=("Cs",)), max_size=200))
def test_documents_read_back_the_same_and_hold_nothing_that_acts(text):
    for written, read in (
        (toml_text({"table": {text or "k": text}}), tomllib.loads),
        (json_text({"table": {text or "k": text}}), json.loads),
    ):
        assert read(written) == {"table": {text or "k": text}}
        assert not {unicodedata.category(c) for c in written.replace("\n", "")} & UNSEEN


def test_every_reader_of_json_can_read_a_name_that_is_no_utf_8():
    """Half a character, as \\udcfc, is refused by strict readers."""
    said = ["m\udcfcller.csv", "\ud800", "\\udcfc", "\\\udcfc", "\U0001f44d"]
    read = json.loads(json_text(dict.fromkeys(said)))
    assert list(read) == ["m\\xfcller.csv", "\\ud800", "\\udcfc", "\\\\xfc", "\U0001f44d"]


def test_each_kind_has_its_sign():
    said = "a\x1b[31m\x07\t\x7f\x9b\u202e\u200b\u2028\udc9f\ud800é漢👍"
    assert inert(said) == ("a␛[31m␇␉␡\\x9b\\u202e\\u200b\\u2028\\x9f\\ud800é漢👍")
    assert inert_lines("a\nb\r\x1b") == "a\nb␍␛"
    assert inert("plain") == "plain"
    assert inert("a\u034fb\u3164c\ufe0fd\U000e0100") == "a\\u034fb\\u3164c\\ufe0fd\\U000e0100"


@pytest.mark.parametrize("cell", ["=1+1", "+A1", "-cmd", "@SUM(A1)", "\t=1", "\r=1", " =1", "＝1"])
def test_a_cell_that_begins_like_a_formula_is_quoted(cell):
    assert csv_cell(cell).startswith("'")


def test_a_semicolon_begins_no_formula_either():
    assert csv_cell("arm; =1+1;@A1;b") == "arm; '=1+1;'@A1;b"


def test_numbers_in_cells_stay_numbers():
    assert [csv_cell(v) for v in (-1.5, 3, None, "plain", "1.5")] == [-1.5, 3, None, "plain", "1.5"]


@pytest.mark.parametrize(
    ("file", "command"),
    [
        (None, "pip install"),
        ("pipx_metadata.json", "pipx runpip skinlab install"),
        ("uv-receipt.toml", "uv pip install --python '{prefix}'"),
    ],
)
def test_what_is_missing_goes_into_the_environment_that_skinlab_is_in(
    tmp_path, monkeypatch, file, command
):
    monkeypatch.setattr("sys.prefix", str(tmp_path))
    if file is not None:
        (tmp_path / file).touch()
    said = needs("pictures need", "matplotlib", "pictures")
    command = command.format(prefix=tmp_path)
    assert said == (
        f"pictures need matplotlib, which is not installed: {command} 'skinlab[pictures]'"
    )
