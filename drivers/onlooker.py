"""The host's watch over an instrument that it does not control: it sees, and says so in words.

In the place of `Watchdog`, for instruments that only stream. Where there is a vent command it is
sent as well; nobody knows whether it works but by the pressure.
"""

from __future__ import annotations

from dataclasses import replace

from drivers.capabilities import CANNOT_VENT
from drivers.dose import Dose, DoseMeter
from drivers.events import (
    NO_NUMBERS,
    Alarm,
    Command,
    Damaged,
    Event,
    HostVented,
    InstrumentFault,
    InstrumentState,
    Sample,
    State,
    VentConfirmed,
)
from drivers.limits import DEFAULT_LIMITS, Limits
from drivers.watchdog import SafetyEvent

_AWAITED = frozenset({InstrumentState.ARMED, InstrumentState.RUNNING})


class Onlooker:
    """Judges every reading, and the silence between them; host time is passed in, in s.

    can_vent: there is a command for it. silent_s: for how long nothing may come under suction.
    """

    def __init__(
        self, limits: Limits = DEFAULT_LIMITS, *, can_vent: bool = False, silent_s: float = 1.0
    ) -> None:
        self._limits = limits
        self._can_vent = can_vent
        self._silent_s = silent_s
        self._alarm: str | None = None
        self._said: set[str] = set()  # since the suction began
        self._dose = DoseMeter()  # by the instrument's clock, whose rate may be wrong
        self._by_host = DoseMeter()
        self._pulls = False  # at the last reading
        self._read_at = 0.0  # host time of it
        self._step_s = 0.0
        self._awaited = False  # a curve is waited for, or under way
        self._unread = 0  # readings that are no numbers, one after the other
        self._unread_since = 0.0  # host time of the first one
        self._why_unread = ""
        self._suction_s = 0.0  # without a pause
        self._vent_since: float | None = None
        self._unseen = False  # the link was lost under suction, and nobody saw it fall since

    @property
    def alarm(self) -> str | None:
        """Text of the latched alarm, or None."""
        return self._alarm

    @property
    def venting(self) -> bool:
        """Whether a vent was sent and the pressure is not gone yet."""
        return self._vent_since is not None

    @property
    def ordered(self) -> bool:
        """Whether the host has to insist on that vent."""
        return self.venting

    @property
    def dose(self) -> Dose:
        """What the site has had so far, by the clock that says more."""
        return max(self._dose.total, self._by_host.total, key=lambda dose: dose.suction_mbar_s)

    def carry_dose(self, dose: Dose) -> None:
        """Go on from what the site has had before."""
        self._dose, self._by_host = DoseMeter(dose), DoseMeter(dose)

    def refusal(self, command: Command) -> str | None:
        """Nothing can be commanded: there is nothing to refuse."""
        del command
        return None

    def commanded(self, command: Command, now: float) -> None:
        """Nothing can be commanded."""

    def acknowledge(self) -> None:
        """Unlatch the alarm; it comes back with the next reading that calls for it."""
        self._alarm = None
        self._said.clear()

    def vent_ordered(self, now: float) -> None:
        """Note that the host sent a vent, at host time `now` (s)."""
        if self._can_vent and self._pulls and self._vent_since is None:
            self._vent_since = now

    def link_lost(self) -> list[SafetyEvent]:
        """Judge the loss of the link: where vacuum is on, nobody can see it go."""
        if not self._pulls:
            return []
        self._vent_since, self._unseen = None, True
        return self._raise("link", "the link is lost under suction, and the vacuum cannot be seen")

    def reconnected(self, now: float) -> None:
        """Begin again with an instrument that was out of reach; a latched alarm stays."""
        self._pulls, self._read_at, self._vent_since = False, now, None
        self._awaited, self._unread = False, 0
        self._said.clear()

    def on_event(self, event: Event, now: float) -> list[SafetyEvent]:
        """Judge what came at host time `now` (s)."""
        if isinstance(event, InstrumentFault):
            return self._raise("fault", f"instrument fault {event.code}: {event.text}")
        if isinstance(event, State):
            self._awaited, self._unread = event.state in _AWAITED, 0
        elif (
            isinstance(event, Damaged)
            and event.reason.startswith(NO_NUMBERS)
            and (self._awaited or self._pulls)  # before, an instrument may have nothing to say
        ):
            self._unread_since = self._unread_since if self._unread else now
            self._unread += 1
            self._why_unread = event.reason
        return self._on_sample(event, now) if isinstance(event, Sample) else []

    def check(self, now: float) -> list[SafetyEvent]:
        """Judge the silence; to be called often."""
        if self._unread > self._limits.stale_intervals:  # they come, so that none is kept back
            unread_s = now - self._unread_since
            if unread_s > self._limits.stale_s:
                return self._raise(
                    "numbers", f"no sample for {1000 * unread_s:.0f} ms: {self._why_unread}"
                )
        silent_s = max(self._silent_s, 3 * self._step_s)
        if not self._pulls or now - self._read_at <= silent_s:
            return []
        return self._raise(
            "silent", f"no reading for {silent_s:g} s under suction: nobody can see the pressure"
        )

    def _on_sample(self, sample: Sample, now: float) -> list[SafetyEvent]:
        limits, pressure = self._limits, sample.pressure_mbar
        came_s = now if sample.host_time_s is None else sample.host_time_s
        self._dose.add(replace(sample, host_time_s=None))
        # As if all were one run: what nobody saw between two is suction, too
        self._by_host.add(replace(sample, device_time_s=came_s, host_time_s=None))
        self._unread = 0
        passed_s, self._read_at = now - self._read_at, now
        pulls = pressure >= limits.vent_pressure_mbar
        if pulls and self._pulls:
            self._suction_s += passed_s
            self._step_s = passed_s
        self._pulls = pulls
        if not pulls:
            self._suction_s = 0.0
            self._said.clear()
            if self._vent_since is not None or self._unseen:
                self._vent_since, self._unseen = None, False
                return [VentConfirmed(pressure)]
            return []
        if pressure > limits.overshoot_above(limits.max_pressure_mbar):
            return self._raise(
                "pressure",
                f"a suction of {pressure:g} mbar: more than the {limits.max_pressure_mbar:g} mbar "
                "that are allowed here",
            )
        if self._suction_s > limits.max_suction_s + limits.suction_slack_s:
            return self._raise(
                "suction", f"suction for more than {limits.max_suction_s:g} s without a pause"
            )
        had = self.dose.suction_mbar_s
        if had > limits.max_dose_mbar_s:
            return self._raise(
                "dose",
                f"a dose of {had:.6g} mbar·s: more than the {limits.max_dose_mbar_s:.6g} mbar·s "
                "allowed in one visit",
            )
        return []

    def _raise(self, kind: str, text: str) -> list[SafetyEvent]:
        """Raise an alarm, once for each stretch of suction."""
        if kind in self._said:
            return []
        self._said.add(kind)
        orders: list[SafetyEvent] = [HostVented(text)] if self._can_vent else []
        if self._alarm is not None:
            return orders
        ours = "a vent was asked for, and may not work" if self._can_vent else CANNOT_VENT
        self._alarm = f"{text}; {ours}: lift the probe"
        return [*orders, Alarm(self._alarm)]
