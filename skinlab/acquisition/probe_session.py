"""A probe at a time, for a screen: the connection, the measurement at it, and the session recorded.

`ProbeSession.serve` runs in one thread for as long as the connection lasts; the other methods may
be called from any thread. What happens is posted.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.dialects import describe_dialect
from drivers.dose import Dose
from drivers.errors import DriverError, LinkError
from drivers.events import TimedEvent
from drivers.probe import Probe
from skinlab.acquisition import measurement_messages
from skinlab.acquisition.analysis import Analysis, Explain, default_identifier
from skinlab.acquisition.measurement import Policy
from skinlab.acquisition.measurement_messages import (
    Acknowledge,
    Arm,
    Close,
    Continue,
    Gone,
    Phase,
    Refused,
    Report,
    Request,
    Start,
)
from skinlab.acquisition.messages import (
    Connected,
    Disconnected,
    Estimated,
    Failed,
    News,
    Over,
    Recording,
    Saved,
    Went,
)
from skinlab.acquisition.outbox import Outbox
from skinlab.acquisition.runner import Runner
from skinlab.acquisition.sources import LiveSource
from skinlab.errors import AcquisitionError, SkinlabError
from skinlab.recording.byte_tap import ByteTap
from skinlab.recording.dose import VISIT_S
from skinlab.recording.stream import Happened, Item

if TYPE_CHECKING:
    from drivers.events import Hello
    from skinlab.acquisition.measurement_request import Order
    from skinlab.acquisition.visit import Visit
    from skinlab.curves.probe_file import ProbeErrors
    from skinlab.inference.identify import Identifier

_LOOK_S = 0.01  # while an identification is under way: how late its answer may be seen
_POLL_S = 0.1  # also how long the stream must be quiet before the session is saved
_BATCH_S = 0.04  # posts are no more frequent than the screen is drawn
_CLOSE_S = 20.0

_Whose = tuple[str, str, bool]  # subject, site, simulated


class ProbeSession:
    """A probe at a time, and the session of a visit: one subject, one site.

    A session outlives its probe: another head, with another opening, goes on with it. What is
    simulated and what is not never come into one session. `analysis` is for what is computed
    beside; `calibration` is the probe file that it takes, so that whether it holds is said at once.
    """

    def __init__(
        self,
        folder: Path,
        post: Callable[[News], None],
        *,
        make_identifier: Callable[[], Identifier] = default_identifier,
        make_probe: Callable[..., Probe] = Probe,
        now: Callable[[], datetime] = datetime.now,
        policy: Policy | None = None,
        explain: Explain | None = None,
        calibration: ProbeErrors | None = None,
        apart: bool = False,
    ) -> None:
        self.analysis = Analysis(
            folder,
            post,
            self,
            make_identifier=make_identifier,
            explain=explain,
            apart=apart,
            now=now,
        )
        self._folder = folder
        self._post = post
        self._make_probe = make_probe
        self._now = now
        self._policy = policy
        self._calibration = calibration
        self._outbox = Outbox(post, now)  # of the serving thread
        self._probe: Probe | None = None
        self._runner: Runner | None = None
        self._port = ""
        self._tap = ByteTap()
        self._visit: Visit | None = None
        self._dose = Dose()  # what the site of the visit had from probes that are gone
        # Of all sites, and when: a new session does not rest the skin
        self._doses: dict[_Whose, tuple[Dose, datetime]] = {}
        self._whose: _Whose | None = None  # skin the open visit is of
        self._free = threading.Event()
        self._free.set()
        self._vents = 0
        self._closes = 0
        self._lock = threading.Lock()
        self._keep = False  # the session, once this connection is over
        self._ending = threading.Lock()

    @property
    def vents(self) -> int:
        """How often a vent was ordered; `measure` takes it, to stay behind a later vent."""
        return self._vents

    @property
    def recording_failed(self) -> bool:
        """Whether this connection records nothing any more: only another one starts anything."""
        probe = self._probe
        return probe is not None and probe.recording_error is not None

    @property
    def recorded_with(self) -> Identifier | None:
        """What the curves of the open session are identified with; None: there is none."""
        visit = self._visit
        return None if visit is None else visit.identifier

    # ---- at once, from any thread -------------------------------------------------------------

    def vent(self, reason: str) -> None:
        """Vent; whatever was on its way is abandoned."""
        with self._lock:
            self._vents += 1
        runner, probe = self._runner, self._probe
        if runner is not None:
            runner.vent(reason)
        elif probe is not None:
            probe.vent(reason)

    def acknowledge(self, text: str) -> None:
        """Unlatch the alarm that said this; the session's audit trail tells who did.

        Raises:
            SkinlabError: the trail cannot be written; the alarm is unlatched all the same.
        """
        if self._runner is not None:
            self._runner.ask(Acknowledge())
        if self._visit is not None:
            self.audit("alarm acknowledged", text=text)

    def audit(self, what: str, **detail: Any) -> None:
        """Record in the session's audit trail that the operator decided this.

        Raises:
            SkinlabError: there is no session, or it cannot be written.
        """
        visit = self._visit
        if visit is None:
            raise AcquisitionError("there is no session to keep this in")
        visit.audit(what, **detail)

    # ---- slow: to be called in a worker thread ------------------------------------------------

    def measure(self, order: Order, vents: int) -> None:
        """Arm and start, with the repeats that follow; the first time, open the session.

        What becomes of it is posted.

        Raises:
            SkinlabError, DriverError: it was refused, or a vent came in between.
        """
        identifier = self.analysis.identifier
        probe = self._probe
        if self._runner is None or probe is None or probe.hello is None:
            raise LinkError("no probe is connected")
        known, hello = identifier.sensor.probe, probe.hello
        if known is not None:
            known.check_instrument(hello.serial_number, hello.aperture_mm, self._now())
        if self._visit is None:
            self._open_visit(order, probe, identifier)
        self._ask(vents, Arm(order.plan), Start())

    def go_on(self, vents: int) -> None:
        """Take the repeat again that a lost link has cut, and those that were left.

        Raises:
            SkinlabError, DriverError: it was refused, or a vent came in between.
        """
        self._ask(vents, Continue())

    def reset(self) -> None:
        """Acknowledge a fault of the instrument.

        Raises:
            DriverError: the cause persists.
        """
        probe = self._probe
        if probe is None:
            raise LinkError("no probe is connected")
        probe.reset()

    def leave(self) -> None:
        """Vent and let go of the probe; the session waits for the next one. Raises nothing."""
        self._let_go(keep=True)

    def close(self) -> None:
        """Vent, let go of the probe and finish the session. Raises nothing."""
        self._let_go(keep=False)
        if self._free.is_set():
            self._end_visit()
        self.analysis.close()

    def serve(self, port: str, *, anew: bool = False) -> None:
        """Connect, and pass on all that comes until the connection is over.

        A session that was left open goes on, unless `anew`. It is finished with the connection,
        unless that was left for another one, or its link was lost for good.

        Raises:
            DriverError: the port or its dialect is none, or no probe answered there; a session that
                was left open waits on.
            Exception: a bug; the probe was vented and the session finished.
        """
        if not self._free.is_set():
            raise LinkError(f"{self._port} is still connected")
        self._free.clear()
        self._port = port
        closes = self._closes
        try:
            if anew:
                self._end_visit()
            self._keep = True
            self._tap = ByteTap()
            probe = self._probe = self._make_probe(port, on_bytes=self._tap)
        except BaseException:  # the port names no dialect that there is
            self._free.set()
            raise
        probe.carry_dose(self._dose)
        source = LiveSource(probe)
        runner = Runner(source, self._deliver, self._report, self._policy)
        try:
            hello = probe.open()
            self._runner = runner
            if closes == self._closes:  # else it was closed before it was open
                goes_on = self._take_up(port, probe, source, hello)
                self._keep = False  # else it could not be recorded, and waits for the next one
                known = self._calibration
                standing = None if known is None else known.standing(self._now())
                self._post(Connected(port, hello, goes_on=goes_on, probe=standing))
                self._run(runner)
        finally:
            self._runner = None
            probe.close()
            runner.stop()
            probe.close()  # where a lost link was just found again
            _wait_closed(probe)
            self._probe = None
            self._dose = probe.dose
            self._keep_dose()
            try:
                self._finish(source)
            finally:
                self._free.set()
        self._post(Disconnected(port))

    # ---- inside -------------------------------------------------------------------------------

    def _ask(self, vents: int, *requests: Request) -> None:
        runner = self._runner
        if runner is None:
            raise LinkError("no probe is connected")
        known = runner.vents
        if vents != self._vents:
            raise AcquisitionError("abandoned: a vent was ordered")
        runner.ask(*requests, vents=known)

    def _let_go(self, *, keep: bool) -> None:
        with self._lock:
            self._vents += 1
        self._closes += 1
        self._keep = keep
        runner, probe = self._runner, self._probe
        if runner is not None:
            runner.ask(Close())
        if probe is not None:
            probe.close()  # here and now: it vents
        self._free.wait(_CLOSE_S)

    def _run(self, runner: Runner) -> None:
        """Pass on what comes, and save when nothing does."""
        while runner.phase is not Phase.CLOSED:
            took = self._step(runner, _POLL_S)
            end = time.monotonic() + _BATCH_S
            while took and (left := end - time.monotonic()) > 0 and self._step(runner, left):
                pass
            self._outbox.flush()
            visit = self._visit
            # One that only streams is never silent: between its curves there is time
            streams = not runner.measurement.controls and runner.phase is not Phase.RUNNING
            due = visit is not None and visit.unsaved and not visit.busy
            if visit is not None and due and (streams or not took):
                self._save(visit)

    def _step(self, runner: Runner, timeout_s: float) -> bool:
        visit = self._visit
        if visit is None:
            return runner.step(timeout_s)
        if visit.take_result():
            return True
        return runner.step(min(timeout_s, _LOOK_S) if visit.busy else timeout_s)

    def _deliver(self, item: Item) -> None:
        visit = self._visit
        if visit is not None:
            visit.handle(item)
        elif isinstance(item, TimedEvent):
            self._outbox.add(Happened(item.event))

    def _report(self, report: Report | Phase) -> None:
        runner = self._runner
        self._outbox.flush()
        match report:
            case Phase() if runner is not None:
                self._post(Went(report, runner.measurement.left, runner.rest_s))
            case measurement_messages.Over(failed, error, left):
                if error is not None and not isinstance(error, SkinlabError | DriverError):
                    raise error
                if error is not None:
                    self._post(Failed("measuring", str(error)))
                if runner is None or runner.phase is not Phase.ARMING:  # else it was replaced
                    self._post(Over(failed, left))
            case Gone(why):
                self._keep = True  # the visit is not over: decisions are kept, and a probe may come
                self._post(Failed("searching", why))
            case Refused(why):
                self._post(Failed("measuring", why))
            case _:
                pass

    # ---- the session --------------------------------------------------------------------------

    def _take_up(self, port: str, probe: Probe, source: LiveSource, hello: Hello) -> bool:
        """Go on with the session that was left open; False: there is none, or not of this kind."""
        visit = self._visit
        if visit is not None and (visit.simulated, visit.dialect) != (
            hello.simulated,
            describe_dialect(probe.dialect),
        ):
            self._end_visit()
            probe.carry_dose(Dose())
            visit = None
        if visit is None:
            return False
        journal = visit.recording.journal
        self._tap.into(journal)
        source.journal = journal
        visit.audit(
            "probe changed",
            url=port,
            model=hello.model,
            serial_number=hello.serial_number,
            aperture_mm=hello.aperture_mm,
        )
        return True

    def _open_visit(self, order: Order, probe: Probe, identifier: Identifier) -> None:
        from skinlab.acquisition.visit import Visit  # slow to import
        from skinlab.recording.recorder import Recording as SessionRecording
        from skinlab.recording.recorder import new_session_path

        runner = self._runner
        if runner is None:
            raise LinkError("no probe is connected")
        simulated = probe.hello is not None and probe.hello.simulated
        self._whose = (order.subject, order.site, simulated)
        path = new_session_path(self._folder, self._now())
        recording = SessionRecording(
            path,
            identifier,
            subject=order.subject,
            site=order.site,
            url=order.port,
            dialect=probe.dialect,
        )
        self._tap.into(recording.journal)
        runner.source.journal = recording.journal
        # By the sessions on disk, or by what was seen here: whichever says more
        doses = (recording.carry_dose(simulated=simulated), self._had(self._whose))
        before = max(doses, key=lambda dose: dose.suction_mbar_s)
        probe.carry_dose(before)
        self._visit = Visit(
            recording,
            identifier,
            self.analysis.worker(identifier),
            self._outbox.add,
            lambda index, result: self._post(Estimated(index, result)),
            simulated=simulated,
            dialect=describe_dialect(probe.dialect),
        )
        self._post(Recording(path, before))

    def _keep_dose(self) -> None:
        """Note what the site of the open visit has had by now."""
        if self._whose is not None:
            dose = self._dose if self._probe is None else self._probe.dose
            self._doses[self._whose] = dose, self._now()

    def _had(self, whose: _Whose) -> Dose:
        """Return what this skin had in this visit before, as far as it was seen here."""
        dose, at = self._doses.get(whose, (Dose(), self._now()))
        return dose if abs((self._now() - at).total_seconds()) <= VISIT_S else Dose()

    def _save(self, visit: Visit) -> None:
        """Write the session as it is by now; the journal goes on."""
        try:
            visit.save()
        except SkinlabError as error:
            self._post(Failed("saving", str(error)))
        else:
            self._post(Saved(visit.recording.path))

    def _finish(self, source: LiveSource) -> None:
        visit = self._visit
        try:
            try:
                self._deliver_all(source)
            finally:
                if visit is not None:
                    visit.end_connection()
        finally:
            self._outbox.flush()
            if self._keep and visit is not None:
                if visit.unsaved:
                    self._save(visit)
            else:
                self._end_visit()

    def _deliver_all(self, source: LiveSource) -> None:
        """Deliver what has come by now, the vent with it, whatever a listener does.

        Raises:
            Exception: the first that came of it.
        """
        failed: Exception | None = None
        for item in source.come_by_now():
            try:
                self._deliver(item)
            except Exception as error:  # noqa: BLE001 -- raised once all is in the record
                failed = failed or error
        if failed is not None:
            raise failed

    def _end_visit(self) -> None:
        """Finish the session, if there is one; whoever comes second waits until it is done."""
        with self._ending:
            visit, self._visit = self._visit, None
            self._keep_dose()
            self._dose, self._whose = Dose(), None
            if visit is None:
                return
            visit.close()
            try:
                path = visit.recording.finish()
            except SkinlabError as error:
                self._post(Failed("saving", str(error)))
                return
            if path is not None:
                self._post(Saved(path))


def _wait_closed(probe: Probe) -> None:
    """Wait until nothing comes any more, where another thread is closing the probe."""
    end = time.monotonic() + _CLOSE_S
    while probe.is_open and time.monotonic() < end:
        time.sleep(0.01)
