"""What a running program allows at a moment: its segment, and the highest pressure. Pure.

Time is the instrument's, in s since Start; the watchdog holds that clock against the host's own.
Everything but a release lasts as long as the program says. A release ends when the instrument
measures that the pressure has fallen, so that what follows is counted from where its end was seen.
So does a rise until a height is reached; what follows begins at what it can have got to,
of which the least and the most are known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers.events import Segment, SegmentKind
from drivers.limits import Limits, longest_way_mbar

_OPEN_ENDED = frozenset({SegmentKind.RELEASE, SegmentKind.UNTIL})  # by what is measured
_OPEN_VALVE = frozenset({SegmentKind.RELEASE, SegmentKind.REST})
_FORGOTTEN = 12.0  # time constants after which nothing is left of 500 mbar
_QUICK = 1 / 6  # of the lag: the time constant of a pump that is late by all of it


def targets(
    segments: Sequence[Segment], begin: float = 0.0, *, least: bool = False
) -> tuple[float, ...]:
    """Most (or least) command at the end of each segment, in mbar, from a pressure on.

    They differ behind a rise that ends at a height.
    """
    found = []
    target = begin
    for segment in segments:
        if segment.kind is SegmentKind.RAMP or (segment.kind is SegmentKind.UNTIL and not least):
            target = segment.target_mbar
        elif segment.kind in _OPEN_VALVE:
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
        self._targets = list(targets(segments))
        self._least = list(targets(segments, least=True))
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

    def least_mbar(self, segment: int) -> float:
        """Least command at the end of a segment, as far as is known by now; of -1: 0."""
        return self._least[segment] if segment >= 0 else 0.0

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

        A pump may follow a command that goes down `pump_lag_s` late, or with that time constant,
        but not both; so may a valve that opens, and nothing is left after `vent_time_s`.
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
            # Late, or slow: one that does nothing for so long and is slow then has a stuck valve
            late = math.exp(-max(0.0, late_s) / (lag_s * _QUICK))
            fallen = max(late, math.exp(-(late_s + lag_s) / lag_s))
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
            elif kind is SegmentKind.UNTIL:
                segment = self._segments[index]
                way = segment.target_mbar - self.least_mbar(index - 1)
                longest = way / segment.rate_mbar_per_s
            elif kind is SegmentKind.RAMP:
                segment = self._segments[index]
                least, most = self.least_mbar(index - 1), self._from(index)
                longest = longest_way_mbar(segment, least, most) / segment.rate_mbar_per_s
                near = min(max(segment.target_mbar, least), most)
                shortest = abs(segment.target_mbar - near) / segment.rate_mbar_per_s
            else:
                shortest = longest = self._segments[index].duration_s
            self._earliest[index + 1] = self._earliest[index] + shortest
            self._latest[index + 1] = self._latest[index] + longest

    def _enter(self, segment: int, time_s: float) -> None:
        passed = range(max(self.segment, 0), segment)
        for index in passed:
            if self._kind(index) is SegmentKind.UNTIL:
                self._reach(index, time_s)
        self._since += [time_s] * (segment - self.segment)
        self._after = self._last_s
        open_ended = [index for index in passed if self._kind(index) in _OPEN_ENDED]
        if open_ended:
            # It ended after the last sample that did not show its end, and before this one
            begin = open_ended[-1] + 1
            latest = min(self._latest[begin], time_s)
            self._earliest[begin] = min(max(self._earliest[begin], self._last_s), latest)
            self._latest[begin] = latest
            self._lay_out(begin)

    def _reach(self, index: int, time_s: float) -> None:
        """Note what a rise can have got to that was over by `time_s`."""
        segment, slack = self._segments[index], self._limits.program_slack_s
        before, rate = self._from(index), segment.rate_mbar_per_s
        here = index == self.segment
        earliest_s = max(self._after if here else 0.0, self._earliest[index] - slack)
        most = min(segment.target_mbar, before + rate * (time_s - earliest_s))
        seen_s = self._last_s - self._latest[index] - slack if here else 0.0
        least = min(most, self.least_mbar(index - 1) + rate * max(0.0, seen_s))
        behind = self._segments[index + 1 :]
        self._targets[index:] = [most, *targets(behind, most)]
        self._least[index:] = [least, *targets(behind, least, least=True)]

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
        if segment.kind is SegmentKind.HOLD:
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
