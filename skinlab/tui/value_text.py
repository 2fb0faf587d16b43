"""A number in words and as a bar: names, units, intervals, what a flag says."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from skinlab.inference.flags import CATALOGUE
from skinlab.inference.result import Value
from skinlab.mechanics.names import (
    is_logarithmic,
    is_poisson,
    of_law,
    parameter_of,
    plain,
    unit_of,
)
from skinlab.report.rounding import best_words, decimals, interval_words, rounded
from skinlab.tui.canvas import interval_bar, share
from skinlab.tui.plot_data import round_down, round_up
from skinlab.tui.shown import Entry

if TYPE_CHECKING:
    from skinlab.studies.reference import Range


_LEAST_BAR = 8  # cells; a shorter one shows nothing
_PROGRAM = 24  # cells of a program in the list


def name_of(parameter: str) -> str:
    """Return a parameter's name without its unit."""
    return plain(parameter)[0]


def flag_words(flag: str) -> str:
    """Return a flag of an identification in words."""
    kind, _, parameter = flag.partition(":")
    words = CATALOGUE[kind].label if kind in CATALOGUE else kind.replace("_", " ")
    return words.format(name_of(parameter)) if "{}" in words else words


def meaning(name: str) -> str:
    """Return what a parameter is, in a few words."""
    found = parameter_of(name)
    return name if found is None else found.meaning.partition(",")[0]


def value_words(name: str, value: Value, *, loose: bool = False, columns: int = 80) -> str:
    """Return interval and unit, and then the value or why there is no use in it."""
    unit = unit_of(name)
    interval = f"{interval_text(value) or best_words(value)}{unit and ' '}{unit}"
    if loose:
        long = f"{interval}, not fixed by this curve"
        return long if len(long) <= columns else f"{interval}, not fixed"
    if value.low is None or value.high is None:
        return f"{interval}, no interval"
    return f"{interval}  ({best_words(value)})"


def written_like(number: float, value: Value) -> str:
    """Return a number with the decimals of another one."""
    if value.low is None or value.high is None:
        return digits(number, 3)
    return rounded(number, decimals(value.low, value.high))


_POISSON_RANGE = (0.2, 0.5)
_ROOM = 2.0  # at both ends of an interval, on a scale of its own


def value_scale(name: str, values: Sequence[float]) -> tuple[float, float, bool]:
    """Return round ends of a scale for these values, and whether it is logarithmic."""
    low, high = min(values), max(values)
    if is_poisson(name):
        return (min(_POISSON_RANGE[0], math.floor(10.0 * low) / 10.0), _POISSON_RANGE[1], False)
    if low > 0 and is_logarithmic(name):
        return round_down(low / _ROOM), round_up(high * _ROOM, least=0.0), True
    room = (high - low) / _ROOM or abs(high) or 1.0
    reach = round_up(room, least=0.0)
    return (
        reach * np.floor((low - 0.2 * room) / reach),
        reach * np.ceil((high + 0.2 * room) / reach),
        False,
    )


def value_bar(name: str, value: Value, columns: int, usual: Range | None = None) -> str:
    """Return the interval as a bar between the labels of its scale; nothing where there is none."""
    if value.low is None or value.high is None:
        return ""
    behind = None if usual is None else usual.span
    ends = (value.low, value.high, *(behind or ()))
    low, high, logarithmic = value_scale(name, ends)
    left, right = f"{low:g} ", f" {high:g}"
    width = columns - len(left) - len(right)
    if width < _LEAST_BAR:
        return ""
    return f"{left}{scaled_bar(value, low, high, width, behind, logarithmic=logarithmic)}{right}"


def scaled_bar(
    value: Value,
    low: float,
    high: float,
    columns: int,
    behind: tuple[float, float] | None = None,
    *,
    logarithmic: bool,
) -> str:
    """Return the interval of a value as a bar on this scale."""
    numbers = np.array([value.low, value.value, value.high, *(behind or ())], dtype=float)
    ends = np.array([low, high])
    if logarithmic:
        numbers, ends = np.log(numbers), np.log(ends)
    at = [float(x) for x in share(numbers, *ends.tolist())]
    return interval_bar(at[0], at[1], at[2], columns, (at[3], at[4]) if behind else None)


def digits(value: float, significant: int) -> str:
    """Return the number with all of its significant digits, zeros too."""
    return f"{value:#.{significant}g}".rstrip(".")


def interval_text(value: Value) -> str:
    """Return the interval, rounded to what it carries, or nothing where there is none."""
    return "" if value.low is None or value.high is None else interval_words(value)


def value_columns(entries: Iterable[Entry]) -> tuple[str, ...]:
    """Return the law's parameters that the list of these curves shows."""
    return of_law((e.result.parameters or ()) if e.result is not None else () for e in entries)


def column_title(name: str) -> str:
    """Return the heading of a parameter's column: X1 MPa."""
    return " ".join(plain(name)).rstrip()


def shortened(text: str, most: int = _PROGRAM) -> str:
    """Return the text, cut where it is too long for the list."""
    return text if len(text) <= most else text[: most - 1] + "…"
