"""Tells a confirmation from typing: it counts only where nobody types, and somebody looked."""

from __future__ import annotations

from collections.abc import Callable

QUIET_S = 1.0  # after the last letter, Space or Enter
LOOK_S = 0.3  # for which a question must have been in view; also longer than a key's repetition

# No word contains them, and every terminal since the VT220 has them; the second of each is for a
# left hand alone, while the right one holds the probe
CONFIRM_KEY = "f9,ctrl+g"
CHECK_KEY = "f8,ctrl+t"
_TEXT_KEYS = frozenset({"enter", "space", "tab", "shift+tab", "backspace"})


def is_typing(key: str, *, printable: bool) -> bool:
    """Return whether this key is part of written text."""
    return printable or key in _TEXT_KEYS


class TypingGuard:
    """Knows when something was typed last, and since when the present question is in view.

    `clock` returns s, and never goes back.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._typed_s: float | None = None
        self._asked_s: float | None = None
        self._pressed_s: float | None = None

    def typed(self) -> None:
        """Note that something is being typed, or was pasted."""
        self._typed_s = self._clock()

    def asked(self) -> None:
        """Note that a question has come into view."""
        self._asked_s = self._clock()

    def hidden(self) -> None:
        """Note that there is no question in view, or not yet."""
        self._asked_s = None

    def refusal(self) -> str | None:
        """Return why the confirming key, pressed now, does not count; None: it does.

        What is refused is asked again, so that the key must be pressed anew.
        """
        now = self._clock()
        pressed, self._pressed_s = self._pressed_s, now
        if self._asked_s is None:
            return "nothing to confirm is in view"
        if pressed is not None and now - pressed < LOOK_S:
            return "F9 came twice at once: read, then press it once more"
        if self._typed_s is not None and now - self._typed_s < QUIET_S:
            self._asked_s = now
            return "something was typed a moment ago: read, then press F9 again"
        if now - self._asked_s < LOOK_S:
            return "that was too quick to have been read: press F9 again"
        return None
