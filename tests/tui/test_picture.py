"""The picture of the README."""

from __future__ import annotations

import pytest

from skinlab.tui.picture import draw


@pytest.mark.long
async def test_the_picture_of_the_readme_has_both_curves(tmp_path, monkeypatch, coarse_skin):
    """The app took the fixed day of its session for another day, and began a second session."""
    monkeypatch.chdir(tmp_path)
    programs = ["ramp:100@20", "ramp:100@20,ramp:0@20"]
    svg = await draw("sim://?seed=1&speed=20", (110, 34), programs, "textual-dark")
    assert "curve&#160;2" in svg
    assert len(list((tmp_path / "sessions").glob("*.h5"))) == 1
