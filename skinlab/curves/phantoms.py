"""Phantoms: bodies of which it is known what a probe should read on them.

A rigid one has a height; a silicone sheet is neo-Hookean (X2 = 0) with κ of linear elasticity. What
the maker or the laboratory states has a standard deviation, and that is carried into a calibration.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import msgspec

from drivers.reading import read_whole
from skinlab.curves.program import Program, check_measurable, parse_program
from skinlab.errors import InputError
from skinlab.io.documents import decode, read_toml

SCHEMA = "skinlab.phantoms/1"
SHIPPED = Path(__file__).parents[1] / "data" / "phantoms.toml"  # of the simulated probe

RIGID_PROGRAM = "ramp:4@4,hold:2"  # so little that a quiet sensor does not look frozen
SILICONE_PROGRAM = "rest:1,ramp:100@25,hold:1,ramp:0@50,rest:1,ramp:100@100,ramp:0@100"


class Phantom(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One body. `…_sd` are standard deviations of what is stated; lengths in mm.

    `program` is what the pump does on it; None: the usual one of its kind.
    """

    name: str
    kind: Literal["rigid", "silicone"]
    height_mm: float = 0.0
    height_sd_mm: float = 0.0
    X1_MPa: float | None = None
    X1_relative_sd: float = 0.02
    nu: float = 0.45
    thickness_mm: float = 1.0
    thickness_sd_mm: float = 0.0
    program: str | None = None

    def __post_init__(self) -> None:
        """Refuse what is no such body."""
        if not self.name.isidentifier():
            raise ValueError(f"name {self.name!r}: expected letters, digits and _")
        for field in self.__struct_fields__:
            value = getattr(self, field)
            if isinstance(value, float) and not math.isfinite(value):
                raise ValueError(f"{self.name}: {field} must be finite")
        if self.kind == "silicone" and self.X1_MPa is None:
            raise ValueError(f"{self.name}: a silicone phantom needs X1_MPa")
        within = {
            "height_mm": -2 <= self.height_mm <= 5,
            "height_sd_mm": 0 <= self.height_sd_mm <= 0.5,
            "X1_MPa": self.X1_MPa is None or 1e-3 <= self.X1_MPa <= 10,
            "X1_relative_sd": 0 <= self.X1_relative_sd <= 0.5,
            "nu": 0 <= self.nu <= 0.49,
            "thickness_mm": 0.1 <= self.thickness_mm <= 10,
            "thickness_sd_mm": 0 <= self.thickness_sd_mm <= 0.1 * self.thickness_mm,
        }
        for field, good in within.items():
            if not good:
                raise ValueError(f"{self.name}: {field} {getattr(self, field)} is out of range")
        self.asked  # noqa: B018 -- refuses what no probe can be asked for

    @property
    def asked(self) -> Program:
        """What the pump does on it."""
        usual = RIGID_PROGRAM if self.kind == "rigid" else SILICONE_PROGRAM
        return check_measurable(parse_program(self.program or usual))


class _Sheet(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    schema: Literal["skinlab.phantoms/1"]
    phantom: list[Phantom]


def read_phantoms(path: Path | None = None) -> list[Phantom]:
    """Return the phantoms of a sheet; None: those of the simulated probe.

    Raises:
        InputError: it cannot be read, or a field is wrong.
    """
    where = "the shipped sheet" if path is None else str(path)
    try:
        found = decode(read_toml(read_whole(SHIPPED if path is None else path)), _Sheet).phantom
    except OSError as error:
        raise InputError(f"{where}: cannot be read ({error.strerror or error})") from None
    except ValueError as error:  # InputError is one
        raise InputError(f"{where}: {error}") from None
    names = [one.name for one in found]
    if not found or len(set(names)) != len(names):
        raise InputError(f"{where}: expected phantoms with names of their own")
    return found
