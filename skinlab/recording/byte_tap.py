"""The tap on the wire, from the first byte on: the journal gets what came before it was there."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from skinlab.recording.journal import Journal


class ByteTap:
    """What a Probe takes as `on_bytes`. Keeps the bytes until there is a journal for them."""

    def __init__(self, now: Callable[[], float] = time.time) -> None:
        self._now = now  # Unix time, s
        self._lock = threading.Lock()
        self._kept: list[tuple[str, float, bytes, float]] = []
        self._journal: Journal | None = None

    def __call__(self, direction: str, host_time_s: float, data: bytes) -> None:
        """Take bytes.

        Raises:
            InputError: the journal cannot be written.
        """
        with self._lock:
            if self._journal is None:
                self._kept.append((direction, host_time_s, data, self._now()))
            else:
                self._journal.raw(direction, host_time_s, data)

    def into(self, journal: Journal) -> None:
        """Give all there was, and all that comes, to this journal.

        Raises:
            InputError: it could not be written before, and still cannot.
        """
        journal.try_again()  # first: nothing may wait for the disk with the lock
        with self._lock:
            for kept in self._kept:
                journal.raw(*kept)
            self._kept.clear()
            self._journal = journal
