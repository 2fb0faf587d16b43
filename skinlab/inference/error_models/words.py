"""What readers call the kinds of error."""

from __future__ import annotations

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
