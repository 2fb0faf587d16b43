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
        pytest.param(name, size, id=f"{name}-{kind}", marks=pytest.mark.long if later else ())
        for name in SCREENS
        for kind, size, later in (
            ("80x24", (80, 24), False),
            ("160x50", (160, 50), name != "good"),
        )
    ],
)
def test_screen(snap_compare, app, name, size):
    assert snap_compare(app, terminal_size=size, run_before=SCREENS[name])
    assert app.failure is None  # else it would be the picture of nothing


@pytest.mark.parametrize(
    "theme",
    [
        COLOUR_BLIND_SAFE.name,
        pytest.param("textual-light", marks=pytest.mark.long),
        pytest.param(HIGH_CONTRAST.name, marks=pytest.mark.long),
    ],
)
def test_colours(snap_compare, app, theme):
    app.theme = theme
    assert snap_compare(app, terminal_size=(80, 24), run_before=SCREENS["good"])
