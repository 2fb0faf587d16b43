"""What readers call the kinds of error."""

from __future__ import annotations

import re
from typing import NamedTuple

_CONTRADICTION = re.compile(r"stated ([0-9.e+-]+) µm, found ([0-9.e+-]+) µm[^;]*")

_SHORT = {
    "white": "noise",
    "ou": "lasting",
    "proportional": "in proportion",
    "quantised": "steps",
    "wander": "zero wanders",
}
_OF_SIZE = {"ou": "lasting errors"}


def in_short(kind: str) -> str:
    """Return what kind of error it is, in a word or two."""
    return _SHORT.get(kind, kind.replace("_", " "))


def of_size(kind: str, size_um: float) -> str:
    """Return errors of a kind with their size: lasting errors of 2.1 µm."""
    return f"{_OF_SIZE.get(kind, in_short(kind))} of {size_um:.1f} µm"


class Contradiction(NamedTuple):
    """A stated noise that the residuals contradict: both in µm, and the clause that says so."""

    stated_um: float
    found_um: float
    clause: str


def contradiction(stated_um: float, found_um: float) -> str:
    """Return the clause by which errors are told of that contradict what was stated of them."""
    return f"stated {stated_um:.3g} µm, found {found_um:.3g} µm"


def contradiction_in(why: str) -> Contradiction | None:
    """Return what that clause says, and all behind it, in a sentence why errors are as told."""
    found = _CONTRADICTION.search(why)
    return None if found is None else Contradiction(float(found[1]), float(found[2]), found[0])
