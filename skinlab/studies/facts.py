"""What is known of a curve before it is read: whose it is, and what it was measured with."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

from drivers.numbers import number_in, whole_in
from skinlab.curves.campaign import range_missed
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.recording.pseudonym import check_subject

LABELS = ("subject", "visit", "site", "operator", "probe", "placement")
SETUP = ("aperture_mm", "thickness_mm", "thickness_sd_mm", "program", "cycle", "repeat")
NOISE = ("noise_um", "pressure_noise_mbar")
LEFT_OUT = "left_out"  # of an exported session: why its operator left the curve out
PARTIAL = "partial"  # the same: "true" of a curve that was cut short

_NUMBERS = frozenset({"aperture_mm", "thickness_mm", "thickness_sd_mm", *NOISE})
_WHOLE = frozenset({"cycle", "repeat"})
_LONGEST = 200  # characters of a label

Facts = dict[str, Any]


def checked(facts: Mapping[str, Any], where: str) -> Facts:
    """Return facts as numbers and text.

    Raises:
        InputError: a value is out of its range or none.
    """
    found: Facts = {}
    for name, value in facts.items():
        if value is None or value == "":
            continue
        if name in _NUMBERS or name in _WHOLE:
            read, what = (whole_in, "whole number") if name in _WHOLE else (number_in, "number")
            try:
                found[name] = read(str(value))
            except (TypeError, ValueError):
                raise InputError(f"{where}: {name} is {value!r}, expected a {what}") from None
        else:
            found[name] = " ".join(str(value).split())[:_LONGEST]
    try:
        if "program" in found:
            parse_program(found["program"])
        setup = {k: found[k] for k in SETUP if k in found and k != "program"}
        Setup(**{"aperture_mm": 6.0, "thickness_mm": 1.0, **setup})
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    for name in NOISE:
        value = found.get(name)
        if (words := range_missed(name, value)) is not None:
            raise InputError(f"{where}: {name} is {value:g}, expected {words}")
    return found


def pseudonym(subject: str) -> str:
    """Return the subject as it may stand in tables: what looks like a name is replaced by a code.

    The code is made from the text, so that the same subject has the same code everywhere.
    """
    try:
        return check_subject(subject)
    except InputError:
        number = int(hashlib.sha256(subject.encode()).hexdigest()[:12], 16) % 10**7
        return f"S{number:07d}"


def setup_of(facts: Mapping[str, Any]) -> Setup:
    """Return what the curve was measured with.

    Raises:
        InputError: aperture or thickness is not known.
    """
    missing = [name for name in ("aperture_mm", "thickness_mm") if name not in facts]
    if missing:
        raise InputError(
            f"nothing says its {' and '.join(missing)}: expected a table with the columns file, "
            "aperture_mm and thickness_mm, or both stated for all curves"
        )
    program = facts.get("program")
    return Setup(
        aperture_mm=facts["aperture_mm"],
        thickness_mm=facts["thickness_mm"],
        program=None if program is None else parse_program(program),
        cycle=facts.get("cycle", 1),
        repeat=facts.get("repeat", 1),
        thickness_sd_mm=facts.get("thickness_sd_mm"),
    )
