"""What is recorded, piece by piece, in the order in which it happened."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

MOST_RECORD_BYTES = 16 << 20  # of one that may be damaged
_LATEST_S = 1e11  # the year 5138; nothing later is a time


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


def checked_record(row: list[Any], before: Record | None) -> tuple[Record | None, str]:
    """Return the record of a row, and what is wrong with it; bytes that are there are kept."""
    kind, host_time_s, utc_s, data = row
    if kind not in tuple(Kind) or not isinstance(kind, int):
        return None, f"its kind is {kind!r:.40}: left out"
    if not isinstance(data, bytes):
        return None, f"{in_place(data)}: left out"
    wrong = ""
    times = [host_time_s, utc_s]
    for k, name in enumerate(("host_time_s", "utc_s")):
        if not isinstance(times[k], float | int) or not 0 <= times[k] < _LATEST_S:
            wrong = f"its {name} is {times[k]!r:.40}: that of the record before it is taken"
            times[k] = 0.0 if before is None else getattr(before, name)
    return Record(Kind(kind), float(times[0]), float(times[1]), data), wrong


def in_place(value: object) -> str:
    """Say what is there where bytes are expected."""
    if isinstance(value, int) and -value > MOST_RECORD_BYTES:
        return f"{-value >> 20} MB in one"
    return f"{type(value).__name__} in the place of bytes"
