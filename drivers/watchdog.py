"""The host's safety checks: pure, with the time passed in.

A check answers with events: HostVented asks for a vent and says why; VentConfirmed and Alarm report
what became of it. Host time is any clock in seconds that never goes back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate

from drivers.events import (
    PROGRAM_DONE,
    PROGRAM_END,
    Alarm,
    Event,
    Hello,
    HostVented,
    InstrumentFault,
    InstrumentState,
    Loaded,
    Sample,
    Segment,
    SegmentKind,
    State,
    VentConfirmed,
)
from drivers.limits import DEFAULT_LIMITS, Limits

SafetyEvent = HostVented | VentConfirmed | Alarm

_RAMP_GRACE_S = 0.5  # pressure may lag this long behind a command that went down
_SUCTION_SLACK_S = 1.0  # host and instrument count suction time by different clocks
_SLOW_CLOCK = 0.02  # part by which the instrument's clock may be slow; its samples only seem old
_PULLING = frozenset({InstrumentState.ARMED, InstrumentState.RUNNING})
_AT_REST = frozenset({InstrumentState.IDLE, InstrumentState.LOADED, InstrumentState.ARMED})


class Watchdog:
    """Judges every event, and the silence between them."""

    def __init__(self, limits: Limits = DEFAULT_LIMITS) -> None:
        self._limits = limits
        self._alarm: str | None = None
        self._vent_since: float | None = None  # a vent is on its way and not confirmed
        self._host_vented = False  # that vent was ordered by the host
        self._unseen = False  # the link was lost under suction, and nobody saw it fall since
        self._aperture_mm: float | None = None
        self._forget()

    def _forget(self) -> None:
        """Know nothing of state and program."""
        self._state: InstrumentState | None = None
        self._segments: tuple[Segment, ...] = ()
        self._targets: tuple[float, ...] = ()
        self._ceilings: tuple[float, ...] = ()
        self._grace_s: tuple[float, ...] = ()
        self._pauses: tuple[int, ...] = ()
        self._stale_s = self._limits.stale_s
        self._begin_run(0.0)

    def _begin_run(self, now: float) -> None:
        self._last_sample = now
        self._sampled_s = 0.0  # when the last sample was taken, by the instrument's clock
        self._offset_s = math.inf  # least that the host's clock was ahead of it
        self._suction_since: float | None = None
        self._segment = -1
        self._segment_since = 0.0
        self._segment_after = 0.0
        self._short_since: float | None = None
        self._frozen: _Frozen | None = None

    @property
    def alarm(self) -> str | None:
        """Text of the latched alarm, or None."""
        return self._alarm

    @property
    def venting(self) -> bool:
        """Whether a vent is on its way and not confirmed yet."""
        return self._vent_since is not None

    @property
    def ordered(self) -> bool:
        """Whether that vent was ordered by the host, which then has to insist."""
        return self.venting and self._host_vented

    def acknowledge(self) -> None:
        """Unlatch the alarm."""
        self._alarm = None

    def vent_ordered(self, now: float) -> None:
        """Note that the host sent Vent, at host time `now` (s)."""
        self._host_vented = True
        if self._vent_since is None:
            self._vent_since = now

    def link_lost(self) -> list[SafetyEvent]:
        """Judge the loss of the link: where vacuum may be on, nobody can see it go."""
        if self._vent_since is None and self._state is not InstrumentState.RUNNING:
            return []
        self._unseen = True
        return self._raise_alarm("the link is lost and the vacuum cannot be checked")

    def reconnected(self, now: float) -> None:
        """Begin again with an instrument that was out of reach until host time `now` (s).

        A latched alarm stays, and a vent that nobody saw is still to be confirmed.
        """
        self._forget()
        self._host_vented = False
        self._vent_since = now if self._unseen else None

    def on_event(self, event: Event, now: float) -> list[SafetyEvent]:
        """Judge what came at host time `now` (s)."""
        match event:
            case Hello():
                self._aperture_mm = event.aperture_mm
            case Loaded():
                self._program(event)
            case InstrumentFault():
                return self._order(f"instrument fault {event.code}: {event.text}")
            case State():
                return self._on_state(event, now)
            case Sample():
                return self._on_sample(event, now)
            case _:
                pass
        return []

    def check(self, now: float) -> list[SafetyEvent]:
        """Judge the silence; to be called often."""
        if self._vent_since is not None:
            late = now - self._vent_since > self._limits.vent_time_s
            if late and self._alarm is None:
                return self._raise_alarm(
                    f"the pressure did not fall below {self._limits.vent_pressure_mbar:g} mbar "
                    f"within {self._limits.vent_time_s:g} s of a vent"
                )
            return []
        if self._state is not InstrumentState.RUNNING:
            return []
        if now - self._last_sample > self._stale_s:
            return self._order(f"stale link: no sample for {1000 * self._stale_s:.0f} ms")
        age = now - (self._sampled_s + self._offset_s)
        if age > self._stale_s + _SLOW_CLOCK * self._sampled_s:
            return self._order(f"stale data: the last sample is {1000 * age:.0f} ms old")
        longest = self._limits.max_suction_s + _SUCTION_SLACK_S
        if self._suction_since is not None and now - self._suction_since > longest:
            return self._order(f"suction for more than {longest:g} s without a pause")
        return []

    # ---- orders ------------------------------------------------------------

    def _order(self, reason: str) -> list[SafetyEvent]:
        return [] if self._vent_since is not None else [HostVented(reason)]

    def _raise_alarm(self, text: str) -> list[SafetyEvent]:
        if self._alarm is not None:
            return []
        self._alarm = f"{text}: lift the probe"
        alarm = Alarm(self._alarm)
        return [alarm] if self._host_vented else [HostVented(text), alarm]

    def _settle(self, pressure_mbar: float) -> list[SafetyEvent]:
        """Confirm the vent where the pressure says so, once the instrument no longer pulls."""
        if self._vent_since is None or self._state in _PULLING:
            return []
        if pressure_mbar >= self._limits.vent_pressure_mbar:
            return []
        self._vent_since = None
        self._host_vented = self._unseen = False
        return [VentConfirmed(pressure_mbar)]

    # ---- events ------------------------------------------------------------

    def _program(self, loaded: Loaded) -> None:
        self._segments = loaded.segments
        self._targets = _targets(loaded.segments)
        self._ceilings = _ceilings(loaded.segments)
        open_valve = {SegmentKind.RELEASE, SegmentKind.REST}
        self._grace_s = tuple(
            self._limits.vent_time_s if segment.kind in open_valve else _RAMP_GRACE_S
            for segment in loaded.segments
        )
        self._pauses = tuple(
            accumulate(int(segment.kind in open_valve) for segment in loaded.segments)
        )
        intervals_s = self._limits.stale_intervals / loaded.rate_hz if loaded.rate_hz > 0 else 0.0
        self._stale_s = max(self._limits.stale_s, intervals_s)

    def _on_state(self, event: State, now: float) -> list[SafetyEvent]:
        before, self._state = self._state, event.state
        orders: list[SafetyEvent] = []
        if event.state is not before:
            if event.state is InstrumentState.RUNNING:
                self._begin_run(now)
            fell = before in _PULLING and event.state not in _PULLING
            if fell:
                orders = self._own_vent(event.reason)
            if fell or event.state in {InstrumentState.VENTING, InstrumentState.FAULT}:
                self._vent_since = now if self._vent_since is None else self._vent_since
        if event.pressure_mbar is None:
            return orders
        return orders or self._settle(event.pressure_mbar) or self._at_rest(event.pressure_mbar)

    def _own_vent(self, reason: str) -> list[SafetyEvent]:
        if reason in {PROGRAM_END, PROGRAM_DONE}:
            return []
        return self._order(f"the instrument vented by itself ({reason})")

    def _on_sample(self, sample: Sample, now: float) -> list[SafetyEvent]:
        self._last_sample = now
        before_s, self._sampled_s = self._sampled_s, sample.device_time_s
        self._offset_s = min(self._offset_s, now - sample.device_time_s)
        pressure = sample.pressure_mbar
        index = sample.segment
        if index != self._segment:
            # A pause may be over between two samples
            if self._pauses_before(index) != self._pauses_before(self._segment):
                self._suction_since = None
            self._segment, self._segment_since = index, sample.device_time_s
            self._segment_after = before_s
        if pressure < self._limits.vent_pressure_mbar:
            self._suction_since = None
        elif self._suction_since is None:
            self._suction_since = now
        if self._vent_since is not None:
            return self._settle(pressure)
        if self._state is not InstrumentState.RUNNING:
            return self._at_rest(pressure)
        return (
            self._overshoot(sample)
            or self._shortfall(sample)
            or self._freeze(sample)
            or self._impossible(sample)
        )

    def _at_rest(self, pressure_mbar: float) -> list[SafetyEvent]:
        if self._state not in _AT_REST or pressure_mbar <= self._limits.overshoot_mbar:
            return []
        return self._order(f"suction of {pressure_mbar:g} mbar while {self._state}")

    def _overshoot(self, sample: Sample) -> list[SafetyEvent]:
        command = self._command(sample)
        limit = self._limits.overshoot_above(command)
        if sample.pressure_mbar <= limit:
            return []
        return self._order(
            f"overshoot: {sample.pressure_mbar:g} mbar where {command:g} mbar was commanded"
        )

    def _shortfall(self, sample: Sample) -> list[SafetyEvent]:
        command = self._least_command(sample)
        if sample.pressure_mbar >= self._limits.shortfall_below(command):
            self._short_since = None
            return []
        if self._short_since is None:
            self._short_since = sample.device_time_s
        if sample.device_time_s - self._short_since < self._limits.shortfall_s:
            return []
        return self._order(
            f"the suction does not follow: {sample.pressure_mbar:g} mbar where {command:g} mbar "
            "was commanded (a leak, or no skin under the probe)"
        )

    def _least_command(self, sample: Sample) -> float:
        """Lowest command that this sample may show, in mbar."""
        index = sample.segment
        if not 0 <= index < len(self._segments):
            return 0.0
        segment, target = self._segments[index], self._targets[index]
        before = self._targets[index - 1] if index else 0.0
        if segment.kind is not SegmentKind.RAMP or target <= before:
            return target
        # The segment began before its first sample: so this is a lower bound
        risen = segment.rate_mbar_per_s * (sample.device_time_s - self._segment_since)
        return min(target, before + risen)

    def _impossible(self, sample: Sample) -> list[SafetyEvent]:
        low, high = -self._limits.inward_mm, self._aperture_mm
        if high is None or low <= sample.deflection_mm <= high:
            return []
        return self._order(
            f"impossible deflection: {sample.deflection_mm:g} mm in an opening of {high:g} mm"
        )

    def _command(self, sample: Sample) -> float:
        """Highest command that this sample may still show, in mbar."""
        index = sample.segment
        if index >= len(self._ceilings):  # final vent, or no program seen: only the maximum counts
            return max(self._ceilings, default=self._limits.max_pressure_mbar)
        within_s = sample.device_time_s - self._segment_since
        command = self._present_command(index, sample.device_time_s)
        # Segments that are over within the grace still show in the pressure, which lags behind
        if within_s <= self._grace_s[index]:
            command = max(command, *self._ceilings[:index], 0.0)
        return command

    def _present_command(self, index: int, time_s: float) -> float:
        """Highest that a segment can command at this time: where its ramp is, by now."""
        segment, target = self._segments[index], self._targets[index]
        before = self._targets[index - 1] if index else 0.0
        if segment.kind is not SegmentKind.RAMP:
            return target
        # It began after the last sample of the segment before, and not after its own first one
        if target > before:
            longest_s = time_s - self._segment_after
            return min(target, before + segment.rate_mbar_per_s * longest_s)
        shortest_s = max(0.0, time_s - self._segment_since - _RAMP_GRACE_S)
        return max(target, before - segment.rate_mbar_per_s * shortest_s)

    def _pauses_before(self, index: int) -> int:
        return self._pauses[index] if 0 <= index < len(self._pauses) else 0

    def _freeze(self, sample: Sample) -> list[SafetyEvent]:
        frozen = self._frozen
        if frozen is None or frozen.deflection_mm != sample.deflection_mm:
            self._frozen = _Frozen(sample)
            return []
        frozen.add(sample)
        if (
            sample.device_time_s - frozen.since_s < self._limits.frozen_s
            or frozen.high_mbar - frozen.low_mbar < self._limits.frozen_pressure_mbar
        ):
            return []
        return self._order(
            f"frozen deflection: {sample.deflection_mm:g} mm all the while the pressure went from "
            f"{frozen.low_mbar:g} to {frozen.high_mbar:g} mbar"
        )


class _Frozen:
    """A stretch of samples with one and the same deflection."""

    __slots__ = ("deflection_mm", "high_mbar", "low_mbar", "since_s")

    def __init__(self, first: Sample) -> None:
        self.deflection_mm = first.deflection_mm
        self.since_s = first.device_time_s
        self.low_mbar = self.high_mbar = first.pressure_mbar

    def add(self, sample: Sample) -> None:
        self.low_mbar = min(self.low_mbar, sample.pressure_mbar)
        self.high_mbar = max(self.high_mbar, sample.pressure_mbar)


def _targets(segments: Sequence[Segment]) -> tuple[float, ...]:
    """Command at the end of each segment, in mbar."""
    targets = []
    target = 0.0
    for segment in segments:
        if segment.kind is SegmentKind.RAMP:
            target = segment.target_mbar
        elif segment.kind is not SegmentKind.HOLD:
            target = 0.0
        targets.append(target)
    return tuple(targets)


def _ceilings(segments: Sequence[Segment]) -> tuple[float, ...]:
    """Highest command within each segment, in mbar."""
    targets = _targets(segments)
    return tuple(
        max(before, target) if segment.kind is SegmentKind.RAMP else target
        for segment, before, target in zip(segments, (0.0, *targets), targets, strict=False)
    )
