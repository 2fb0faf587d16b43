"""Pictures of the screens, at two sizes: made from fixed data, without a probe.

`pytest tests/tui/test_snapshots.py --snapshot-update` makes them again; look at them then.
"""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from shown import SCREENS, NoProbe

from skinlab.tui.app import SkinlabApp
from skinlab.tui.themes import COLOUR_BLIND_SAFE, HIGH_CONTRAST

SIZES = [
    pytest.param((80, 24), id="80x24"),
    pytest.param((160, 50), id="160x50", marks=pytest.mark.long),
]


@pytest.fixture
def app(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()
    yield SkinlabApp("sim://", Path("sessions"), NoProbe, clock=lambda: 0.0)
    monkeypatch.undo()
    time.tzset()


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", SCREENS)
def test_screen(snap_compare, app, name, size):
    assert snap_compare(app, terminal_size=size, run_before=SCREENS[name])
    assert app.failure is None  # else it would be the picture of nothing


@pytest.mark.parametrize("theme", ["textual-light", HIGH_CONTRAST.name, COLOUR_BLIND_SAFE.name])
def test_colours(snap_compare, app, theme):
    app.theme = theme
    assert snap_compare(app, terminal_size=(80, 24), run_before=SCREENS["good"])
