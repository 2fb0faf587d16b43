"""The keys of what is open over a screen; each can be clicked."""

from __future__ import annotations

from textual import events
from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.widgets import Static


class KeyHint(Static):
    """A key and what it does, in words; a click presses it."""

    def __init__(self, words: str, key: str) -> None:
        super().__init__(words, classes="key", markup=False)
        self._key = key

    def on_click(self, event: events.Click) -> None:
        """Press the key."""
        event.stop()
        self.app.simulate_key(self._key)


class Hints(Horizontal):
    """Keys side by side: pairs of words and key."""

    def __init__(self, *keys: tuple[str, str]) -> None:
        super().__init__(classes="hints")
        self._keys = keys

    def compose(self) -> ComposeResult:
        """Yield the keys."""
        for words, key in self._keys:
            yield KeyHint(words, key)
