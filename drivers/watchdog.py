"""The host's safety checks: pure, with the time passed in.

A check answers with events: HostVented asks for a vent and says why; VentConfirmed and Alarm report
what became of it. Host time is any clock in seconds that never goes back.
"""

from __future__ import annotations

import math

from drivers.dose import Dose, DoseMeter, program_dose
from drivers.envelope import Envelope, targets
from drivers.events import (
    NO_NUMBERS,
    PROGRAM_DONE,
    PROGRAM_END,
    Alarm,
    Arm,
    Command,
    Damaged,
    Event,
    Hello,
    HostVented,
    InstrumentFault,
    InstrumentState,
    Load,
    Loaded,
    Pace,
    Refused,
    Sample,
    Segment,
    SegmentKind,
    Start,
    State,
    VentConfirmed,
)
from drivers.limits import DEFAULT_LIMITS, MIN_PAUSE_S, Limits

SafetyEvent = HostVented | VentConfirmed | Alarm

_PULLING = frozenset({InstrumentState.ARMED, InstrumentState.RUNNING})
_RISES = frozenset({SegmentKind.RAMP, SegmentKind.UNTIL})
_OPENS_S = 0.1  # beyond what a link may keep back, before a vent has to show
_BEGUN = 0.75  # part of the pressure that a vent under way is below by then
_UNSEEN_S = 0.1  # what is shorter is a dip, and what comes between two samples is not seen
_ASKED_BY: dict[InstrumentState, type[Command]] = {
    InstrumentState.ARMED: Arm,
    InstrumentState.RUNNING: Start,
}


