"""What the operator asks for: the texts of the fields, checked, as an order."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from urllib.parse import parse_qsl, urlencode

from drivers.events import Hello
from drivers.numbers import number_in
from skinlab.acquisition.measurement_messages import Plan
from skinlab.curves.apertures import check_aperture
from skinlab.curves.curve import Setup, check_thickness
from skinlab.curves.program import Program, check_measurable, parse_program
from skinlab.errors import InputError
from skinlab.recording.pseudonym import check_site, check_subject

DEFAULTS = {
    "subject": "",
    "site": "",
    "aperture_mm": "6",
    "thickness_mm": "1.0",
    "thickness_sd_mm": "",
    "cycle": "1",
    "repeats": "1",
    "rest_s": "5",
    "program": "ramp:100@20",
}


@dataclass(frozen=True)
class Order:
    """A measurement that was asked for, and checked."""

    port: str
    subject: str
    site: str
    setup: Setup  # of the first repeat
    repeats: int = 1
    rest_s: float = 5.0  # between two repeats

    @property
    def plan(self) -> Plan:
        """What is to be measured."""
        return Plan(self.setup, self.repeats, self.rest_s)

    def with_left(self, plan: Plan) -> Order:
        """Return the order for what is left of it."""
        return replace(self, setup=plan.setup, repeats=plan.repeats)

    @property
    def visit(self) -> tuple[str, str]:
        """What one session file belongs to: subject and site."""
        return (self.subject, self.site)


def with_opening(port: str, aperture_mm: float) -> str:
    """Return the port of the same simulated probe with another head; any other port as it is.

    The head of a real probe is changed by hand, and the port stays the same.
    """
    return with_query(port, aperture_mm=f"{aperture_mm:g}") if port.startswith("sim:") else port


def with_query(port: str, **values: str) -> str:
    """Return the port with these values in its query, in place of those that it had."""
    base, _, query = port.partition("?")
    kept = [(key, value) for key, value in parse_qsl(query) if key not in values]
    return f"{base}?{urlencode([*kept, *values.items()], safe='/')}"


MOST_REPEATS = 20
MOST_REST_S = 3600.0


def complaint(field: str, text: str, hello: Hello | None = None) -> str | None:
    """Return what is wrong with the text of a field, in one sentence, or None.

    With `hello` the program must be within that instrument's limits too.
    """
    check = _CHECKS.get(field)
    if check is None:
        return None
    try:
        found = check(text.strip())
        if isinstance(found, Program) and hello is not None:
            check_limits(found, hello)
    except InputError as error:
        return str(error)
    return None


def check_limits(program: Program, hello: Hello) -> None:
    """Refuse what this instrument would refuse.

    Raises:
        InputError: it goes beyond the instrument's limits.
    """
    if program.max_pressure_mbar > hello.max_pressure_mbar:
        raise InputError(
            f"program {program}: up to {program.max_pressure_mbar:g} mbar; this instrument goes "
            f"to {hello.max_pressure_mbar:g} mbar"
        )
    if program.longest_suction_s > hello.max_suction_s:
        raise InputError(
            f"program {program}: {program.longest_suction_s:g} s of suction without a pause; this "
            f"instrument holds at most {hello.max_suction_s:g} s"
        )


def read_order(texts: Mapping[str, str]) -> Order:
    """Return the order that the fields describe.

    Raises:
        InputError: a field cannot be read, or is out of range.
    """
    text = {name: value.strip() for name, value in texts.items()}
    _port(text["port"])
    check_subject(text["subject"])
    check_site(text["site"])
    setup = Setup(
        aperture_mm=_number("aperture_mm", text["aperture_mm"]),
        thickness_mm=_number("thickness_mm", text["thickness_mm"]),
        program=_program(text["program"]),
        cycle=_cycle(text["cycle"]),
        thickness_sd_mm=_sd(text["thickness_sd_mm"]),
    )
    return Order(
        text["port"],
        text["subject"],
        text["site"],
        setup,
        _repeats(text["repeats"]),
        _rest(text["rest_s"]),
    )


def _port(text: str) -> None:
    if not text:
        raise InputError("port: expected a port or a URL, e.g. /dev/ttyUSB0 or sim://?seed=1")


def _program(text: str) -> Program:
    return check_measurable(parse_program(text))


def _number(field: str, text: str) -> float:
    try:
        number = number_in(text.replace(",", "."))  # a decimal comma is what many keyboards offer
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{field} {text!r}: expected a number")
    return number


def _sd(text: str) -> float | None:
    if not text:
        return None
    number = _number("thickness_sd_mm", text)
    if not 0 < number <= 1:
        raise InputError(f"thickness_sd_mm {text!r}: expected up to 1 mm, above 0, or nothing")
    return number


def _repeats(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and 1 <= int(text) <= MOST_REPEATS):
        raise InputError(f"repeats {text!r}: expected 1–{MOST_REPEATS}")
    return int(text)


def _rest(text: str) -> float:
    number = _number("rest_s", text)
    if not 0 <= number <= MOST_REST_S:
        raise InputError(f"rest_s {text!r}: expected 0–{MOST_REST_S:g} s between repeats")
    return number


def _cycle(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and int(text) >= 1):
        raise InputError(f"cycle {text!r}: expected 1 (first loading, or after full rest) or more")
    return int(text)


_CHECKS: dict[str, Callable[[str], object]] = {
    "port": _port,
    "subject": check_subject,
    "site": check_site,
    "aperture_mm": lambda text: check_aperture(_number("aperture_mm", text)),
    "thickness_mm": lambda text: check_thickness(_number("thickness_mm", text)),
    "thickness_sd_mm": _sd,
    "cycle": _cycle,
    "repeats": _repeats,
    "rest_s": _rest,
    "program": _program,
}
