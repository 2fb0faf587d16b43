"""The tap on the wire, from the first byte on: the journal gets what came before it was there.

Of an instrument that never falls silent not all of it: its first words, and the last minutes.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

from skinlab.recording.journal import Journal

_FIRST_BYTES = 1 << 16  # who the instrument is, with room for what else is said then
_LAST_BYTES = 1 << 20  # a minute and a half of the fastest serial line, half an hour of a usual one


class ByteTap:
    """What a Probe takes as `on_bytes`. Keeps the bytes until there is a journal for them."""

    def __init__(self, now: Callable[[], float] = time.time) -> None:
        self._now = now  # Unix time, s
        self._lock = threading.Lock()
        self._first: list[tuple[str, float, bytes, float]] = []
        self._last: deque[tuple[str, float, bytes, float]] = deque()
        self._first_bytes = self._last_bytes = 0
        self._journal: Journal | None = None

    def __call__(self, direction: str, host_time_s: float, data: bytes) -> None:
        """Take bytes.

        Raises:
            InputError: the journal cannot be written.
        """
        with self._lock:
            if self._journal is None:
                self._keep((direction, host_time_s, data, self._now()))
            else:
                self._journal.raw(direction, host_time_s, data)

    def _keep(self, piece: tuple[str, float, bytes, float]) -> None:
        size = len(piece[2])
        if not self._last and self._first_bytes + size <= _FIRST_BYTES:
            self._first.append(piece)
            self._first_bytes += size
            return
        self._last.append(piece)
        self._last_bytes += size
        while self._last_bytes > _LAST_BYTES:
            self._last_bytes -= len(self._last.popleft()[2])

    def into(self, journal: Journal) -> None:
        """Give all there was, and all that comes, to this journal.

        Raises:
            InputError: it could not be written before, and still cannot.
        """
        journal.try_again()  # first: nothing may wait for the disk with the lock
        with self._lock:
            for kept in (*self._first, *self._last):
                journal.raw(*kept)
            self._first.clear()
            self._last.clear()
            self._journal = journal
