"""What a running program allows at a moment: its segment, and the highest pressure. Pure.

Time is the instrument's, in s since Start; the watchdog holds that clock against the host's own.
Everything but a release lasts as long as the program says. A release ends when the instrument
measures that the pressure has fallen, so that what follows is counted from where its end was seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers.events import Segment, SegmentKind
from drivers.limits import Limits

_OPEN_VALVE = frozenset({SegmentKind.RELEASE, SegmentKind.REST})
_FORGOTTEN = 12.0  # time constants after which nothing is left of 500 mbar


def targets(segments: Sequence[Segment]) -> tuple[float, ...]:
    """Command at the end of each segment, in mbar."""
    found = []
    target = 0.0
    for segment in segments:
        if segment.kind is SegmentKind.RAMP:
            target = segment.target_mbar
        elif segment.kind is not SegmentKind.HOLD:
            target = 0.0
        found.append(target)
    return tuple(found)


class Envelope:
    """Follows one run of a program, sample by sample.

    `see` takes the segment that a sample names and says what is wrong with it; `highest_mbar` is
    the highest pressure that the program can still show at a time not before the last one seen.
    The final vent is segment len(segments), and lasts as a release does.
    """

    def __init__(self, segments: Sequence[Segment], limits: Limits) -> None:
        self._segments = tuple(segments)
        self._limits = limits
        self._targets = targets(segments)
        count = len(self._segments)
        # Earliest and latest begin of each segment, of the final vent, and its end
        self._earliest = [0.0] * (count + 2)
        self._latest = [0.0] * (count + 2)
        self._lay_out(0)
        self._since: list[float] = []  # first sample of each segment that was reached, or passed
        self._after = 0.0  # last sample before the present segment
        self._last_s = 0.0

    @property
    def segment(self) -> int:
        """Index of the segment seen last; -1 before the first."""
        return len(self._since) - 1

    @property
    def end_s(self) -> float:
        """Latest time at which the final vent may be going on."""
        return self._latest[-1] + self._limits.program_slack_s

    def see(self, segment: int, time_s: float) -> str | None:
        """Take the segment that a sample of `time_s` names; say what is wrong with it, if it is.

        Nothing is remembered of a sample with which something is wrong.
        """
        count, slack = len(self._segments), self._limits.program_slack_s
        if segment > count:
            return f"segment {segment}, past the end: the program has {count}"
        if segment < self.segment:
            return f"back in segment {segment} after segment {self.segment}"
        if segment > self.segment:
            begin_s = self._earliest[segment]
            if time_s < begin_s - slack:
                return (
                    f"ahead of the program: {self._name(segment)} at {time_s:.2f} s; it begins at "
                    f"{begin_s:.2f} s"
                )
            self._enter(segment, time_s)
        end_s = self._latest[segment + 1]
        if time_s > end_s + slack:
            return (
                f"behind the program: still {self._name(segment)} at {time_s:.2f} s; it ends by "
                f"{end_s:.2f} s"
            )
        self._last_s = time_s
        return None

    def highest_mbar(self, time_s: float) -> float:
        """Highest pressure that the program can show at `time_s`, in mbar.

        A pump may follow a command that goes down `pump_lag_s` late, or with that time constant; a
        valve that opens has `vent_time_s` besides, and nothing is left then.
        """
        index, lag_s = self.segment, self._limits.pump_lag_s
        now = self._present(index, time_s)
        if self._is_open(index):
            first = index
            while first > 0 and self._is_open(first - 1):
                first -= 1
            if time_s - self._since[first] > self._limits.vent_time_s:
                return now
        highest = now
        for before in range(index - 1, -1, -1):
            late_s = time_s - self._since[before + 1] - lag_s
            if late_s > _FORGOTTEN * lag_s:
                break
            fallen = math.exp(-max(0.0, late_s) / lag_s)
            highest = max(highest, now + (self._top(before) - now) * fallen)
        return highest

    # ---- inside ------------------------------------------------------------

    def _lay_out(self, begin: int) -> None:
        """Set the begins of all segments behind `begin` from its own."""
        for index in range(begin, len(self._segments) + 1):
            shortest = longest = 0.0
            kind = self._kind(index)
            if kind is SegmentKind.RELEASE:
                longest = self._limits.release_s
            elif kind is SegmentKind.RAMP:
                segment = self._segments[index]
                way = abs(segment.target_mbar - self._from(index))
                shortest = longest = way / segment.rate_mbar_per_s
            else:
                shortest = longest = self._segments[index].duration_s
            self._earliest[index + 1] = self._earliest[index] + shortest
            self._latest[index + 1] = self._latest[index] + longest

    def _enter(self, segment: int, time_s: float) -> None:
        passed = range(max(self.segment, 0), segment)
        self._since += [time_s] * (segment - self.segment)
        self._after = self._last_s
        releases = [index for index in passed if self._kind(index) is SegmentKind.RELEASE]
        if releases:
            # It ended after the last sample that did not show its end, and before this one
            begin = releases[-1] + 1
            latest = min(self._latest[begin], time_s)
            self._earliest[begin] = min(max(self._earliest[begin], self._last_s), latest)
            self._latest[begin] = latest
            self._lay_out(begin)

    def _kind(self, index: int) -> SegmentKind:
        return self._segments[index].kind if index < len(self._segments) else SegmentKind.RELEASE

    def _is_open(self, index: int) -> bool:
        return self._kind(index) in _OPEN_VALVE

    def _from(self, index: int) -> float:
        return self._targets[index - 1] if index > 0 else 0.0

    def _present(self, index: int, time_s: float) -> float:
        """Highest that a segment can command by now: where its ramp is."""
        if index < 0 or self._is_open(index):
            return 0.0
        segment, target, before = self._segments[index], self._targets[index], self._from(index)
        if segment.kind is not SegmentKind.RAMP:
            return target
        if target > before:
            # It began after the last sample of the segment before it, and not before its time
            begin_s = max(self._after, self._earliest[index] - self._limits.program_slack_s)
            return min(target, before + segment.rate_mbar_per_s * (time_s - begin_s))
        late_s = max(0.0, time_s - self._since[index] - self._limits.pump_lag_s)
        return max(target, before - segment.rate_mbar_per_s * late_s)

    def _top(self, index: int) -> float:
        """Pressure that a segment which is over can have left behind."""
        if self._is_open(index):
            return 0.0
        target, segment = self._targets[index], self._segments[index]
        if segment.kind is not SegmentKind.RAMP:
            return target
        lag_mbar = segment.rate_mbar_per_s * self._limits.pump_lag_s
        return max(target, min(self._from(index), target + lag_mbar))

    def _name(self, index: int) -> str:
        if index == len(self._segments):
            return "the final vent"
        return f"segment {index} ({self._segments[index].kind})"
