"""The rules of a measurement: repeats, rests, lost links, vents, the end. No clock, thread or port.

`Measurement.handle` takes what happened and the time, and returns what is to be done, in order.
The same rules run at the bedside and headless: docs/decisions/0015-one-measurement.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from drivers.events import (
    PROGRAM_DONE,
    PROGRAM_END,
    Alarm,
    Event,
    HostVented,
    InstrumentFault,
    InstrumentState,
    LinkLost,
    LinkRestored,
    State,
    VentConfirmed,
)
from drivers.reconnect import Backoff
from skinlab.acquisition.measurement_messages import (
    Abort,
    Acknowledge,
    AcknowledgeAlarm,
    Arm,
    ArmProbe,
    Awaited,
    Close,
    Continue,
    Failed,
    Gone,
    Outcome,
    Output,
    Over,
    Phase,
    Plan,
    Reconnect,
    Refused,
    RepeatEnded,
    Request,
    Start,
    StartProbe,
    Succeeded,
    Vent,
    VentProbe,
)  # fmt: skip
from skinlab.curves.curve import Setup

_S = InstrumentState
_SETTLED = frozenset({_S.IDLE, _S.LOADED, _S.FAULT})


@dataclass(frozen=True, slots=True)
class Policy:
    """What decides how a measurement goes on. Not tuned by a benchmark: chosen, with the reason."""

    backoff: Backoff = field(default_factory=lambda: Backoff(give_up_s=60.0))
    """Waits before each attempt to get a lost link back, s. The first one is soon, because most
    outages are short; a minute is what somebody needs to find the plug. The probe has vented by
    itself long before."""

    most_outages: int = 3
    """Lost links that one series gets over. More is a cable to be changed, and each one is one
    more loading of the site."""

    vent_patience_s: float = 3.0
    """How long the end waits for the instrument to say that it has vented. Three times the
    driver's own limit, after which it has raised its alarm."""

    quiet_s: float = 0.1
    """How long the stream must be quiet before a series is over: one keep-alive, so that the last
    words of the instrument are in the record."""


_ACTIVE = frozenset(
    {Phase.ARMING, Phase.ARMED, Phase.STARTING, Phase.RUNNING, Phase.SETTLING, Phase.RESTING}
)
_LINKLESS = frozenset({Phase.SEARCHING, Phase.CHECKING})


