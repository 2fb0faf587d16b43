"""The line of keys at the bottom of a screen; each can be clicked."""

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import ClassVar

from textual import events
from textual.binding import Binding
from textual.screen import Screen

from skinlab.tui.widgets.rows import Rows

_Key = tuple[str, str, str]  # its name, as it stands on the keyboard, what it does


class Keys(Rows):
    """What the keys of the screen do now; where not all have room, whole ones, and help at the end.

    One line that draws itself: Textual's footer has a widget for each key, and makes all of them
    anew, with their styles and the layout of the screen, whenever one changes. That takes longer
    than a frame may.
    """

    COMPONENT_CLASSES: ClassVar[set[str]] = {"keys--key", "keys--words"}

    def __init__(self) -> None:
        super().__init__("keys")
        self._keys: tuple[_Key, ...] = ()
        self._shown: tuple[_Key, ...] = ()

    def on_mount(self) -> None:
        """Follow what the keys mean."""
        self.screen.bindings_updated_signal.subscribe(self, self._changed)

    def on_resize(self) -> None:
        """Show as many as there is room for now."""
        self._draw()

    def notify_style_update(self) -> None:
        """Draw again in the colours of another theme."""
        super().notify_style_update()
        if self._keys:
            self.call_later(self._draw)  # the new styles of its parts come behind this

    def on_click(self, event: events.Click) -> None:
        """Press the key."""
        event.stop()
        key = self.key_at(event.x)
        if key is not None:
            self.app.simulate_key(key)

    def key_at(self, column: int) -> str | None:
        """Return the key that a click into this column presses."""
        ends = accumulate((_width(key) for key in self._shown), initial=0)
        for (name, _, _), (begin, end) in zip(self._shown, pairwise(ends), strict=True):
            if begin <= column < end - 1:
                return name
        return None

    def _changed(self, screen: Screen[object]) -> None:
        actions: dict[str, Binding] = {}  # of several keys for one thing, the first is shown
        for active in screen.active_bindings.values():
            if active.binding.show and active.enabled:
                actions.setdefault(active.binding.action, active.binding)
        keys = tuple(
            (binding.key, self.app.get_key_display(binding), binding.description)
            for binding in actions.values()
        )
        if keys != self._keys:
            self._keys = keys
            self._draw()

    def _draw(self) -> None:
        self._shown = _fitting(self._keys, self.size.width)
        bold, words = (self.get_component_rich_style(f"keys--{s}") for s in ("key", "words"))
        row = [part for _, k, w in self._shown for part in ((k, bold), (f" {w} ", words))]
        self.set_rows([row])


def _width(key: _Key) -> int:
    _, shown, words = key
    return len(shown) + len(words) + 2


def _fitting(keys: tuple[_Key, ...], columns: int) -> tuple[_Key, ...]:
    """Return the first keys that have room; where some have none, help, which has all, is last."""
    if sum(map(_width, keys)) <= columns + 1:
        return keys
    last = tuple(key for key in keys if key[0] == "question_mark")
    room = columns + 1 - sum(map(_width, last))
    first = [key for key in keys if key not in last]
    while first and sum(map(_width, first)) > room:
        first.pop()
    return (*first, *last)
