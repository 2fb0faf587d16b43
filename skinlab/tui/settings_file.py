"""The user's own settings: colours, and keys beside the usual ones; docs/bedside.md has the table.

The usual keys go on working, so that what the screen says is true on every computer, and nothing in
the file can take the way to vent away. No word may start suction: what changes anything takes no
key that typing produces.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec
from platformdirs import user_config_path
from textual.binding import Binding
from textual.keys import Keys, key_to_character
from textual.widgets import Input

from drivers.reading import read_whole
from skinlab.errors import InputError
from skinlab.io.documents import decode, read_toml
from skinlab.io.files import named_in_errors
from skinlab.text import did_you_mean
from skinlab.tui.themes import WORDS

# What only looks, asks or ends suction: a letter may do it
LOOKING = frozenset({
    "vent", "help", "theme", "messages", "quit", "goal", "card", "session", "missing", "event",
    "time", "adopt", "joint", "compare", "note", "search", "order", "mark", "trend", "protocol",
})  # fmt: skip
# Where the usual key of an action goes round in fields, or is another one's byte on the wire
_NEVER = frozenset({
    "enter", "space", "tab", "shift+tab", "backspace", "escape", "up", "down", "left", "right",
    "home", "end", "pageup", "pagedown", "ctrl+c", "ctrl+h", "ctrl+i", "ctrl+j", "ctrl+m",
    "ctrl+left_square_bracket", "ctrl+[", "ctrl+@", "ctrl-at",
})  # fmt: skip
_NAMED = frozenset(key.value for key in Keys if not key.value.startswith("<"))

Owners = Mapping[str, Iterable[Binding]]


class SettingsFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What settings.toml says."""

    theme: str | None = None
    keys: dict[str, str | list[str]] = msgspec.field(default_factory=dict)


class UserSettings(msgspec.Struct, frozen=True):
    """The same, checked: a theme by Textual's name, and for each action all of its keys."""

    theme: str | None = None
    keymap: dict[str, str] = msgspec.field(default_factory=dict)


def default_settings_path() -> Path:
    """Return where the file is looked for."""
    return user_config_path("skinlab", appauthor=False) / "settings.toml"


def read_settings(path: Path, owners: Owners) -> UserSettings:
    """Return the settings of this file; the usual ones where there is none.

    `owners` has the bindings of each screen, by its name; those with an id may get further keys.

    Raises:
        InputError: a key or a value is unknown, a key has two meanings, or typing would produce it;
            names the file and the field.
    """
    with named_in_errors(path):
        try:
            raw = read_whole(path)
        except FileNotFoundError:
            return UserSettings()
        said = decode(read_toml(raw), SettingsFile)
        return UserSettings(_theme(said.theme), _keymap(said.keys, owners))


def actions(owners: Owners) -> dict[str, tuple[str, ...]]:
    """Return the actions that may get further keys, with their usual ones."""
    found: dict[str, tuple[str, ...]] = {}
    for bindings in owners.values():
        for binding in bindings:
            if binding.id is not None:
                found[binding.id] = tuple(binding.key.split(","))
    return found


def _theme(words: str | None) -> str | None:
    if words is None:
        return None
    names = {text.replace(" ", "-"): name for name, text in WORDS.items()}
    if words not in names:
        near = did_you_mean(words, names)
        raise InputError(f"theme {words!r}: expected {', '.join(names)}{near}")
    return names[words]


def _keymap(said: Mapping[str, str | list[str]], owners: Owners) -> dict[str, str]:
    usual = actions(owners)
    own: dict[str, list[str]] = {}
    for action, keys in said.items():
        if action not in usual:
            near = did_you_mean(action, usual)
            raise InputError(
                f"keys.{action}: no such action{near or '; docs/bedside.md lists them'}"
            )
        listed = [keys] if isinstance(keys, str) else keys
        own[action] = [_checked(action, key) for key in listed]
    for place, bindings in owners.items():
        _refuse_doubles(place, [*bindings, *(owners["app"] if place != "app" else ())], own)
    return {action: ",".join((*usual[action], *keys)) for action, keys in own.items()}


def _checked(action: str, text: str) -> str:
    """Return Textual's name of a key that this action may have."""
    where = f"keys.{action} = {text!r}"
    key = text.strip() if len(text) > 1 else text
    if len(key) == 1:
        if key == "," or not key.isprintable() or key == " ":
            raise InputError(f"{where}: expected another key, such as f12 or ctrl+x")
        letter = True
    else:
        key = key.lower()
        letter = key_to_character(key) is not None
        if key not in _NAMED and not letter:
            raise InputError(f"{where}: no such key{did_you_mean(key, _NAMED)}; expected e.g. f12")
    if key in _NEVER:
        raise InputError(
            f"{where}: this key belongs to fields, lists and venting, or terminals send it for one "
            "that does; expected a function key, or Ctrl and a letter"
        )
    if action not in LOOKING and (letter or key in _field_keys()):
        raise InputError(
            f"{where}: typing a word can produce this key, and {action} changes something; "
            "expected a function key, or Ctrl and a letter that fields do not use"
        )
    return key


def _field_keys() -> set[str]:
    bindings = (b for b in Input.BINDINGS if isinstance(b, Binding))
    return {key for binding in bindings for key in binding.key.split(",")}


def _refuse_doubles(
    place: str, bindings: Iterable[Binding], own: Mapping[str, Iterable[str]]
) -> None:
    """Refuse a key that would mean two things on one screen."""
    meaning: dict[str, str] = {}
    for binding in bindings:
        for key in binding.key.split(","):
            meaning.setdefault(key, binding.id or binding.action)
    for action in {b.id: None for b in bindings if b.id in own}:
        assert action is not None
        for key in own[action]:
            other = meaning.setdefault(key, action)
            if other != action:
                raise InputError(
                    f"keys.{action} = {key!r}: on the screen {place} this key means {other} already"
                )
