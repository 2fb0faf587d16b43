"""The firmware's idea of a program: what it needs, and where it is while it runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from drivers.events import Load, Segment, SegmentKind

MIN_PAUSE_S = 0.25  # a shorter rest is no pause
RELEASED_MBAR = 2.0  # a release is over below this


def needs(segments: Sequence[Segment]) -> tuple[float, float]:
    """Highest target (mbar) and longest suction without a pause (s; infinite for a ramp at rate 0).

    Suction counts while the target, or where it comes from, is above zero.
    """
    least = target = highest = spell = longest = 0.0  # behind an until it is between the two
    for segment in segments:
        match segment.kind:
            case SegmentKind.RAMP:
                spell += max(_ramp_s(target, segment), _ramp_s(least, segment))
                least = target = segment.target_mbar
            case SegmentKind.UNTIL:
                spell += _ramp_s(least, segment)
                target = max(target, segment.target_mbar)
            case SegmentKind.HOLD:
                spell += segment.duration_s if target > 0 else 0.0
            case SegmentKind.REST if segment.duration_s < MIN_PAUSE_S:
                spell += segment.duration_s
                least = target = 0.0
            case _:
                spell = least = target = 0.0
        highest = max(highest, target)
        longest = max(longest, spell)
    return highest, longest


class Run:
    """One run of a loaded program, on the device's microseconds since Start."""

    def __init__(self, load: Load) -> None:
        self.load = load
        self.index = 0  # of the segment; len(segments) from the end on
        self.set_point_mbar = 0.0
        self.valve_open = False
        self.release_us = 0  # how long the present release has gone on
        self._begin_us = 0
        self._from_mbar = 0.0

    @property
    def ended(self) -> bool:
        """Whether the last segment is over."""
        return self.index == len(self.load.segments)

    def advance(
        self,
        elapsed_us: int,
        pressure_mbar: float,
        read_mm: Callable[[], float] = lambda: -math.inf,
    ) -> None:
        """Go to `elapsed_us`; `pressure_mbar` is what is measured there, and ends a release.

        `read_mm` reads the deflection there, which ends a rise until a height.
        """
        while not self.ended:
            segment = self.load.segments[self.index]
            within_us = elapsed_us - self._begin_us
            self.release_us = 0
            match segment.kind:
                case SegmentKind.RAMP:
                    target = segment.target_mbar
                    duration_us = math.ceil(1e6 * _ramp_s(self._from_mbar, segment))
                    part = min(1.0, within_us / duration_us) if duration_us else 1.0
                    self.set_point_mbar = self._from_mbar + part * (target - self._from_mbar)
                    self.valve_open = False
                case SegmentKind.UNTIL:
                    duration_us = math.ceil(1e6 * _ramp_s(self._from_mbar, segment))
                    part = min(1.0, within_us / duration_us) if duration_us else 1.0
                    way = segment.target_mbar - self._from_mbar
                    target = self.set_point_mbar = self._from_mbar + part * max(0.0, way)
                    self.valve_open = False
                    if within_us < duration_us and read_mm() >= segment.height_mm:
                        duration_us = within_us
                case SegmentKind.HOLD:
                    target = self._from_mbar
                    duration_us = round(1e6 * segment.duration_s)
                    self.set_point_mbar = target
                    self.valve_open = False
                case SegmentKind.REST:
                    target = 0.0
                    duration_us = round(1e6 * segment.duration_s)
                    self.set_point_mbar = 0.0
                    self.valve_open = True
                case SegmentKind.RELEASE:
                    target = 0.0
                    self.set_point_mbar = 0.0
                    self.valve_open = True
                    self.release_us = within_us
                    duration_us = within_us if pressure_mbar < RELEASED_MBAR else within_us + 1
            if within_us < duration_us:
                return
            self._begin_us += duration_us
            self._from_mbar = target
            self.index += 1
        self.set_point_mbar = 0.0
        self.valve_open = True


def _ramp_s(start_mbar: float, segment: Segment) -> float:
    if segment.rate_mbar_per_s <= 0:
        return math.inf
    return abs(segment.target_mbar - start_mbar) / segment.rate_mbar_per_s
