"""FAULTS.toml: how the simulated probe misbehaves, and when. Decoded strictly.

The clock of the faults stands at 0 until the first Start and counts the device's seconds from then
on: so `at_s = 2.0` is 2 s into the first program, whenever the host got there, and a fault with
`at_s = 0` is there from power-on, the greeting included.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

import msgspec
from msgspec import Meta

from sim_device.files import load_toml

Kind = Literal[
    "bit_flip",
    "drop_bytes",
    "duplicate_bytes",
    "garbage",
    "stall",
    "late_samples",
    "counter_jump",
    "unplug",
    "replug",
    "stuck_valve",
    "leak",
    "overshoot",
    "frozen_sensor",
    "drifting_sensor",
    "no_contact",
    "wrong_firmware",
]
KINDS: tuple[Kind, ...] = get_args(Kind)

LOOSE_CONTACT_S = 0.1  # how long a replug without an unplug before it pulls the plug
_US = 1e6


@dataclass(frozen=True, slots=True)
class Amount:
    """What a number of a fault means, its default and its range."""

    meaning: str
    default: float
    low: float
    high: float
    whole: bool = False


_PER_BYTE = Amount("chance that it happens to a byte", 0.001, 0.0, 1.0)
_BYTES = Amount("bytes in a row", 1, 1, 4096, whole=True)

# What `rate` and `size` mean; a kind that is not here has neither
RATES: dict[str, Amount] = {
    "bit_flip": _PER_BYTE,
    "drop_bytes": _PER_BYTE,
    "duplicate_bytes": _PER_BYTE,
    "garbage": Amount("bursts in a second", 10, 0, 1000),
    "drifting_sensor": Amount("µm in a second", 50, -1e6, 1e6),
}
SIZES: dict[str, Amount] = {
    "bit_flip": Amount("bits of the byte", 1, 1, 8, whole=True),
    "drop_bytes": _BYTES,
    "duplicate_bytes": _BYTES,
    "garbage": Amount("bytes of a burst", 16, 1, 4096, whole=True),
    "late_samples": Amount("s that they come late", 0.5, 0, 60),
    "counter_jump": Amount("samples that the counter is ahead", 10, -1e6, 1e6, whole=True),
    "stuck_valve": Amount("part of the valve's opening that is left", 0, 0, 1),
    "leak": Amount("part of the suction that is lost", 0.3, 0, 1),
    "overshoot": Amount("mbar above the set point", 30, 0, 500),
}


class Fault(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One fault: from `at_s` on, for `for_s` (None: to the end)."""

    kind: str
    at_s: Annotated[float, Meta(ge=0)] = 0.0
    for_s: Annotated[float, Meta(gt=0)] | None = None
    rate: float | None = None
    size: float | None = None

    def __post_init__(self) -> None:
        """Refuse an unknown kind, and what the kind does not have, or not so much of."""
        if self.kind not in KINDS:
            raise ValueError(f"kind {self.kind!r} is not known; expected one of {', '.join(KINDS)}")
        for name in ("at_s", "for_s"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise ValueError(f"{name} must be finite, not {value}")
        for name, table in (("rate", RATES), ("size", SIZES)):
            value = getattr(self, name)
            if value is not None:
                _check(self.kind, name, value, table.get(self.kind))

    @property
    def amount(self) -> float:
        """Its size, or the default of its kind."""
        return SIZES[self.kind].default if self.size is None else self.size

    @property
    def often(self) -> float:
        """Its rate, or the default of its kind."""
        return RATES[self.kind].default if self.rate is None else self.rate


class FaultFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole FAULTS.toml."""

    fault: tuple[Fault, ...] = ()


def load_fault_file(path: str | Path) -> tuple[Fault, ...]:
    """Read and check a FAULTS.toml.

    Raises ValueError, one sentence that names the file and the field or line.
    """
    return load_toml(path, FaultFile).fault


class Schedule:
    """Which fault is active when. Times are µs on the clock of the faults."""

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        self._windows: dict[str, list[tuple[float, float, Fault]]] = {}
        faults = tuple(faults)
        for fault in (*faults, *_loose_contacts(faults)):
            begin = fault.at_s * _US
            end = math.inf if fault.for_s is None else begin + fault.for_s * _US
            if fault.kind == "unplug":
                replugs = [f.at_s * _US for f in faults if f.kind == "replug"]
                end = min([end, *(at for at in replugs if at > begin)])
            self._windows.setdefault(fault.kind, []).append((begin, end, fault))

    def __bool__(self) -> bool:
        """Whether anything goes wrong at all."""
        return bool(self._windows)

    def active(self, kind: Kind, time_us: int) -> Fault | None:
        """Give the fault of this kind that is active, if there is one."""
        for begin, end, fault in self._windows.get(kind, ()):
            if begin <= time_us < end:
                return fault
        return None

    def changes_after(self, time_us: int, kinds: Iterable[Kind]) -> bool:
        """Whether a fault of these kinds begins or ends later, by time alone."""
        return any(
            time_us < edge < math.inf
            for kind in kinds
            for begin, end, _ in self._windows.get(kind, ())
            for edge in (begin, end)
        )


def _loose_contacts(faults: Iterable[Fault]) -> list[Fault]:
    """Give the unplugs that a replug means where nothing was unplugged: out, and in again."""
    loose = list[Fault]()
    out_until_s = -math.inf
    for fault in sorted(faults, key=lambda fault: fault.at_s):
        if fault.kind == "unplug":
            out_until_s = math.inf if fault.for_s is None else fault.at_s + fault.for_s
        elif fault.kind == "replug":
            if fault.at_s > out_until_s:
                loose.append(Fault("unplug", fault.at_s, fault.for_s or LOOSE_CONTACT_S))
            out_until_s = fault.at_s
    return loose


def _check(kind: str, name: str, value: float, amount: Amount | None) -> None:
    if amount is None:
        raise ValueError(f"{name}: a fault of kind {kind} has no {name}")
    if not amount.low <= value <= amount.high or (amount.whole and value != int(value)):
        whole = "a whole number, " if amount.whole else ""
        raise ValueError(
            f"{name} of {kind} ({amount.meaning}) must be {whole}{amount.low:g} to "
            f"{amount.high:g}, not {value:g}"
        )
