"""Units of the three channels, as other software writes them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

Role = Literal["time", "pressure", "deflection"]

ROLES: tuple[Role, ...] = ("time", "pressure", "deflection")


@dataclass(frozen=True)
class Unit:
    """A unit: its usual name, and how a value becomes s, mbar or mm: times / over."""

    name: str
    role: Role
    times: float = 1.0
    over: float = 1.0


_UNITS: tuple[tuple[Unit, str], ...] = (
    (Unit("s", "time"), "s sec secs second seconds sek sekunde sekunden seconde secondes segundos"),
    (Unit("ms", "time", over=1e3), "ms msec millisecond milliseconds millisekunden"),
    (Unit("µs", "time", over=1e6), "µs us usec microseconds mikrosekunden"),
    (Unit("min", "time", times=60.0), "min minute minutes minuten"),
    (Unit("mbar", "pressure"), "mbar mbars mb millibar millibars"),
    (Unit("bar", "pressure", times=1e3), "bar"),
    (Unit("hPa", "pressure"), "hpa hektopascal hectopascal"),
    (Unit("kPa", "pressure", times=10.0), "kpa kilopascal"),
    (Unit("Pa", "pressure", over=100.0), "pa pascal"),
    # The conventional millimetre of mercury, 133.322387415 Pa (BIPM).
    (Unit("mmHg", "pressure", times=1.33322387415), "mmhg torr"),
    (Unit("mm", "deflection"), "mm millimeter millimetre millimeters millimetres"),
    (
        Unit("µm", "deflection", over=1e3),
        "µm um micron microns micrometer micrometre micrometers mikrometer mikrometern",
    ),
    (Unit("cm", "deflection", times=10.0), "cm centimeter centimetre zentimeter"),
)
_BY_SPELLING = {spelling: unit for unit, names in _UNITS for spelling in names.split()}
_CASE_MATTERS = {"mPa", "MPa"}  # not ours, and neither is to be taken for another


def units_of(role: Role) -> tuple[str, ...]:
    """Return the names of the units that a channel can have."""
    return tuple(unit.name for unit, _ in _UNITS if unit.role == role)


def find_unit(text: str) -> Unit | None:
    """Return the unit that this text spells, or None.

    >>> find_unit(" [µm] ").name
    'µm'
    """
    bare = re.sub(r"[\s.()\[\]{}<>]", "", text)
    # The Greek letter and the micro sign are two characters.
    return None if bare in _CASE_MATTERS else _BY_SPELLING.get(bare.lower().replace("μ", "µ"))
