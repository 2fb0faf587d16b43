"""When imported curves were measured, as somebody states it: a day, or a day and a time."""

from __future__ import annotations

import re
from datetime import UTC, datetime, tzinfo

from skinlab.errors import InputError

_FORM = re.compile(
    r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d(\.\d{1,6})?)?(Z|[+-]\d\d:\d\d)?)?", re.ASCII
)
_DAY = len("2026-03-01")
_FIRST_YEAR = 1970  # before it, no computer's local time is to be relied on
_EXPECTED = (
    "expected the day of the measurement, as 2026-03-01, or day and local time, as 2026-03-01T10:20"
)


def stated_time(text: str, now: datetime, zone: tzinfo | None = None) -> str:
    """Return when it was measured as a session keeps it: the day, or UTC, both ISO 8601.

    A time without an offset is local, or of `zone`. A day stays a day: which day it was is not
    for an offset to say.

    Raises:
        InputError: it is neither, or lies in the future of `now`.
    """
    text = text.strip()
    if not _FORM.fullmatch(text):
        raise InputError(f"{text!r}: {_EXPECTED}")
    try:
        at = datetime.fromisoformat(text)
    except ValueError:
        raise InputError(f"{text!r}: there is no such day or time; {_EXPECTED}") from None
    if at.year < _FIRST_YEAR:
        raise InputError(f"{text!r}: before {_FIRST_YEAR}; {_EXPECTED}")
    future = InputError(f"{text!r}: in the future; {_EXPECTED}")
    if at.year > now.year + 1:  # the last years of the calendar have no UTC
        raise future
    if len(text) == _DAY:
        if at.date() > now.astimezone(zone).date():
            raise future
        return text
    utc = (at if at.tzinfo else at.replace(tzinfo=zone)).astimezone(UTC)
    if utc > now:
        raise future
    return utc.isoformat()
