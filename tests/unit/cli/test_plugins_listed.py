"""`skinlab plugins` where several packages offer one name, and one of them is broken."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest
from skinlab_example.house_limit import GATE

from skinlab import plugins
from skinlab.cli.main import run
from skinlab.errors import InputError
from skinlab.quality.gates import GATES


def entry(distribution, what):
    """An entry point for the gate house_limit."""
    return SimpleNamespace(
        name="house_limit",
        group="skinlab.gates",
        value="works:GATE",
        dist=SimpleNamespace(name=distribution, version=f"1.{distribution[-1]}"),
        load=lambda: what,
    )


@pytest.fixture
def three(monkeypatch):
    """Three packages with one gate: the first is broken, the second is taken."""
    found = (entry("of_1", None), entry("of_2", GATE), entry("of_3", GATE))
    monkeypatch.setattr(plugins, "_every_entry", lambda: found)
    monkeypatch.setattr(plugins, "_said", set())
    fresh = plugins.Registry("gate", GATES.package, GATES.attribute, GATES.group, GATES._check)
    for name in ("_found", "_origins", "_refused"):
        monkeypatch.setattr(GATES, name, getattr(fresh, name))
    monkeypatch.setattr(GATES, "_looked", False)


def test_each_that_is_left_out_is_listed_with_its_own_package(three, capsys):
    """The row of a broken one had named the package of another, and the third was not listed."""
    assert run(["plugins", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["plugins"]
    ours = [row for row in rows if row["name"] == "house_limit"]
    assert [(row["distribution"], row["version"]) for row in ours] == [
        ("of_2", "1.2"), ("of_1", "1.1"), ("of_3", "1.3"),
    ]  # fmt: skip
    taken, broken, late = (row["error"] for row in ours)
    assert taken is None
    assert broken.startswith("plugin of_1, gate 'house_limit': left out, because it is broken")
    assert late == (
        "plugin of_3, gate 'house_limit': left out, because one of this name comes from of_2"
    )


def test_a_name_of_which_all_are_broken_tells_of_each(three, monkeypatch):
    found = (entry("of_1", None), entry("of_2", 3))
    monkeypatch.setattr(plugins, "_every_entry", lambda: found)
    with pytest.raises(InputError, match=r"plugin of_1, .*; plugin of_2, .*expected one of"):
        GATES.get("house_limit")
