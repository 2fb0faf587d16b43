"""Keys that are typed before the main screen is there."""

from __future__ import annotations

import asyncio

import pytest
from textual import events
from textual.widgets import Input

from skinlab.tui.app import SkinlabApp
from skinlab.tui.screens.main import MainScreen
from skinlab.tui.screens.palette import PaletteScreen


@pytest.fixture
def typed_ahead(monkeypatch):
    """Type keys once the app runs, before its first screen has any part."""

    def type_ahead(*keys):
        async def on_compose(screen):
            for key in keys:
                screen.app.post_message(events.Key(key, key if len(key) == 1 else None))
            got = asyncio.Event()
            screen.app.call_later(got.set)
            await asyncio.wait_for(got.wait(), 30.0)
            assert not screen.is_mounted

        monkeypatch.setattr(MainScreen, "on_compose", on_compose, raising=False)

    return type_ahead


_KEYS = {
    binding.action: binding.key.partition(",")[0]
    for kind in (MainScreen, SkinlabApp)
    for binding in kind.BINDINGS
    if not binding.action.startswith("want('to ") or binding.key == "1"
}


@pytest.mark.parametrize("key", sorted(set(_KEYS.values())))
async def test_no_key_is_too_early_for_the_first_screen(bedside, typed_ahead, key):
    typed_ahead(key)
    async with bedside() as bed:
        await bed.settle()
        assert bed.app.failure is None
        assert bed.app.is_running


async def test_what_is_typed_ahead_is_done_in_its_order(bedside, typed_ahead):
    typed_ahead("ctrl+p", *"visits")
    async with bedside() as bed:
        await bed.on(PaletteScreen)
        line = bed.app.screen.query_one(Input)
        await bed.until(lambda: line.value == "visits")
