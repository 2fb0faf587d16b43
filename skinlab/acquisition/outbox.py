"""Messages on their way to a screen, several at once: a fast probe costs no more than others."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime

from skinlab.acquisition.messages import Heard, News
from skinlab.recording.stream import CurveCompleted, Identified, Message

_MOST = 200  # of one post


class Outbox:
    """Collects messages of one thread; `moment` says when they happened, in local time."""

    def __init__(self, post: Callable[[News], None], moment: Callable[[], datetime | None]) -> None:
        self._post = post
        self._moment = moment
        self._messages: list[Message] = []

    def add(self, message: Message) -> None:
        """Take a message; an end of a curve, and its result, are waited for and go at once."""
        self._messages.append(message)
        if isinstance(message, CurveCompleted | Identified) or len(self._messages) >= _MOST:
            self.flush()

    def flush(self) -> bool:
        """Post what there is; False: nothing."""
        if not self._messages:
            return False
        messages, self._messages = tuple(self._messages), []
        self._post(Heard(messages, self._moment()))
        return True
