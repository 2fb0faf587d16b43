"""Runs a measurement at a probe, for the screen and headless: events in, commands out.

`Runner.step` belongs to one thread, which passes on all that comes and is never held up by a
command: arming can take a minute where a simulated skin is computed. `ask` and `vent` are for any
thread.
"""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from collections.abc import Callable

from drivers.errors import LinkError
from drivers.events import Event, LinkLost, TimedEvent
from skinlab.acquisition.measurement import Measurement, Policy
from skinlab.acquisition.measurement_messages import (
    AcknowledgeAlarm,
    ArmProbe,
    Awaited,
    Close,
    Failed,
    Outcome,
    Output,
    Phase,
    Reconnect,
    Refused,
    Report,
    Request,
    StartProbe,
    Succeeded,
    Vent,
    VentProbe,
)
from skinlab.acquisition.sources import LiveSource
from skinlab.errors import AcquisitionError
from skinlab.recording.stream import Item

_LOOK_S = 0.01  # how late the outcome of a command may be seen
_WAKE_S = 0.1  # and a request
_JOIN_S = 10.0
_NO_LINK = frozenset({Phase.SEARCHING, Phase.CLOSED})


class Runner:
    """A measurement and the probe that it runs at.

    `deliver` takes each item of the source, before the rules do; `report` what the rules report,
    and each phase that they enter. Both are called by `step`. `clock` gives seconds and never goes
    back.
    """

    def __init__(
        self,
        source: LiveSource,
        deliver: Callable[[Item], None],
        report: Callable[[Report | Phase], None],
        policy: Policy | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.source = source
        self._deliver = deliver
        self._report = report
        self._clock = clock
        self._measurement = Measurement(
            Policy() if policy is None else policy, controls=not source.read_only
        )
        self._requests: queue.SimpleQueue[tuple[Request, int | None]] = queue.SimpleQueue()
        self._commands: queue.SimpleQueue[tuple[Awaited, int] | None] = queue.SimpleQueue()
        self._outcomes: deque[Outcome] = deque()
        self._under_way = 0
        self._thread: threading.Thread | None = None
        self._lock = threading.RLock()
        self._vents = 0  # ordered ...
        self._vents_taken = 0  # ... of which the rules know
        self._closing = False
        self._failed: Exception | None = None  # of `deliver`, while it closes

    @property
    def measurement(self) -> Measurement:
        """The rules; only to be read."""
        return self._measurement

    @property
    def phase(self) -> Phase:
        """Where the measurement is."""
        return self._measurement.phase

    @property
    def rest_s(self) -> float | None:
        """How long the rest before the next repeat still lasts; None: there is none."""
        wake_at = self._measurement.wake_at
        if self.phase is not Phase.RESTING or wake_at is None:
            return None
        return max(wake_at - self._clock(), 0.0)

    @property
    def vents(self) -> int:
        """How often a vent was ordered; given to `ask`, it keeps a request behind a later vent."""
        return self._vents

    # ---- from any thread --------------------------------------------------------------------

    def vent(self, reason: str) -> None:
        """Vent at once; what was on its way is abandoned."""
        with self._lock:
            self._vents += 1
        self.source.probe.vent(reason)
        self._requests.put((Vent(reason), None))

    def ask(self, *requests: Request, vents: int | None = None) -> None:
        """Let the rules take these requests, in order; `vents`: unless one was ordered since."""
        for request in requests:
            self._requests.put((request, vents))

    # ---- from one thread --------------------------------------------------------------------

    def step(self, timeout_s: float = _WAKE_S) -> bool:
        """Do what is due, and take the next item; False where none came in this time.

        Raises:
            Exception: of `deliver` or `report`.
        """
        self._take_requests()
        if self._outcomes:
            # All events that came before the outcome are there by now
            outcome = self._outcomes.popleft()
            self.catch_up()
            self._under_way -= 1
            self._handle(outcome)
        item = self.source.next_item(max(0.0, self._patience(timeout_s)))
        if item is not None:
            self._take(item)
        elif not self.source.probe.is_open and not self._under_way and self.phase not in _NO_LINK:
            self._handle(LinkLost("the link to the probe is closed"))
        else:
            self._handle(None)
        return item is not None

    def catch_up(self) -> None:
        """Take what has come by now.

        Raises:
            Exception: of `deliver` or `report`.
        """
        for item in self.source.come_by_now():
            self._take(item)

    def close(self) -> None:
        """Vent where something is under way, and wait for the vent; then take what is left.

        All of it is delivered, so that the record has the vent, whatever `deliver` raises.

        Raises:
            Exception: of `report`, or the first of `deliver`.
        """
        self._closing = True
        if self.phase is not Phase.READY:
            self.ask(Close())
            self._take_requests()
            while self.phase is not Phase.CLOSED:
                self.step()
        self.stop()
        for item in self.source.come_by_now():
            self._pass_on(item)
        if self._failed is not None:
            raise self._failed

    def stop(self) -> None:
        """Wait until no command is under way; none is begun any more."""
        self._commands.put(None)
        if self._thread is not None:
            self._thread.join(_JOIN_S)

    # ---- inside -----------------------------------------------------------------------------

    def _patience(self, timeout_s: float) -> float:
        wake_at = self._measurement.wake_at
        due_s = timeout_s if wake_at is None else min(timeout_s, wake_at - self._clock())
        return min(due_s, _LOOK_S) if self._under_way else due_s

    def _take_requests(self) -> None:
        while True:
            try:
                request, vents = self._requests.get_nowait()
            except queue.Empty:
                return
            if vents is not None and vents != self._vents:
                self._report(Refused("abandoned: a vent was ordered"))
                continue
            self._handle(request)

    def _take(self, item: Item) -> None:
        try:
            self._pass_on(item)
        finally:  # the rules know of it in any case
            self._handle(item.event if isinstance(item, TimedEvent) else None)

    def _pass_on(self, item: Item) -> None:
        try:
            self._deliver(item)
        except Exception as error:
            if not self._closing:
                raise
            self._failed = self._failed or error

    def _handle(self, given: Request | Event | Outcome | None) -> None:
        before = self.phase
        if isinstance(given, Vent):
            self._vents_taken += 1
        for output in self._measurement.handle(given, self._clock()):
            # `vent` has sent it, and what was given to the probe since then stays behind it
            if not (isinstance(given, Vent) and isinstance(output, VentProbe)):
                self._do(output)
        if self.phase is not before:
            self._report(self.phase)

    def _do(self, output: Output) -> None:
        match output:
            case VentProbe(reason):
                self.source.probe.vent(reason)
            case AcknowledgeAlarm():
                self.source.probe.acknowledge_alarm()
            case ArmProbe() | StartProbe() | Reconnect():
                self._give(output)
            case _:
                self._report(output)

    def _give(self, command: Awaited) -> None:
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="commands", daemon=True)
            self._thread.start()
        self._under_way += 1
        self._commands.put((command, self._vents_taken))

    # ---- the thread of the commands ---------------------------------------------------------

    def _work(self) -> None:
        while (given := self._commands.get()) is not None:
            command, vents = given
            try:
                self._perform(command, vents)
            except Exception as error:  # noqa: BLE001 -- handed to the thread of `step`
                link = isinstance(error, LinkError) and not self.source.probe.is_open
                final = not isinstance(error, LinkError)
                self._outcomes.append(Failed(command, error, link, final))
            else:
                self._outcomes.append(Succeeded(command))

    def _perform(self, command: Awaited, vents: int) -> None:
        if isinstance(command, ArmProbe):
            self._stay_behind(vents)
            self.source.arm(command.setup, command.rate_hz)
            self._stay_behind(vents)
        elif isinstance(command, StartProbe):
            self._stay_behind(vents)
            self.source.start()
            self._stay_behind(vents)
        else:
            self.source.probe.reopen()

    def _stay_behind(self, vents: int) -> None:
        if vents != self._vents:
            self.source.probe.vent("a vent was ordered before")
            raise AcquisitionError("abandoned: a vent was ordered")
