"""Times of a clock, as hh:mm:ss or mm:ss.fff, to seconds."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinlab.errors import InputError

_CLOCK = re.compile(r"(?:([0-9]{1,2}):)?([0-5]?[0-9]):([0-5][0-9])([.,][0-9]+)?")
_DAY_S, _HOUR_S = 86_400.0, 3600.0
_EXPECTED = "expected hh:mm:ss, or mm:ss with a fraction, in each row"


def is_clock(cell: str | float) -> bool:
    """Return whether a cell is a time of a clock, which one with two parts may be."""
    return isinstance(cell, str) and ":" in cell and _CLOCK.fullmatch(cell.strip()) is not None


def clock_s(cells: Sequence[str], lines: Sequence[int]) -> NDArray[np.float64]:
    """Return the seconds (rows,) of a column; they go on past midnight, without hours past one.

    Raises:
        InputError: a cell is no time, or may be hours and minutes; names the line.
    """
    found = [_CLOCK.fullmatch(cell.strip()) for cell in cells]
    some_hours = any(match and match[1] for match in found)
    some_fractions = any(match and match[4] for match in found)
    seconds = []
    for line, cell, match in zip(lines, cells, found, strict=True):
        if match is None:
            raise InputError(f"line {line}: the time is {cell.strip()[:40]!r}; {_EXPECTED}")
        hour, minute, second, fraction = match.groups()
        if hour is None and fraction is None and (some_hours or not some_fractions):
            raise InputError(
                f"line {line}: the time {cell.strip()!r} may be hours and minutes, or minutes and "
                f"seconds; {_EXPECTED}"
            )
        whole = 3600 * int(hour or 0) + 60 * int(minute) + int(second)
        seconds.append(whole + float((fraction or ".0").replace(",", ".")))
    values = np.array(seconds)
    round_s = _DAY_S if some_hours else _HOUR_S
    back = np.flatnonzero(np.diff(values) < -0.5 * round_s)
    if back.size:  # once: a curve takes minutes
        values[back[0] + 1 :] += round_s
    return values
