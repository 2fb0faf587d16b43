"""Limits of the driver, and the check of a program against them. Refused, never clipped.

Not clinically validated. An instrument's own stricter limits win.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.errors import LimitError
from drivers.events import Abilities, Hello, Load, Segment, SegmentKind

CEILING_PRESSURE_MBAR = 500.0
CEILING_SUCTION_S = 60.0
MAX_RAMP_MBAR_PER_S = 100_000.0  # a step is a ramp this steep; the pump follows as it can
DEFAULT_DOSE_MBAR_S = 60_000.0  # reason in docs/safety.md
MIN_PAUSE_S = 0.25  # a shorter rest does not let the pressure fall, and is no pause
NO_ABILITIES = Abilities()
CANNOT_UNTIL = "cannot stop at a height: `until` is for instruments that say they can"
_TIME_SLACK_S = 1e-6  # one count of time on the wire: sums of floats may end that far off


@dataclass(frozen=True, slots=True)
class Limits:
    """What the driver allows, and when it vents. The two ceilings can be lowered, never raised.

    Raises ValueError for a limit that is not positive and finite, or above its ceiling.
    """

    max_pressure_mbar: float = CEILING_PRESSURE_MBAR  # of any command
    max_suction_s: float = CEILING_SUCTION_S  # suction without a pause
    overshoot_mbar: float = 10.0  # above the command; this or the fraction, whichever is more
    overshoot_fraction: float = 0.05
    stale_s: float = 0.3  # without a sample; this or so many intervals, whichever is more
    stale_intervals: float = 3.0
    keep_alive_s: float = 0.1  # between two keep-alive frames
    vent_pressure_mbar: float = 5.0  # below this after a vent ...
    vent_time_s: float = 1.0  # ... within this time
    frozen_s: float = 0.5  # identical samples of deflection or pressure for this long ...
    frozen_pressure_mbar: float = 5.0  # ... while the pressure, or a ramp, moved by this much
    shortfall_mbar: float = 20.0  # below the command; this or the fraction, whichever is more ...
    shortfall_fraction: float = 0.5
    shortfall_s: float = 1.0  # ... for this long: a leak, or no skin under the probe
    inward_mm: float = 0.5  # a deflection below minus this, or above the opening, cannot be
    inward_mbar: float = 20.0  # nor a pressure below minus this: a wrong sign, or a broken sensor
    # How far a run may be from the program. Time, by the host's clock: what a link may keep back
    # before it is stale, and a clock of the instrument that is this part off
    clock_s: float = 0.3
    clock_fraction: float = 0.02
    program_slack_s: float = 0.15  # by the instrument's own clock: segments begin late or early
    pump_lag_s: float = 0.3  # delay, or time constant, with which pressure follows a command down
    release_s: float = 2.0  # a release or the final vent that is not over by then never will be
    suction_slack_s: float = 1.0  # lag and vent after the longest suction that is allowed
    height_mm: float = 0.1  # a height may be read this much higher, or ...
    height_fraction: float = 0.1  # ... this part, before it counts as passed
    max_dose_mbar_s: float = DEFAULT_DOSE_MBAR_S  # suction times time at one site in one visit

    def __post_init__(self) -> None:
        """Refuse limits that are no limits."""
        for name in self.__slots__:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"limit {name} must be positive and finite, not {value}")
        if self.max_pressure_mbar > CEILING_PRESSURE_MBAR:
            raise ValueError(f"limit max_pressure_mbar cannot exceed {CEILING_PRESSURE_MBAR:g}")
        if self.max_suction_s > CEILING_SUCTION_S:
            raise ValueError(f"limit max_suction_s cannot exceed {CEILING_SUCTION_S:g}")

    def overshoot_above(self, command_mbar: float) -> float:
        """Pressure (mbar) above which a command of `command_mbar` is overshot."""
        return command_mbar + max(self.overshoot_mbar, self.overshoot_fraction * command_mbar)

    def shortfall_below(self, command_mbar: float) -> float:
        """Pressure (mbar) below which a command of `command_mbar` is not followed."""
        return command_mbar - max(self.shortfall_mbar, self.shortfall_fraction * command_mbar)


DEFAULT_LIMITS = Limits()


@dataclass(frozen=True, slots=True)
class Bounds:
    """What a program needs at most: pressure in mbar, suction without a pause in s."""

    max_pressure_mbar: float
    max_suction_s: float


def program_bounds(segments: Sequence[Segment]) -> Bounds:
    """Highest target and longest suction without a pause of a program.

    As if no height were ever reached, or at once, whichever pulls longer.

    A pause is a release, or a rest of at least MIN_PAUSE_S; a ramp to zero is none.
    Raises LimitError for a segment that makes no sense.
    """
    least = target = highest = suction = longest = 0.0  # `least` below `target` behind an until
    for index, segment in enumerate(segments):
        _check_segment(index, segment)
        if segment.kind is SegmentKind.RAMP:
            suction += longest_way_mbar(segment, least, target) / segment.rate_mbar_per_s
            least = target = segment.target_mbar
        elif segment.kind is SegmentKind.UNTIL:
            if segment.target_mbar < target:
                raise LimitError(
                    f"segment {index} (until): at most {segment.target_mbar:g} mbar, which is "
                    f"below the {target:g} mbar before it"
                )
            suction += (segment.target_mbar - least) / segment.rate_mbar_per_s
            target = segment.target_mbar
        elif segment.kind is SegmentKind.HOLD:
            suction += segment.duration_s if target > 0 else 0.0
        else:
            least = target = 0.0
            pause = segment.kind is SegmentKind.RELEASE or segment.duration_s >= MIN_PAUSE_S
            suction = 0.0 if pause else suction + segment.duration_s
        highest = max(highest, target)
        longest = max(longest, suction)
    return Bounds(highest, longest)


def longest_way_mbar(ramp: Segment, least_mbar: float, most_mbar: float) -> float:
    """How far a ramp can have to go, from anywhere between two pressures."""
    return max(abs(ramp.target_mbar - least_mbar), abs(ramp.target_mbar - most_mbar))


def check_load(
    load: Load, limits: Limits, hello: Hello, abilities: Abilities = NO_ABILITIES
) -> None:
    """Raise LimitError where `load` exceeds a limit; the message names what, and which."""
    if not load.segments:
        raise LimitError("the program is empty")
    heights = [s.height_mm for s in load.segments if s.kind is SegmentKind.UNTIL]
    if heights and not abilities.until:
        raise LimitError(f"{hello.model} {CANNOT_UNTIL}")
    if heights and hello.aperture_mm is not None and max(heights) > hello.aperture_mm:
        raise LimitError(
            f"a height of {max(heights):g} mm is above the opening of {hello.aperture_mm:g} mm"
        )
    needs = program_bounds(load.segments)
    max_pressure, whose_pressure = _stricter(limits.max_pressure_mbar, hello.max_pressure_mbar)
    max_suction, whose_suction = _stricter(limits.max_suction_s, hello.max_suction_s)
    for what, value in (
        ("highest target", needs.max_pressure_mbar),
        ("maximum pressure", load.max_pressure_mbar),
    ):
        if not 0 <= value <= max_pressure:
            raise LimitError(
                f"{what} {value:g} mbar is outside 0 to {max_pressure:g} mbar ({whose_pressure})"
            )
    for what, value in (
        ("suction without a pause", needs.max_suction_s),
        ("maximum suction time", load.max_suction_s),
    ):
        if not 0 <= value <= max_suction + _TIME_SLACK_S:
            raise LimitError(
                f"{what} of {value:g} s is outside 0 to {max_suction:g} s ({whose_suction})"
            )
    if not hello.min_rate_hz <= load.rate_hz <= hello.max_rate_hz:
        raise LimitError(
            f"sample rate {load.rate_hz:g} Hz is outside {hello.min_rate_hz:g} to "
            f"{hello.max_rate_hz:g} Hz (limit of the instrument)"
        )
    if needs.max_pressure_mbar > load.max_pressure_mbar:
        raise LimitError(
            f"highest target {needs.max_pressure_mbar:g} mbar is above the program's own maximum "
            f"pressure {load.max_pressure_mbar:g} mbar"
        )
    if needs.max_suction_s > load.max_suction_s + _TIME_SLACK_S:
        raise LimitError(
            f"suction without a pause of {needs.max_suction_s:g} s is above the program's own "
            f"maximum {load.max_suction_s:g} s"
        )


def _stricter(driver: float, instrument: float) -> tuple[float, str]:
    if instrument < driver:
        return instrument, "limit of the instrument"
    return driver, "limit of the driver"


def _check_segment(index: int, segment: Segment) -> None:
    kind = segment.kind
    used = {
        SegmentKind.RAMP: {"target_mbar", "rate_mbar_per_s"},
        SegmentKind.UNTIL: {"target_mbar", "rate_mbar_per_s", "height_mm"},
        SegmentKind.HOLD: {"duration_s"},
        SegmentKind.RELEASE: set(),
        SegmentKind.REST: {"duration_s"},
    }[kind]
    for name in ("target_mbar", "rate_mbar_per_s", "duration_s", "height_mm"):
        value = getattr(segment, name)
        if not (math.isfinite(value) and value >= 0):
            raise LimitError(
                f"segment {index} ({kind}): {name} must be finite and not negative, not {value}"
            )
        if value and name not in used:
            raise LimitError(f"segment {index} ({kind}): {name} must be 0, not {value:g}")
    rises = kind in {SegmentKind.RAMP, SegmentKind.UNTIL}
    if kind is SegmentKind.UNTIL and not segment.height_mm > 0:
        raise LimitError(f"segment {index} (until): height_mm must be positive")
    if rises and not 0 < segment.rate_mbar_per_s <= MAX_RAMP_MBAR_PER_S:
        raise LimitError(
            f"segment {index} ({kind}): rate {segment.rate_mbar_per_s:g} mbar/s is outside 0 "
            f"(excluded) to {MAX_RAMP_MBAR_PER_S:g} mbar/s"
        )
