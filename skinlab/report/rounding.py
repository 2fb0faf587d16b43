"""Numbers with as many digits as they carry: the interval says how many."""

from __future__ import annotations

import math
from typing import Protocol

_PARTS = 5.0  # of an interval: the last digit is no coarser


class Interval(Protocol):
    """A value with its interval; None where there is none."""

    @property
    def value(self) -> float:
        """The median, or the optimum."""

    @property
    def low(self) -> float | None:
        """The lower end."""

    @property
    def high(self) -> float | None:
        """The upper end."""


def decimals(low: float, high: float) -> int:
    """Return after how many decimals nothing is carried any more; negative: whole tens, ….

    For example 2 for 0.021 to 0.158, and 1 for 1.03 to 3.32.
    """
    width = abs(high - low)
    if not (math.isfinite(width) and width > 0):
        return _three_digits(low)
    return -math.floor(math.log10(width / _PARTS))


def rounded(value: float, places: int) -> str:
    """Return the number with so many decimals."""
    return f"{round(value, places):.{max(places, 0)}f}"


def interval_words(value: Interval) -> str:
    """Return both ends, rounded to what they carry: 1.0–3.3; without an interval three digits."""
    if value.low is None or value.high is None:
        return rounded(value.value, _three_digits(value.value))
    places = decimals(value.low, value.high)
    return f"{rounded(value.low, places)}–{rounded(value.high, places)}"


def best_words(value: Interval) -> str:
    """Return the value itself, with as many decimals as its interval has."""
    if value.low is None or value.high is None:
        return rounded(value.value, _three_digits(value.value))
    return rounded(value.value, decimals(value.low, value.high))


def _three_digits(value: float) -> int:
    """Return with how many decimals a number has three significant digits."""
    if not math.isfinite(value) or value == 0:
        return 2
    return 2 - math.floor(math.log10(abs(value)))


def half_width_percent(value: Interval) -> float | None:
    """Return half the interval as per cent of its middle; None where there is no interval.

    Of a stiffness by the ratio of its ends, as it is looked for in its logarithm.
    """
    if value.low is None or value.high is None or not value.high > 0:
        return None
    return math.inf if value.low <= 0 else 100.0 * (math.sqrt(value.high / value.low) - 1.0)
