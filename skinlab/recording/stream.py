"""What flows through the pipeline: driver events and plans in, messages out.

A live probe, a recording and a recovered journal all give the same items, so that what runs at the
bedside is what is replayed and tested.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivers.events import Event, Sample, TimedEvent
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.growing import GrowingCurve
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.quality.gates.base import Finding

if TYPE_CHECKING:
    from skinlab.inference.result import Identification


@dataclass(frozen=True, slots=True)
class Planned:
    """The next run of the instrument belongs to this setup; None: nobody can say to which."""

    setup: Setup | None


Item = Planned | TimedEvent


@dataclass(frozen=True, slots=True, eq=False)
class CurveStarted:
    """A run began; `curve` grows with it."""

    index: int  # from 1
    curve: GrowingCurve


@dataclass(frozen=True, slots=True)
class Sampled:
    """A sample of the running curve (index), or of the vent after it."""

    index: int
    sample: Sample


@dataclass(frozen=True, slots=True, eq=False)
class CurveCompleted:
    """A run ended; `cut` says why it ended early, where it did."""

    index: int
    curve: Curve
    cut: str | None
    lost_samples: int


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """The answer for a completed curve."""

    index: int
    curve: Curve
    result: Identification


@dataclass(frozen=True, slots=True)
class Happened:
    """Anything else that the driver said."""

    event: Event


@dataclass(frozen=True, slots=True)
class Flagged:
    """The curve fails a quality gate; said once a gate, as soon as it is known."""

    index: int
    finding: Finding


Message = CurveStarted | Sampled | CurveCompleted | Identified | Happened | Flagged


def setup_to_json(setup: Setup) -> dict[str, Any]:
    """Return the setup as plain data; a placement only where it is stated, as in older sessions."""
    sd = setup.thickness_sd_mm
    data = {
        "aperture_mm": float(setup.aperture_mm),  # so that a 6 is hashed as it reads back
        "thickness_mm": float(setup.thickness_mm),
        "thickness_sd_mm": None if sd is None else float(sd),
        "program": None if setup.program is None else str(setup.program),
        "cycle": setup.cycle,
        "repeat": setup.repeat,
    }
    return data if setup.placement is None else data | {"placement": setup.placement}


def setup_from_json(data: dict[str, Any]) -> Setup:
    """Return the setup that `setup_to_json` wrote.

    Raises:
        InputError: a value is out of its range.
    """
    program = data["program"]
    sd = data["thickness_sd_mm"]
    placement = data.get("placement")
    if not isinstance(placement, str | None):
        raise InputError(f"setup: placement is {placement!r}, expected a text")
    return Setup(
        aperture_mm=float(data["aperture_mm"]),
        thickness_mm=float(data["thickness_mm"]),
        program=None if program is None else parse_program(program),
        cycle=int(data["cycle"]),
        repeat=int(data["repeat"]),
        thickness_sd_mm=None if sd is None else float(sd),
        placement=placement,
    )
