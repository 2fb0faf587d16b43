"""How much suction a site has had: the sum over a visit. Pure; fed from samples.

The dose is the integral of the suction over time, and the time for which there was any.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.events import Sample, Segment, SegmentKind

MOST_STEP_S = 60.0  # between two samples: no suction may last longer, so that a clock has jumped
SUCTION_MBAR = 5.0  # from here on it counts: a vent is over below it, and noise stays below it


@dataclass(frozen=True, slots=True)
class Dose:
    """Suction times time in mbar·s, and time under suction in s."""

    suction_mbar_s: float = 0.0
    time_s: float = 0.0

    def __add__(self, other: Dose) -> Dose:
        return Dose(self.suction_mbar_s + other.suction_mbar_s, self.time_s + other.time_s)


class DoseMeter:
    """Sums up the samples of any number of runs.

    By the host's clock where samples tell it, because nobody held the instrument's to it; else by
    the instrument's. Between two samples the suction is the mean of both; it counts where either
    is SUCTION_MBAR or more, so that neither a dip nor samples that were lost make it less. A clock
    that jumps ends the run, and counts MOST_STEP_S: it is no reason to refuse a site for a day.
    """

    def __init__(self, before: Dose = Dose()) -> None:
        self.total = before
        self._last: Sample | None = None

    def add(self, sample: Sample) -> None:
        """Take the next sample; one that is not later than the last begins another run."""
        last, self._last = self._last, sample
        if last is None or sample.device_time_s <= last.device_time_s:
            return
        if max(last.pressure_mbar, sample.pressure_mbar) < SUCTION_MBAR:
            return
        step_s = sample.device_time_s - last.device_time_s
        if sample.host_time_s is not None and last.host_time_s is not None:
            step_s = max(0.0, sample.host_time_s - last.host_time_s)
        step_s = min(step_s, MOST_STEP_S)
        mean_mbar = max(0.0, (last.pressure_mbar + sample.pressure_mbar) / 2)
        self.total += Dose(mean_mbar * step_s, step_s)


def program_dose(segments: Sequence[Segment]) -> Dose:
    """Dose of a program that is followed exactly; vents and releases take no time in it.

    As if no height were ever reached: what it is to stop at is not known before.
    """
    total = Dose()
    target = 0.0
    for segment in segments:
        if segment.kind in {SegmentKind.RAMP, SegmentKind.UNTIL}:
            time_s = abs(segment.target_mbar - target) / segment.rate_mbar_per_s
            total += Dose((segment.target_mbar + target) / 2 * time_s, time_s)
            target = segment.target_mbar
        elif segment.kind is SegmentKind.HOLD:
            time_s = segment.duration_s if target > 0 else 0.0
            total += Dose(target * time_s, time_s)
        else:
            target = 0.0
    return total
