"""What is recorded, piece by piece, in the order in which it happened."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Kind(IntEnum):
    """What a record holds."""

    RECEIVED = 0  # bytes from the instrument
    SENT = 1  # bytes to it
    PLAN = 2  # JSON of a Setup: what the next run belongs to
    RESULT = 3  # JSON of an identification, with the number of its curve
    AUDIT = 4  # JSON of who did what when
    MARK = 5  # what the host decided about a stream that it does not control: drivers/stream.py


@dataclass(frozen=True, slots=True)
class Record:
    """One record; the device's own count and time are in its bytes."""

    kind: Kind
    host_time_s: float  # the host's monotonic clock
    utc_s: float  # Unix time by the host's clock, which can be set and jump
    data: bytes
