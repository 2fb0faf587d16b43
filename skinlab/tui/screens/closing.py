"""Screens that close once, however often a key is pressed that closes them."""

from __future__ import annotations

from typing import TypeVar

from textual.await_complete import AwaitComplete
from textual.screen import Screen

Answer = TypeVar("Answer")


class ClosingScreen(Screen[Answer]):
    """A screen that is dismissed while it is on top only.

    A second Enter, or a second `s`, that waited behind the first would else close what lies below:
    under the last screen there is none, and the program ended.
    """

    def dismiss(self, result: Answer | None = None) -> AwaitComplete:
        """Close, with an answer."""
        return super().dismiss(result) if self.is_active else AwaitComplete()
