"""Curves that are in a study twice: each counts once, whatever its files are called.

A copied file has the same bytes. A session and what was exported or imported of it have the same
readings, to the digits that a CSV has.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.csv import write_curve
from skinlab.curves.curve import Curve

_WHOSE = ("subject", "site", "visit")


def readings_hash(curve: Curve) -> str:
    """Return a hash of a curve's readings as a CSV has them."""
    text = io.StringIO()
    without_sign = {  # a zero has none
        name: getattr(curve, name) + 0.0 for name in ("pressure_mbar", "deflection_mm")
    }
    write_curve(text, replace(curve, **without_sign))
    return hashlib.sha256(text.getvalue().encode()).hexdigest()


@dataclass(frozen=True)
class Held:
    """What tells a curve from others: its file, its number in it, and hashes.

    `readings` is empty where it is not known; `labelled`: somebody stated whose it is.
    """

    file: str
    number: int
    sha256: str
    readings: str
    labelled: bool


def copies_of(curves: Iterable[Held]) -> dict[tuple[str, int], str]:
    """Return the file that has a curve already, by file and number of each that is a copy.

    Of copies the first counts of which the person is stated. In one file each curve is its own.
    """
    by_bytes: dict[tuple[str, int], str] = {}
    by_readings: dict[str, str] = {}
    found = {}
    for one in sorted(curves, key=lambda curve: not curve.labelled):
        first = by_bytes.setdefault((one.sha256, one.number), one.file)
        if first == one.file and one.readings:
            first = by_readings.setdefault(one.readings, one.file)
        by_bytes[one.sha256, one.number] = first
        if first != one.file:
            found[one.file, one.number] = first
    return found


def copied_files(curves: Sequence[Held]) -> set[str]:
    """Return the files that have no curve of their own."""
    copies = copies_of(curves)
    own = {one.file for one in curves if (one.file, one.number) not in copies}
    return {one.file for one in curves} - own


def of_others(text: Mapping[str, NDArray[np.str_]]) -> list[str]:
    """Return a sentence where curves are copies of another person's, site's or visit's.

    `text` has the columns of the tidy table.
    """
    file, same_as = text["file"].tolist(), text["same_as"].tolist()
    labels = list(zip(*(text[name].tolist() for name in _WHOSE), strict=True))
    known = dict(zip(reversed(file), reversed(labels), strict=True))  # of the first curve
    found = []
    for name, first, own in zip(file, same_as, labels, strict=True):
        other = known.get(first, own)
        if any(a and b and a != b for a, b in zip(own, other, strict=True)):
            found.append((name, first))
    if not found:
        return []
    (name, first), count = found[0], len(found)
    more = f", and {count - 1} more" if count > 1 else ""
    return [
        f"{name} has the same readings as {first}, and another subject, site or visit{more}: they "
        "do not count; one of the labels is wrong"
    ]
