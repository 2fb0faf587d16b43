"""Numbers in text from outside: options, fields, cells, lines of an instrument.

`1_0` is none of them, which Python takes for 10.
"""

from __future__ import annotations


def number_in(text: str) -> float:
    """Return the number that a text says; may be infinite or NaN. Raises ValueError."""
    return float(_plain(text))


def whole_in(text: str) -> int:
    """Return the whole number that a text says. Raises ValueError."""
    return int(_plain(text))


def _plain(text: str) -> str:
    if "_" in text:
        raise ValueError(f"{text!r} is not a number")
    return text
