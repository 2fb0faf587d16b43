"""The settings file: keys beside the usual ones, colours, and what it may not do."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from skinlab.errors import InputError
from skinlab.tui.key_owners import owners
from skinlab.tui.screens.help import HelpScreen
from skinlab.tui.screens.pick import PickScreen
from skinlab.tui.screens.session import SessionScreen
from skinlab.tui.settings_file import UserSettings, actions, read_settings

ROOT = Path(__file__).parents[2]


def settings(tmp_path, text) -> UserSettings:
    path = tmp_path / "settings.toml"
    path.write_text(text)
    return read_settings(path, owners())


def test_without_a_file_all_is_as_usual(tmp_path):
    assert read_settings(tmp_path / "settings.toml", owners()) == UserSettings()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("colour = 'dark'", "unknown field `colour`"),
        ("them = 'dark'", "did you mean theme?"),
        ("theme = 'drak'", "did you mean dark?"),
        ("[keys]\nsesion = 'x'", "keys.sesion: no such action; did you mean session?"),
        ("[keys]\nsession = 'f99'", "no such key; did you mean f9?"),
        ("[keys]\nsession = 'd'", "on the screen main this key means missing already"),
        ("[keys]\nsession = 'z'\ngoal = 'z'", "this key means"),
        ("[keys]\nsession = 'v'", "this key means vent already"),
        ("[keys]\ncompare = 'j'", "on the screen session this key means joint already"),
        ("[keys]\ntheme = 's'", "this key means"),
        *(
            (f"[keys]\n{action} = '{key}'", "typing a word can produce this key")
            for action in ("confirm", "check", "exclude", "load", "rested", "visits", "undo")
            for key in ("x", "X", "7", "full_stop", "ctrl+w", "delete")
            if (action, key) != ("exclude", "delete")
        ),
        *(
            (f"[keys]\n{action} = '{key}'", "this key belongs to fields")
            for action in ("confirm", "session", "vent")
            for key in ("enter", "tab", "backspace", "ctrl+m", "ctrl+j", "ctrl+i", "ctrl+h", "up")
        ),
        ("[keys]\nconfirm = ' '", "expected another key"),
        ("[keys]\nconfirm = 'space'", "this key belongs to fields"),
        ("[keys]\nconfirm = 3", "keys.confirm: expected a text or a list"),
        ("keys = ", "invalid value"),
    ],
)
def test_what_the_file_may_not_say_is_refused_with_a_sentence(tmp_path, text, said):
    with pytest.raises(InputError) as refused:
        settings(tmp_path, text)
    assert said.casefold() in str(refused.value).casefold()
    assert "settings.toml: " in str(refused.value)


def test_actions_have_the_same_usual_keys_on_every_screen():
    usual = actions(owners())
    for bindings in owners().values():
        for binding in bindings:
            assert binding.id is None or tuple(binding.key.split(",")) == usual[binding.id]


def test_the_page_lists_every_action_with_its_usual_keys():
    page = (ROOT / "docs" / "bedside.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE))
    assert listed == set(actions(owners()))


@pytest.mark.long
async def test_a_key_of_ones_own_works_beside_the_usual_one(bedside, tmp_path):
    user = settings(tmp_path, "theme = 'light'\n[keys]\nsession = 'x'\ncheck = ['f12', 'ctrl+t']")
    async with bedside(user=user) as bed:
        assert bed.app.theme == "textual-light"
        await bed.connected()
        for key in ("x", "s"):
            await bed.press(key)
            await bed.on(SessionScreen)
            await bed.press("b")
        await bed.press("f1")
        await bed.on(HelpScreen)
        assert re.search(r"s  x +Session", bed.text("#help-here"))
        assert "F12" in bed.text("#help-here")
        await bed.press("f1")
        await bed.until(lambda: not isinstance(bed.app.screen, HelpScreen))
        await bed.fill("subject", "P01")
        await bed.press("f12")
        await bed.until(lambda: bed.board.review)
        assert bed.board.instrument is None or not bed.board.moving
        await bed.press("v")  # whatever the file says
        await bed.until(lambda: bed.board.review is None)
        await bed.quit()


@pytest.mark.long
async def test_a_further_key_to_confirm_is_guarded_like_the_usual_one(bedside, tmp_path):
    user = settings(tmp_path, "[keys]\nconfirm = 'f11'")
    async with bedside(user=user) as bed:
        await bed.connected()
        await bed.fill("subject", "P01")
        await bed.press("f11")
        assert "F8 first" in bed.board.note
        await bed.press("f8")
        await bed.until(lambda: bed.board.review)
        await bed.press("f11")  # too soon to have been read
        assert "not started" in bed.board.note
        assert not bed.board.moving
        await bed.until(lambda: bed.app.screen_stack[0].summary_in_view)
        await bed.pilot.pause()
        bed.clock.now_s += 2.0
        await bed.press("f11")
        await bed.until(lambda: bed.board.series or bed.board.entries)
        await bed.until(lambda: bed.board.entry and bed.board.entry.result and bed.board.can_arm)
        await bed.quit()


@pytest.mark.long
async def test_help_tells_the_keys_of_a_list_too(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.press("g")
        await bed.on(PickScreen)
        await bed.press("f1")
        await bed.on(HelpScreen)
        assert "Close" in bed.text("#help-here")
        await bed.press("f1")
        await bed.on(PickScreen)
        await bed.press("f8")
        await bed.quit()


def test_the_page_s_example_is_a_settings_file(tmp_path):
    page = (ROOT / "docs" / "bedside.md").read_text(encoding="utf-8")
    text = page.split("```toml\n")[1].split("```")[0]
    found = settings(tmp_path, text)
    assert found.theme == "skinlab-contrast"
    assert found.keymap["confirm"] == "f9,ctrl+g,f11"
