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


@pytest.fixture
def app(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()
    yield SkinlabApp("sim://", Path("sessions"), NoProbe, clock=lambda: 0.0)
    monkeypatch.undo()
    time.tzset()


@pytest.mark.parametrize(
    ("name", "size"),
    [
        pytest.param(name, size, id=f"{name}-{size[0]}x{size[1]}", marks=marks)
        for name in SCREENS
        for size, marks in (((80, 24), ()), ((160, 50), pytest.mark.long))
    ],
)
def test_screen(snap_compare, app, name, size):
    assert snap_compare(app, terminal_size=size, run_before=SCREENS[name])
    assert app.failure is None  # else it would be the picture of nothing


@pytest.mark.long
@pytest.mark.parametrize("theme", [COLOUR_BLIND_SAFE.name, "textual-light", HIGH_CONTRAST.name])
def test_colours(snap_compare, app, theme):
    app.theme = theme
    assert snap_compare(app, terminal_size=(80, 24), run_before=SCREENS["good"])
