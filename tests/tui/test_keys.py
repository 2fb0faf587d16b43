"""The line of keys, lists for the left hand alone, and what a line of the screen keeps."""

from __future__ import annotations

from textual.widgets import Input

from skinlab.tui.screens.help import HelpScreen
from skinlab.tui.screens.main import MainScreen
from skinlab.tui.screens.pick import PickScreen
from skinlab.tui.widgets.keys import Keys


async def test_keys_stand_whole_and_can_be_clicked_in_a_small_window(bedside):
    async with bedside(size=(60, 20)) as bed:
        await bed.connected()
        line = bed.app.screen.query_one(Keys)
        await bed.until(lambda: "F8 Check" in str(line.render()))
        text = str(line.render())
        assert len(text.rstrip()) <= 60
        assert text.rstrip().endswith("? Help")  # the way to all others
        await bed.pilot.click(Keys, offset=(text.index("? Help") + 2, 0))
        await bed.on(HelpScreen)
        keys = bed.app.screen.query_one(Keys)
        await bed.until(lambda: "Close" in str(keys.render()))  # and not those of the screen below
        assert "Check" not in str(keys.render())


async def test_a_site_is_chosen_with_the_left_hand_alone(bedside):
    async with bedside(size=(60, 20)) as bed:
        await bed.connected()
        bed.app.screen.set_focus(bed.app.screen.query_one("#site", Input))
        await bed.press("f4")
        await bed.on(PickScreen)
        await bed.press("tab", "ctrl+g")
        await bed.on(MainScreen)
        site = bed.app.screen.query_one("#site", Input)
        await bed.until(lambda: site.value == "cheek, right")


async def test_lines_keep_what_a_filter_has_made_of_them(bedside):
    async with bedside() as bed:
        assert bed.app.get_line_filters() is bed.app.get_line_filters()
