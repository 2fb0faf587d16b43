"""Every word on the screen can be read in every theme: contrast as WCAG 2 computes it."""

from __future__ import annotations

from pathlib import Path

import pytest
from shown import NoProbe, entry_of, good, measured, missing, running
from textual.color import Color
from textual.geometry import Region
from textual.widgets import Input

from skinlab.quality.gates.base import Finding
from skinlab.tui.app import SkinlabApp
from skinlab.tui.screens.alarm import AlarmScreen
from skinlab.tui.themes import ORDER
from skinlab.tui.ui_state import Level

TEXT, GRAPHICS = 4.5, 2.95  # WCAG's AA; 3 for graphics, but for the rounding of colours
SIZE = (140, 36)


async def wrong(pilot):
    """Everything that warns, at once."""
    await measured(pilot, entry_of(1, findings=[Finding("saturated", "it stays", "go lower")]))
    pilot.app.board.say(Level.WARNING, "look")
    program = pilot.app.screen.query_one("#program", Input)
    program.focus()
    program.value = "ramp:900@20"


async def refused(pilot):
    await measured(pilot, entry_of(1, findings=[Finding("leak", "it falls", "press evenly")]))
    pilot.app.board.refuse("no such port")


async def pick_list(pilot):
    await good(pilot)
    await pilot.press("f4")


async def alarm(pilot):
    await measured(pilot, entry_of(1))
    pilot.app.push_screen(AlarmScreen(pilot.app.board, pilot.app.guard, "lift the probe"))


def luminance(color: Color) -> float:
    def linear(share: float) -> float:
        return share / 12.92 if share <= 0.03928 else ((share + 0.055) / 1.055) ** 2.4

    red, green, blue = map(linear, color.normalized)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: Color, other: Color) -> float:
    dark, light = sorted(map(luminance, (one, other)))
    return (light + 0.05) / (dark + 0.05)


def is_graphic(text: str) -> bool:
    """Whether it is dots, bars, lines: all that is no letter."""
    return all(c in " ·±" or "\u2500" <= c <= "\u25ff" or "\u2800" <= c <= "\u28ff" for c in text)


def cells(screen):
    """Yield (text, colour, background) of all that a screen shows."""
    for widget in screen.walk_children():
        shown = widget.display and widget.size.area and widget.region.overlaps(screen.region)
        if not shown or any(child.display for child in widget.children):
            continue
        for strip in widget.render_lines(Region(0, 0, *widget.size)):
            for segment in strip:
                style = segment.style
                if segment.text.strip() and style and style.color and style.bgcolor:
                    pair = [Color.from_rich_color(c) for c in (style.color, style.bgcolor)]
                    yield segment.text, *(reversed(pair) if style.reverse else pair)


def test_contrast_is_that_of_the_standard():
    assert contrast(Color.parse("#fff"), Color.parse("#000")) == pytest.approx(21.0)
    assert contrast(Color.parse("#777"), Color.parse("#fff")) == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize(
    "show",
    [
        alarm,
        *(
            pytest.param(show, marks=pytest.mark.long)
            for show in (good, running, wrong, refused, missing, pick_list)
        ),
    ],
)
async def test_every_word_can_be_read_in_every_theme(show, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    app = SkinlabApp("sim://", Path("sessions"), NoProbe, clock=lambda: 0.0)
    async with app.run_test(size=SIZE) as pilot:
        await show(pilot)
        for theme in ORDER:
            app.theme = theme
            await pilot.pause(0.15)  # the colours are others a frame later
            app.main.redraw()
            await pilot.pause(0.15)
            found = list(cells(app.screen))
            assert found
            for text, colour, behind in found:
                least = GRAPHICS if is_graphic(text) else TEXT
                ratio = contrast(colour, behind)
                assert ratio >= least, (theme, text, colour.hex, behind.hex, round(ratio, 2))
