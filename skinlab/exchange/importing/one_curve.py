"""Whether a table is of one curve, as far as its columns say so."""

from __future__ import annotations

from collections.abc import Sequence

from skinlab.curves.apertures import APERTURES_MM
from skinlab.curves.curve import Setup
from skinlab.curves.settings import SAMPLES
from skinlab.errors import InputError
from skinlab.exchange.importing.table import Cell, Table, number

_SAME_MM = 1e-6


def check_one_curve(table: Table, setup: Setup) -> None:
    """Refuse a table of several curves or openings, or of another opening than is stated.

    Raises:
        InputError: a column says so; names it, and the line.
    """
    for k, cells in table.constants.items():
        heading = table.headings[k]
        if heading.constant == "thickness":
            continue
        values = [number(cell, table.decimal) for cell in cells]
        if heading.constant == "curve" or None in values:
            _check_curve(table, k, cells)
        else:
            _check_opening(table, k, [value for value in values if value is not None], setup)


def _check_opening(table: Table, k: int, values: Sequence[float], setup: Setup) -> None:
    heading = table.headings[k]
    if heading.unit is None and not set(values) <= set(APERTURES_MM):
        return  # an opening of something else
    to_mm = 1.0 if heading.unit is None else heading.unit.times / heading.unit.over
    for line, value in zip(table.lines, values, strict=True):
        if abs(value * to_mm - setup.aperture_mm) > _SAME_MM:
            raise InputError(
                f"line {line}: column {heading.text!r} is {value:g}, and the curve is stated to be "
                f"of {setup.aperture_mm:g} mm; expected one curve of one opening in a file"
            )


def _check_curve(table: Table, k: int, cells: tuple[Cell, ...]) -> None:
    """Refuse several labels; what is another one in nearly each row is none."""
    labels = [f"{c:g}" if isinstance(c, float) else c.strip() for c in cells]
    told = {label for label in labels if label}
    if not 1 < len(told) <= len(labels) / SAMPLES.fewest:
        return
    first = next(label for label in labels if label)
    line, other = next(
        (line, label)
        for line, label in zip(table.lines, labels, strict=True)
        if label and label != first
    )
    raise InputError(
        f"line {line}: column {table.headings[k].text!r} is {other[:40]!r}, and "
        f"{first[:40]!r} before it: another curve; expected one curve in a file"
    )
