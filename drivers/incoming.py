"""Bytes of an instrument to events: what both kinds of connection do alike. No clock, no I/O."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque

from drivers.dialect import Dialect
from drivers.errors import RemoteProtocolError
from drivers.events import Damaged, Event, InstrumentEvent
from drivers.guarded import guarded

MAX_BACKLOG_BYTES = 1 << 20  # of bytes that nobody turned into events yet


class Incoming(ABC):
    """`receive_data` takes bytes as they come, `next_event` gives what they mean."""

    def __init__(self, dialect: Dialect) -> None:
        self._dialect = guarded(dialect)
        self._buffer = bytearray()
        self._ready: deque[Event] = deque()
        self._host_time_s: float | None = None  # of the bytes that came last

    @property
    def backlog_bytes(self) -> int:
        """How many bytes wait for what comes next, or for `next_event`."""
        return len(self._buffer)

    def receive_data(self, data: bytes, host_time_s: float | None = None) -> None:
        """Take bytes from the instrument, in pieces of any size, and when they came.

        Raises RemoteProtocolError when more than MAX_BACKLOG_BYTES wait for `next_event`; these
        are then dropped.
        """
        if len(self._buffer) + len(data) > MAX_BACKLOG_BYTES:
            self._buffer.clear()
            raise RemoteProtocolError(f"more than {MAX_BACKLOG_BYTES} bytes came at once")
        self._buffer += data
        if data:
            self._host_time_s = host_time_s

    def next_event(self) -> Event | None:
        """Give the next event, or None where more bytes are needed.

        Raises RemoteProtocolError where the instrument does what the protocol does not allow; the
        event that showed it is delivered by the next call, and reading goes on.
        Raises BrokenDialectError where the dialect's own code fails.
        """
        while True:
            if self._ready:
                return self._ready.popleft()
            taken = self._dialect.take(self._buffer)
            if taken is None or isinstance(taken, Damaged):
                return taken
            try:
                event, number = self._dialect.decode_event(taken)
            except RemoteProtocolError as error:
                self._miss()
                return Damaged(str(error), taken)
            self._judge(event, number, taken)

    @abstractmethod
    def _miss(self) -> None:
        """Count a frame that says nothing."""

    @abstractmethod
    def _judge(self, event: InstrumentEvent, number: int | None, frame: bytes) -> None:
        """Make ready what an event means."""
