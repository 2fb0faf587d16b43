"""What the operator asks for: the texts of the fields, checked, as an order for the bench."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from skinlab.curve import Setup, check_aperture, check_thickness
from skinlab.errors import InputError
from skinlab.program import parse_program
from skinlab.subject import check_subject

DEFAULTS = {
    "subject": "",
    "site": "",
    "aperture_mm": "6",
    "thickness_mm": "1.0",
    "cycle": "1",
    "program": "ramp:100@20",
}


@dataclass(frozen=True)
class Order:
    """A measurement that was asked for, and checked."""

    port: str
    subject: str
    site: str
    setup: Setup

    @property
    def visit(self) -> tuple[str, str, str]:
        """What one session file belongs to: port, subject, site."""
        return (self.port, self.subject, self.site)


def complaint(field: str, text: str) -> str | None:
    """Return what is wrong with the text of a field, in one sentence, or None."""
    check = _CHECKS.get(field)
    if check is None:
        return None
    try:
        check(text.strip())
    except InputError as error:
        return str(error)
    return None


def read_order(texts: Mapping[str, str]) -> Order:
    """Return the order that the fields describe.

    Raises:
        InputError: a field cannot be read, or is out of range.
    """
    text = {name: value.strip() for name, value in texts.items()}
    _port(text["port"])
    check_subject(text["subject"])
    setup = Setup(
        aperture_mm=_number("aperture_mm", text["aperture_mm"]),
        thickness_mm=_number("thickness_mm", text["thickness_mm"]),
        program=parse_program(text["program"]),
        cycle=_cycle(text["cycle"]),
    )
    return Order(text["port"], text["subject"], text["site"], setup)


def _port(text: str) -> None:
    if not text:
        raise InputError("port: expected a port or a URL, e.g. /dev/ttyUSB0 or sim://?seed=1")


def _number(field: str, text: str) -> float:
    try:
        number = float(text.replace(",", "."))  # a decimal comma is what many keyboards offer
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{field} {text!r}: expected a number")
    return number


def _cycle(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and int(text) >= 1):
        raise InputError(f"cycle {text!r}: expected 1 (first loading, or after full rest) or more")
    return int(text)


_CHECKS: dict[str, Callable[[str], object]] = {
    "port": _port,
    "subject": check_subject,
    "aperture_mm": lambda text: check_aperture(_number("aperture_mm", text)),
    "thickness_mm": lambda text: check_thickness(_number("thickness_mm", text)),
    "cycle": _cycle,
    "program": parse_program,
}