class Watchdog:
    """Judges every event, and the silence between them.

    What the program allows is what the host asked for (`commanded`), and not what the instrument
    says that it will do; without a word of the host, it is what was read back.
    """

    def __init__(self, limits: Limits = DEFAULT_LIMITS) -> None:
        self._limits = limits
        self._alarm: str | None = None
        self._vent_since: float | None = None  # a vent is on its way and not confirmed
        self._host_vented = False  # that vent was ordered by the host
        self._unseen = False  # the link was lost under suction, and nobody saw it fall since
        self._confirmed: tuple[float, float] | None = None  # last vent: since when, and when seen
        self._back = False  # suction was seen again since then, with no run begun
        self._risen_since: float | None = None  # since when suction is back, more or less
        self._seen_mbar = self._vent_mbar = 0.0  # last reading, and the last before the vent
        self._seen_at = 0.0
        self._dose = DoseMeter()
        self._forget()

    def _forget(self) -> None:
        """Know nothing of state and program."""
        self._state: InstrumentState | None = None
        self._told = False  # the host says what it commands
        self._asked: dict[type[Command], float] = {}  # since when Arm or Start may take effect
        self._hello: Hello | None = None
        self._pace = 1.0  # s of the instrument in one of the host; never another if it is real
        self._segments: tuple[Segment, ...] = ()
        self._max_suction_s = self._limits.max_suction_s
        self._stale_s = self._limits.stale_s
        self._begin_run(0.0)

    def _begin_run(self, now: float) -> None:
        self._envelope = Envelope(self._segments, self._limits)
        if not self._told or Start in self._asked:  # else it is no new beginning
            self._confirmed = None
        self._begun = self._asked.get(Start, now - self._limits.clock_s)  # not before
        self._last_sample = now
        self._unread = ""  # why what came since then is no sample
        self._sampled_s = 0.0  # when the last sample was taken, by the instrument's clock
        self._sequence = -1  # of the last sample
        self._offset_s = now  # least that the host's clock was ahead of it
        self._step_s = 0.0  # between the last two samples; 0 where some are missing
        self._ended = False  # by itself, as programmed
        self._suction_s = 0.0  # since the last pause
        self._pulls = False  # at the last sample
        self._peak_mbar = 0.0  # since the last pause
        self._low_since: float | None = None  # in a pause, by the instrument's clock
        self._segment_since = 0.0
        self._short_since: float | None = None
        self._high_since: float | None = None  # above the height of a rise
        self._frozen: _Frozen | None = None
        self._still: Sample | None = None  # the first with this pressure, in this segment

    @property
    def alarm(self) -> str | None:
        """Text of the latched alarm, or None."""
        return self._alarm

    @property
    def venting(self) -> bool:
        """Whether a vent is on its way and not confirmed yet."""
        return self._vent_since is not None

    @property
    def at_rest(self) -> bool:
        """Whether no vent is on its way, and no suction was seen since the last one."""
        return not self.venting and self._risen_since is None

    @property
    def ordered(self) -> bool:
        """Whether that vent was ordered by the host, which then has to insist."""
        return self.venting and self._host_vented

    @property
    def dose(self) -> Dose:
        """What the site has had so far."""
        return self._dose.total

    def carry_dose(self, dose: Dose) -> None:
        """Go on from what the site has had before."""
        self._dose = DoseMeter(dose)

    def refusal(self, command: Command) -> str | None:
        """Say why `command` must not be sent; None where the site can bear its program."""
        segments = command.segments if isinstance(command, Load) else self._segments
        needs, had = program_dose(segments).suction_mbar_s, self.dose.suction_mbar_s
        limit = self._limits.max_dose_mbar_s
        if had + needs <= limit:
            return None
        return (
            f"the program needs a dose of {needs:.6g} mbar·s and the site has had {had:.6g} "
            f"mbar·s: together more than the {limit:.6g} mbar·s allowed in one visit"
        )

    def commanded(self, command: Command, now: float) -> None:
        """Note that the host sends this, at host time `now` (s)."""
        self._told = True
        match command:
            case Load():
                self._program(command)
            case Arm() | Start():
                self._asked[type(command)] = now
            case _:
                pass

    def acknowledge(self) -> None:
        """Unlatch the alarm."""
        self._alarm = None

    def vent_ordered(self, now: float) -> None:
        """Note that the host sent Vent, at host time `now` (s)."""
        self._host_vented = True
        self._ended = False
        self._asked.clear()
        self._expect_fall(now)

    def _expect_fall(self, now: float) -> None:
        if self._vent_since is None:
            self._vent_since = self._unbroken_since(now)
            self._vent_mbar = self._seen_mbar

    def _unbroken_since(self, now: float) -> float:
        """Since when the pressure should have fallen: a vent in words only is no new beginning.

        Where the pressure stayed down, the last vent was real, and this one has its own time.
        """
        if self._confirmed is None or not self._back:
            return now
        since, seen = self._confirmed
        return now if now - seen > self._limits.vent_time_s else since

    def _see(self, pressure_mbar: float, now: float) -> None:
        """Note whether there is suction, and since when, outside a run."""
        self._seen_mbar, self._seen_at = pressure_mbar, now
        if pressure_mbar < self._limits.vent_pressure_mbar:
            if pressure_mbar < self._limits.vent_pressure_mbar / 2:  # else it may swing
                self._risen_since = None
            return
        self._back = True
        if self._risen_since is None:
            self._risen_since = now
        if self._vent_since is not None:  # so the vent before it was one in words only
            self._vent_since = self._unbroken_since(self._vent_since)

    def link_lost(self) -> list[SafetyEvent]:
        """Judge the loss of the link: where vacuum may be on, nobody can see it go."""
        running = self._state is InstrumentState.RUNNING or Start in self._asked
        if self._vent_since is None and not running:
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
                return self._on_hello(event)
            case Pace() if self._simulated and self._state not in _PULLING:
                self._pace = event.speed
            case Loaded() if not self._told:
                self._program(event)
            case Refused() if self.venting and event.of_vent:
                return self._raise_alarm(f"the instrument refuses to vent ({event.reason})")
            case InstrumentFault():
                return self._order(f"instrument fault {event.code}: {event.text}")
            case State():
                return self._on_state(event, now)
            case Sample():
                return self._on_sample(event, now)
            case Damaged() if event.reason.startswith(NO_NUMBERS):
                self._unread = f": {event.reason}"
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
            if self.ordered and self._alarm is None and self._stays(now):
                return self._raise_alarm(
                    f"the pressure does not fall after a vent: still {self._seen_mbar:g} mbar"
                )
            if not self._in_final_vent():
                return []
        elif self._state is not InstrumentState.RUNNING:
            endless = self._ended and self._state is InstrumentState.VENTING
            return self._over(now) if endless else []
        if now - self._last_sample > self._stale_s:
            return self._order(
                f"stale link: no sample for {1000 * self._stale_s:.0f} ms{self._unread}"
            )
        sampled_s = self._sampled_s / self._pace
        drift_s = self._limits.clock_fraction * sampled_s  # samples of a slow clock only seem old
        age_s = now - (sampled_s + self._offset_s)
        if age_s > self._stale_s + drift_s:
            return self._order(
                f"stale data: the last sample is {1000 * age_s:.0f} ms old{self._unread}"
            )
        # Judged here: of a burst, only the last sample says how late the link is by now
        late_s = self._last_sample - (sampled_s + self._offset_s)
        if late_s > self._limits.clock_s + drift_s:
            return self._order(f"stale data: the samples come {1000 * late_s:.0f} ms late")
        return self._over(now) or self._suction(now - self._last_sample if self._pulls else 0.0)

    def _stays(self, now: float) -> bool:
        """Whether an ordered vent does nothing at all, as far as the newest reading can tell.

        A valve may open late, a link may keep readings back: only then it has to have begun.
        """
        assert self._vent_since is not None
        heard_s = min(self._seen_at, now) - self._vent_since
        still = self._seen_mbar > max(_BEGUN * self._vent_mbar, self._limits.overshoot_mbar)
        return still and heard_s > self._limits.clock_s + _OPENS_S

    def _over(self, now: float) -> list[SafetyEvent]:
        """Judge by the host's clock alone whether the program is over."""
        end_s = self._envelope.end_s / self._pace
        late_s = now - self._offset_s - end_s
        limits = self._limits
        if not self._segments or late_s <= limits.clock_s + limits.clock_fraction * end_s:
            return []
        return self._order(f"still running {late_s:.2f} s after the end of the program")

    def _suction(self, unseen_s: float) -> list[SafetyEvent]:
        suction_s = self._suction_s + unseen_s * self._pace
        longest_s = self._max_suction_s + self._limits.suction_slack_s
        # At another pace a moment that a link may keep samples back is many seconds of suction
        held_back_s = self._limits.clock_s * max(0.0, self._pace - 1.0)
        if suction_s - held_back_s <= longest_s * (1 + self._limits.clock_fraction):
            return []
        return self._order(f"suction for more than {longest_s:g} s without a pause")

    # ---- orders ------------------------------------------------------------

    def _order(self, reason: str) -> list[SafetyEvent]:
        # A vent of the instrument's own is no reason not to order one
        return [] if self.ordered else [HostVented(reason)]

    def _raise_alarm(self, text: str) -> list[SafetyEvent]:
        if self._alarm is not None:
            return []
        self._alarm = f"{text}: lift the probe"
        alarm = Alarm(self._alarm)
        return [alarm] if self._host_vented else [HostVented(text), alarm]

    def _settle(self, pressure_mbar: float, now: float) -> list[SafetyEvent]:
        """Confirm the vent where the pressure says so, once the instrument no longer pulls."""
        if self._vent_since is None or self._state in _PULLING:
            return []
        if not -self._limits.inward_mbar <= pressure_mbar < self._limits.vent_pressure_mbar:
            return []
        self._confirmed, self._back = (self._vent_since, now), False
        self._risen_since = None
        self._vent_since = None
        self._host_vented = self._unseen = False
        return [VentConfirmed(pressure_mbar)]

    def _in_final_vent(self) -> bool:
        """Whether the program's own vent is going on: samples come, as the program allows them."""
        goes_on = self._vent_since is not None or self._state is InstrumentState.VENTING
        return self._ended and goes_on and not self._host_vented

    # ---- events ------------------------------------------------------------

    @property
    def _simulated(self) -> bool:
        return self._hello is not None and self._hello.simulated

    def _on_hello(self, hello: Hello) -> list[SafetyEvent]:
        known, self._hello, self._pace = self._hello, hello, 1.0
        if known not in {None, hello}:
            return self._order("the instrument says that it is another one than before")
        if self._state is InstrumentState.RUNNING:
            return self._order("the instrument said hello in the middle of a run")
        return []

    def _program(self, program: Load | Loaded) -> None:
        self._segments = program.segments
        self._max_suction_s = min(self._limits.max_suction_s, program.max_suction_s)
        intervals_s = self._limits.stale_intervals / program.rate_hz if program.rate_hz > 0 else 0.0
        self._stale_s = max(self._limits.stale_s, intervals_s)

    def _on_state(self, event: State, now: float) -> list[SafetyEvent]:
        before, self._state = self._state, event.state
        orders: list[SafetyEvent] = []
        if event.state is not before:
            if before is not None:  # else it was found like this
                orders = self._unasked(event.state)
            if event.state is InstrumentState.RUNNING:
                self._begin_run(now)
            if (command := _ASKED_BY.get(event.state)) is not None:
                self._asked.pop(command, None)
            fell = before in _PULLING and event.state not in _PULLING
            if fell:
                orders = orders or self._own_vent(event.reason)
                self._asked.clear()
            if fell or event.state in {InstrumentState.VENTING, InstrumentState.FAULT}:
                own = not orders and not self._host_vented
                self._ended = own and before is InstrumentState.RUNNING
                self._expect_fall(now)
        if event.pressure_mbar is None:
            return orders
        self._see(event.pressure_mbar, now)
        return (
            orders
            or self._above_all(event.pressure_mbar)
            or self._settle(event.pressure_mbar, now)
            or self._at_rest(event.pressure_mbar, now)
        )

    def _unasked(self, state: InstrumentState) -> list[SafetyEvent]:
        if state is InstrumentState.FAULT:
            return self._order("the instrument reports a fault")
        command = _ASKED_BY.get(state)
        if command is None or not self._told or command in self._asked:
            return []
        return self._order(f"the instrument is {state} and nobody asked for it")

    def _above_all(self, pressure_mbar: float) -> list[SafetyEvent]:
        """Judge a pressure that comes without a time."""
        most = max(targets(self._segments), default=self._limits.max_pressure_mbar)
        if pressure_mbar <= self._limits.overshoot_above(most):
            return []
        return self._order(
            f"overshoot: {pressure_mbar:g} mbar where at most {most:g} mbar was commanded"
        )

    def _own_vent(self, reason: str) -> list[SafetyEvent]:
        if reason in {PROGRAM_END, PROGRAM_DONE} or self._vent_since is not None:
            return []
        return self._order(f"the instrument vented by itself ({reason})")

    def _on_sample(self, sample: Sample, now: float) -> list[SafetyEvent]:
        self._dose.add(sample)
        passed_s = (now - self._last_sample) * self._pace
        self._last_sample, self._unread = now, ""
        in_order = sample.sequence == self._sequence + 1
        self._step_s = sample.device_time_s - self._sampled_s if in_order else 0.0
        self._sampled_s, self._sequence = sample.device_time_s, sample.sequence
        self._offset_s = min(self._offset_s, now - sample.device_time_s / self._pace)
        pressure = sample.pressure_mbar
        pulls = pressure >= self._limits.vent_pressure_mbar
        self._see(pressure, now)
        if pulls or self._pulls:
            self._suction_s += passed_s
        self._pulls = pulls
        if self._vent_since is not None or self._state is not InstrumentState.RUNNING:
            # A pump that is late may show suction behind a first low reading
            judged = self._beyond(sample) if self._in_final_vent() else []
            return self._settle(pressure, now) or judged or self._at_rest(pressure, now)
        if sample.segment > self._envelope.segment:
            # Where samples are lost, the segment began somewhere between these two
            self._segment_since = sample.device_time_s
        return (
            self._ahead(sample, now)
            or self._beyond(sample)
            or self._shortfall(sample)
            or self._freeze(sample)
            or self._stands_still(sample)
            or self._passed(sample)
            or self._impossible(sample)
            or self._too_much()
        )

    def _ahead(self, sample: Sample, now: float) -> list[SafetyEvent]:
        """Judge whether the instrument's time runs away from the host's."""
        sampled_s = sample.device_time_s / self._pace
        ahead_s = sampled_s - (now - self._begun)
        if ahead_s <= self._limits.clock_s + self._limits.clock_fraction * sampled_s:
            return []
        return self._order(f"the instrument's clock is {ahead_s:.2f} s ahead of the host's")

    def _beyond(self, sample: Sample) -> list[SafetyEvent]:
        """Judge segment and pressure by what the program allows at this moment."""
        if not self._segments:
            command = self._limits.max_pressure_mbar
        else:
            before = self._envelope.segment
            problem = self._envelope.see(sample.segment, sample.device_time_s)
            if problem is not None:
                return self._order(problem)
            self._pause(before, sample)
            command = self._envelope.highest_mbar(sample.device_time_s)
        if sample.pressure_mbar <= self._limits.overshoot_above(command):
            return []
        return self._order(
            f"overshoot: {sample.pressure_mbar:g} mbar where {command:g} mbar was commanded"
        )

    def _pause(self, before: int, sample: Sample) -> None:
        """Count suction anew behind a pause of the program in which the pressure was seen to fall.

        To half is enough, since the lowest pressure comes between two samples, but it has to stay
        there: a dip is no pause. A release ends as soon as it has worked, so that one sample of it
        will do. A pause that can have come and gone between two samples is believed.
        """
        time_s, pressure, index = sample.device_time_s, sample.pressure_mbar, sample.segment
        self._peak_mbar = max(self._peak_mbar, pressure)
        if pressure >= max(self._limits.vent_pressure_mbar, self._peak_mbar / 2):
            low_since = None
        else:
            low_since = time_s if self._low_since is None else self._low_since
        passed = [k for k in range(max(before, 0), index) if _is_pause(self._segments[k])]
        if passed:
            since = self._low_since if low_since is None else low_since
            stayed = since is not None and (
                time_s - since >= _UNSEEN_S
                or any(self._segments[k].kind is SegmentKind.RELEASE for k in passed)
            )
            unseen = before not in passed and self._step_s >= _UNSEEN_S
            if stayed or unseen:
                self._suction_s, self._peak_mbar = 0.0, pressure
        inside = index < len(self._segments) and _is_pause(self._segments[index])
        self._low_since = low_since if inside else None

    def _too_much(self) -> list[SafetyEvent]:
        limit, had = self._limits.max_dose_mbar_s, self.dose.suction_mbar_s
        if had > limit:
            return self._order(
                f"a dose of {had:.6g} mbar·s: more than the {limit:.6g} mbar·s allowed in one visit"
            )
        return self._suction(0.0)

    def _at_rest(self, pressure_mbar: float, now: float) -> list[SafetyEvent]:
        """Judge suction where no program pulls: a vent in words has to be one."""
        limits, state = self._limits, self._state
        if state in {None, InstrumentState.RUNNING}:
            return []
        in_vent = state is InstrumentState.VENTING and self._in_final_vent()
        if in_vent and self._vent_since is not None:
            return []
        if pressure_mbar > limits.overshoot_mbar and not in_vent:
            return self._order(f"suction of {pressure_mbar:g} mbar while {state}")
        if self._risen_since is None or now - self._risen_since <= limits.vent_time_s:
            return []
        return self._order(
            f"suction around {limits.vent_pressure_mbar:g} mbar or more for "
            f"{limits.vent_time_s:g} s while {state}"
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
        segment, target = self._segments[index], self._envelope.least_mbar(index)
        before = self._envelope.least_mbar(index - 1)
        if segment.kind is SegmentKind.UNTIL:
            target = segment.target_mbar  # it still rises: the height is not reached
        if segment.kind not in _RISES or target <= before:
            return target
        # The segment began before its first sample: so this is a lower bound
        risen = segment.rate_mbar_per_s * (sample.device_time_s - self._segment_since)
        return min(target, before + risen)

    def _impossible(self, sample: Sample) -> list[SafetyEvent]:
        if sample.pressure_mbar < -self._limits.inward_mbar:
            return self._order(f"impossible pressure: {sample.pressure_mbar:g} mbar")
        low, high = -self._limits.inward_mm, self._hello.aperture_mm if self._hello else None
        if high is None or low <= sample.deflection_mm <= high:
            return []
        return self._order(
            f"impossible deflection: {sample.deflection_mm:g} mm in an opening of {high:g} mm"
        )

    def _passed(self, sample: Sample) -> list[SafetyEvent]:
        """Judge whether a rise goes on although its height is reached."""
        index, limits = sample.segment, self._limits
        segment = self._segments[index] if 0 <= index < len(self._segments) else None
        height = segment.height_mm if segment and segment.kind is SegmentKind.UNTIL else math.inf
        if sample.deflection_mm <= height + max(limits.height_mm, limits.height_fraction * height):
            self._high_since = None
            return []
        if self._high_since is None:
            self._high_since = sample.device_time_s
        if sample.device_time_s - self._high_since < limits.program_slack_s:
            return []
        return self._order(
            f"passed: {sample.deflection_mm:g} mm, and still rising until {height:g} mm"
        )

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

    def _stands_still(self, sample: Sample) -> list[SafetyEvent]:
        """Judge whether the pressure, to the last digit, stays what it was on a ramp."""
        index, still = sample.segment, self._still
        segment = self._segments[index] if 0 <= index < len(self._segments) else None
        if (
            segment is None
            or segment.kind not in _RISES
            or sample.pressure_mbar < self._limits.vent_pressure_mbar  # still sealing the skin
            or still is None
            or (still.segment, still.pressure_mbar) != (index, sample.pressure_mbar)
        ):
            self._still = sample
            return []
        stood_s = sample.device_time_s - still.device_time_s
        way = abs(segment.target_mbar - self._envelope.least_mbar(index - 1))
        moved = min(way, segment.rate_mbar_per_s * stood_s)
        if stood_s < self._limits.frozen_s or moved < self._limits.frozen_pressure_mbar:
            return []
        return self._order(
            f"frozen pressure: {sample.pressure_mbar:g} mbar for {stood_s:.2f} s of a ramp"
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


def _is_pause(segment: Segment) -> bool:
    if segment.kind is SegmentKind.REST:
        return segment.duration_s >= MIN_PAUSE_S
    return segment.kind is SegmentKind.RELEASE
