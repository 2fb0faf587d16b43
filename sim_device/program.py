"""The firmware's idea of a program: what it needs, and where it is while it runs."""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers.events import Load, Segment, SegmentKind

MIN_PAUSE_S = 0.25  # a shorter rest is no pause
RELEASED_MBAR = 2.0  # a release is over below this


def needs(segments: Sequence[Segment]) -> tuple[float, float]:
    """Highest target (mbar) and longest suction without a pause (s; infinite for a ramp at rate 0).

    Suction counts while the target, or where it comes from, is above zero.
    """
    target = highest = spell = longest = 0.0
    for segment in segments:
        match segment.kind:
            case SegmentKind.RAMP:
                spell += _ramp_s(target, segment)
                target = segment.target_mbar
            case SegmentKind.HOLD:
                spell += segment.duration_s if target > 0 else 0.0
            case SegmentKind.REST if segment.duration_s < MIN_PAUSE_S:
                spell += segment.duration_s
                target = 0.0
            case _:
                spell = target = 0.0
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

    def advance(self, elapsed_us: int, pressure_mbar: float) -> None:
        """Go to `elapsed_us`; `pressure_mbar` is what is measured there, and ends a release."""
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