class Measurement:
    """One series after the other, at one instrument, until it is closed.

    controls: the instrument does what it is told. One that only streams is started by somebody
    there: Start waits for it; nothing vents it, and its readings never fall silent.
    """

    def __init__(self, policy: Policy = Policy(), *, controls: bool = True) -> None:
        self.policy = policy
        self.controls = controls
        self.phase = Phase.READY
        self.wake_at: float | None = None  # when `handle(None)` is due
        self._out: list[Output] = []
        self._awaited: Awaited | None = None  # whose outcome matters
        self._plan: Plan | None = None
        self._started = False  # it was confirmed, so that its repeats start once armed
        self._setup: Setup | None = None  # of the present repeat, or of the next one
        self._left = 0  # repeats, the present one included
        self._open = False  # ArmProbe was given, and RepeatEnded is still to come
        self._ran = False
        self._instrument: InstrumentState | None = None
        self._alarmed = False  # an alarm is latched
        self._last_event_s = 0.0
        self._vented_s = 0.0  # when the pressure was gone, as far as is known
        self._why = ""  # the series is over
        self._patient_till_s = 0.0  # for the vent to be seen
        self._error: Exception | None = None
        self._outages = 0
        self._lost = ""  # why the link is lost
        self._lost_s = 0.0
        self._wait_s = 0.0  # before the next attempt
        self._restored = self._confirmed = self._unseen = False  # since the link was lost

    @property
    def left(self) -> Plan | None:
        """What is still to be measured, as a plan of its own; None: nothing."""
        if self._plan is None or self._setup is None:
            return None
        return replace(self._plan, setup=self._setup, repeats=self._left)

    def handle(self, given: Request | Event | Outcome | None, now: float) -> tuple[Output, ...]:
        """Take a request, an event of the driver or an outcome; None: only time went on.

        now: s, of a clock that never goes back. An outcome comes after all events that were posted
        before it; one of a command that does not matter any more is left alone.
        """
        match given:
            case None:
                pass
            case Arm() | Start() | Vent() | Acknowledge() | Continue() | Abort() | Close():
                self._request(given, now)
            case Succeeded() | Failed():
                self._outcome(given, now)
            case _:
                self._last_event_s = now
                self._event(given, now)
        self._pass_time(now)
        out, self._out = tuple(self._out), []
        return out

    # ---- requests ---------------------------------------------------------------------------

    def _request(self, request: Request, now: float) -> None:
        match request:
            case Arm(plan):
                self._want(plan)
            case Start():
                if self._started or self.phase not in {Phase.ARMING, Phase.ARMED}:
                    self._out.append(Refused("nothing is armed"))
                    return
                self._started = True
                if self.phase is Phase.ARMED:
                    self._start()
            case Vent(reason):
                self._out.append(VentProbe(reason))
                self._give_up(f"vented ({reason})", now)
            case Acknowledge():
                self._alarmed = False
                self._out.append(AcknowledgeAlarm())
            case Continue():
                self._continue(now)
            case Abort(why):
                if self.phase in _ACTIVE - {Phase.RESTING}:
                    self._out.append(VentProbe(why))
                self._give_up(why, now)
            case Close():
                self._close(now)

    def _want(self, plan: Plan) -> None:
        if self.phase not in {Phase.READY, Phase.INTERRUPTED}:
            self._out.append(Refused(f"not now: {self.phase}"))
            return
        if self._alarmed:
            self._out.append(Refused("acknowledge the alarm first"))
            return
        if self._plan is not None:
            self._report("something else was asked for")
        self._plan, self._setup, self._left = plan, plan.setup, plan.repeats
        self._started, self._outages = False, 0
        self._arm()

    def _continue(self, now: float) -> None:
        if self.phase is not Phase.INTERRUPTED or self._plan is None:
            self._out.append(Refused("there is nothing to go on with"))
        elif self._alarmed:
            self._out.append(Refused("acknowledge the alarm first"))
        elif not self._started:  # it was armed, and never confirmed
            self._arm()
        else:
            self._rest(now)

    def _close(self, now: float) -> None:
        if self.phase is Phase.CLOSED:
            return
        self._out.append(VentProbe("close"))
        self._end_repeat("the connection was closed")
        if self.phase in _LINKLESS:
            self._end_series("the connection was closed", Phase.CLOSED)
        else:
            self._await_vent("the connection was closed", Phase.CLOSING, now)

    # ---- outcomes ---------------------------------------------------------------------------

    def _outcome(self, outcome: Outcome, now: float) -> None:
        if outcome.of is not self._awaited:
            return  # it was abandoned by a vent, or by the link
        self._awaited = None
        if self.phase is Phase.SEARCHING:
            self._searched(outcome, now)
        elif isinstance(outcome, Succeeded):
            if self.phase is Phase.ARMING:
                self.phase = Phase.ARMED
                if self._started:
                    self._start()
        elif outcome.link:
            self._lose(str(outcome.error), now)
        else:
            self._fault(str(outcome.error), now, outcome.error)

    def _searched(self, outcome: Outcome, now: float) -> None:
        if isinstance(outcome, Succeeded):
            self.phase = Phase.CHECKING
            self.wake_at = now + self.policy.vent_patience_s
            return
        tried_s = now - self._lost_s
        if not outcome.final and tried_s < self.policy.backoff.give_up_s:
            self._wait_to_try(now)
            return
        gave_up = "" if outcome.final else f"; gave up after {self.policy.backoff.give_up_s:g} s"
        why = f"{self._lost}; {outcome.error}{gave_up}"
        self._end_series(why, Phase.CLOSED)
        self._out.append(Gone(why))

    # ---- events -----------------------------------------------------------------------------

    def _event(self, event: Event, now: float) -> None:
        match event:
            case State(state, reason):
                self._instrument = state
                self._on_state(state, reason, now)
            case LinkLost(reason):
                self._lose(reason, now)
            case LinkRestored():
                self._restored = True
            case VentConfirmed():
                self._confirmed, self._vented_s = True, now
            case Alarm(text):
                self._alarmed = True
                if self.phase in _LINKLESS:
                    self._unseen = True  # nobody saw the vacuum go: not worse than the lost link
                else:
                    self._fault(text, now)
            case InstrumentFault(code, text):
                self._fault(f"instrument fault {code}: {text}", now)
            case HostVented(reason) if self.phase in _ACTIVE | {Phase.INTERRUPTED}:
                # The driver has sent the vent before it said so
                self._give_up(f"{reason}; the probe was told to vent", now)
            case _:
                pass

    def _on_state(self, state: InstrumentState, reason: str, now: float) -> None:
        match self.phase:
            case Phase.STARTING | Phase.RUNNING if state is _S.RUNNING:
                self.phase, self._ran = Phase.RUNNING, True
            case Phase.RUNNING if reason in {PROGRAM_END, PROGRAM_DONE} and state is not _S.FAULT:
                self._end_repeat(None)
                self.phase = Phase.SETTLING
            case Phase.RUNNING:
                what = "the instrument vented by itself" if self.controls else "the curve was cut"
                self._fault(f"{what} ({reason})", now)
            case Phase.ARMED | Phase.STARTING if state is not _S.ARMED:
                self._fault(f"the instrument is {state} ({reason})", now)
            case Phase.CHECKING | Phase.SEARCHING | Phase.CLOSED:
                pass  # how it is found is the driver's business
            case _ if state is _S.RUNNING and self.phase not in {Phase.VENTING, Phase.CLOSING}:
                self._fault("the instrument runs, and nobody has started it", now)
            case Phase.ARMING | Phase.SETTLING | Phase.RESTING if state is _S.FAULT:
                self._fault(f"the instrument reports a fault ({reason})", now)
            case _:
                pass
        if self.phase is Phase.SETTLING and state in _SETTLED:
            self._vented_s = now

    def _fault(self, why: str, now: float, error: Exception | None = None) -> None:
        """Vent, and let no repeat follow."""
        self._out.append(VentProbe(why))
        if self.phase in {Phase.VENTING, Phase.CLOSING}:
            if why not in self._why:
                self._why = f"{self._why}; {why}" if self._why else why
            return
        self._error = error
        silent = error is not None or not self.controls
        told = why if silent else f"{why}; the probe was told to vent"
        self._give_up(told, now, keep_error=True)

    def _lose(self, reason: str, now: float) -> None:
        if self.phase is Phase.CLOSED:
            return
        self._lost = f"{reason}; no vent is confirmed: look at the probe, lift it"
        self._instrument = None
        self._restored = self._confirmed = False
        if self.phase is Phase.SEARCHING:
            return  # an attempt that failed says it again
        self._unseen = False
        self._out.append(VentProbe(reason))
        self._end_repeat(reason)
        if self.phase is Phase.CLOSING:
            self._end_series(self._why, Phase.CLOSED)
            return
        if self.phase is Phase.VENTING:
            self._report(self._why)
        elif self._plan is not None:
            self._outages += 1
            if self._outages > self.policy.most_outages:
                self._report(self._lost)
        self.phase, self._awaited = Phase.SEARCHING, None
        self._lost_s = now
        self._wait_s = self.policy.backoff.first_s
        self._wait_to_try(now)

    def _wait_to_try(self, now: float) -> None:
        """Wait before the next attempt to get the link back, longer each time."""
        backoff = self.policy.backoff
        self.wake_at = now + self._wait_s
        self._wait_s = min(self._wait_s * backoff.factor, backoff.most_s)

    # ---- time -------------------------------------------------------------------------------

    def _pass_time(self, now: float) -> None:
        match self.phase:
            case Phase.SETTLING:
                self._settle(now)
            case Phase.VENTING | Phase.CLOSING:
                end = Phase.READY if self.phase is Phase.VENTING else Phase.CLOSED
                if self._instrument in _SETTLED or self._instrument is None:
                    self._when_quiet(now, self._why, end, self._patient_till_s)
                elif now >= self._patient_till_s:
                    self._end_series(self._why, end)
                else:
                    self.wake_at = self._patient_till_s
            case Phase.CHECKING if self._restored and (self._confirmed or not self._unseen):
                self.wake_at, self._vented_s = None, now
                if self._plan is not None and self._left:
                    self.phase = Phase.INTERRUPTED
                else:  # no plan, or all of it was measured before the link was lost
                    self._end_series("", Phase.READY)
            case _ if self.wake_at is None or now < self.wake_at:
                pass
            case Phase.RESTING:
                self._arm()
            case Phase.SEARCHING:
                self.wake_at = None
                self._await(Reconnect())
            case Phase.CHECKING:
                self._fault(f"{self._lost}; it is back, and no vent was seen", now)
                self._pass_time(now)  # of the vent that is waited for now
            case _:
                self.wake_at = None

    def _settle(self, now: float) -> None:
        """Go on once the instrument says that it is done, or is seen to be and does not say so."""
        patient_till = self._vented_s + self.policy.vent_patience_s
        if self._instrument not in _SETTLED and not (self._confirmed and now >= patient_till):
            self.wake_at = patient_till if self._confirmed else None
        elif self._left:
            self._rest(now)
        else:
            self._when_quiet(now, "", Phase.READY, patient_till)

    def _when_quiet(self, now: float, why: str, phase: Phase, patient_till_s: float) -> None:
        # One that never falls silent is not waited for
        quiet_at = min(self._last_event_s + self.policy.quiet_s, patient_till_s)
        if now >= quiet_at or not self.controls:
            self._end_series(why, phase)
        else:
            self.wake_at = quiet_at

    # ---- steps ------------------------------------------------------------------------------

    def _arm(self) -> None:
        assert self._plan is not None
        assert self._setup is not None
        self.phase, self.wake_at = Phase.ARMING, None
        self._open, self._ran, self._confirmed = True, False, False
        self._await(ArmProbe(self._setup, self._plan.rate_hz))

    def _start(self) -> None:
        self.phase = Phase.STARTING
        self._await(StartProbe())

    def _await(self, command: Awaited) -> None:
        self._awaited = command
        self._out.append(command)

    def _rest(self, now: float) -> None:
        """Rest from when the pressure was gone: an outage counts."""
        assert self._plan is not None
        self.phase = Phase.RESTING
        # Whoever starts the instrument there decides about the rest
        rest_s = self._plan.rest_s if self.controls else 0.0
        self.wake_at = max(now, self._vented_s + rest_s)

    def _end_repeat(self, cut: str | None) -> None:
        """Report the end of what was armed, once; each loading makes the next one another cycle."""
        if not self._open or self._setup is None:
            return
        self._open = False
        setup = self._setup
        self._out.append(RepeatEnded(setup, self._ran, cut))
        if cut is None:
            self._left -= 1
            self._setup = replace(setup, cycle=setup.cycle + 1, repeat=setup.repeat + 1)
        elif self._ran:
            self._setup = replace(setup, cycle=setup.cycle + 1)

    def _give_up(self, why: str, now: float, *, keep_error: bool = False) -> None:
        """Let no repeat follow; what is under way ends with the vent."""
        if not keep_error:
            self._error = None
        self._end_repeat(why)
        if self.phase in _ACTIVE or self.phase is Phase.CHECKING:
            self._await_vent(why, Phase.VENTING, now)
        elif self.phase is Phase.SEARCHING:
            self._report(why)
        elif self.phase is Phase.INTERRUPTED:
            self._end_series(why, Phase.READY)

    def _await_vent(self, why: str, phase: Phase, now: float) -> None:
        if self.phase is not Phase.VENTING:  # which waits since before
            self._patient_till_s = now + self.policy.vent_patience_s
            self._last_event_s = now
            self._why = why
        self.phase, self.wake_at, self._awaited = phase, None, None

    def _report(self, why: str) -> None:
        """Say that the plan is over, if there is one."""
        if self._plan is not None:
            self._out.append(Over(why or None, self._error, self._left))
        self._plan = self._setup = self._error = None
        self._started = False

    def _end_series(self, why: str, phase: Phase) -> None:
        self._report(why)
        self.phase, self.wake_at, self._why = phase, None, ""
