"""The side of the threads: one probe, its pipeline and its session. Knows nothing of a screen.

`serve` runs in one thread for as long as the connection lasts and owns pipeline and recording; the
other methods may be called from any thread. What happens is posted.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from drivers.dose import Dose
from drivers.errors import DriverError, LinkError
from drivers.probe import Probe
from drivers.reconnect import Backoff, reconnect
from skinlab.acquisition.gc_tuning import shorten_pauses
from skinlab.errors import AcquisitionError, SkinlabError
from skinlab.inference.result import Identification
from skinlab.recording.stream import CurveCompleted, Happened, Identified, Message
from skinlab.tui.byte_tap import Tape
from skinlab.tui.explainer import Explainer
from skinlab.tui.identification_worker import Analyst
from skinlab.tui.measurement_request import Order
from skinlab.tui.messages import (
    Adopted,
    Compared,
    Connected,
    Disconnected,
    Estimated,
    Explained,
    Explaining,
    Failed,
    Fitted,
    Found,
    Heard,
    News,
    Recording,
    Saved,
    Searching,
)
from skinlab.tui.own_process import OwnProcess

if TYPE_CHECKING:
    from drivers.events import Hello
    from skinlab.acquisition.pipeline import Pipeline
    from skinlab.acquisition.sources import LiveSource
    from skinlab.curves.campaign import Campaign
    from skinlab.curves.curve import Curve
    from skinlab.discrepancy.outcome import Outcome
    from skinlab.inference.identify import Identifier
    from skinlab.mechanics.model_file import Model
    from skinlab.recording.recorder import Recording as SessionRecording

_LOOK_S = 0.01  # while an identification is under way: how late its answer may be seen
_POLL_S = 0.1  # also how long the stream must be quiet before the session is saved
_BATCH_S = 0.04  # posts are no more frequent than the screen is drawn
_CLOSE_S = 20.0
_BACKOFF = Backoff(give_up_s=60.0)  # somebody is there, and looks for the plug


def default_identifier() -> Identifier:
    """Return the identifier with the defaults of the command line; slow to import."""
    from skinlab.inference.identify import Identifier
    from skinlab.tables.store import shipped_table

    return Identifier(shipped_table())


class Explain(Protocol):
    """Looks for what the model misses; can be cancelled."""

    def __call__(
        self, campaign: Campaign, model: Model, tell: Callable[[str], None], /
    ) -> Outcome | None:
        """Return the answer; None: it was cancelled."""

    def cancel(self) -> None:
        """Give up."""


@dataclass(frozen=True)
class _Visit:
    """What there is from the first arming on."""

    recording: SessionRecording
    source: LiveSource
    pipeline: Pipeline
    analyst: Analyst
    identifier: Identifier
    simulated: bool


class Bench:
    """A probe at a time, and the session of a visit: one subject, one site.

    A session outlives its probe: another head, with another opening, goes on with it. What is
    simulated and what is not never come into one session.
    """

    def __init__(
        self,
        folder: Path,
        post: Callable[[News], None],
        *,
        make_identifier: Callable[[], Identifier] = default_identifier,
        make_probe: Callable[..., Probe] = Probe,
        now: Callable[[], datetime] = datetime.now,
        backoff: Backoff = _BACKOFF,
        explain: Explain | None = None,
        model: Model | None = None,
        apart: bool = False,
    ) -> None:
        self._folder = folder
        self._post = post
        self._make_identifier = make_identifier
        self._model = model
        self._make_probe = make_probe
        self._now = now
        self._backoff = backoff
        self._identifier: Identifier | None = None
        self._loading = threading.Lock()
        self._apart = apart  # curves are identified in another process
        self._process: OwnProcess | None = None
        self._probe: Probe | None = None
        self._port = ""
        self._tape = Tape()
        self._visit: _Visit | None = None
        self._messages: list[Message] = []  # of the serving thread
        self._dose = Dose()  # what the site of the visit had from probes that are gone
        self._unsaved = False  # a result came since the file was last written
        self._free = threading.Event()
        self._free.set()
        self._vents = 0
        self._closes = 0
        self._closing = threading.Event()  # wakes who waits for a lost link
        self._explain = Explainer() if explain is None else explain
        self._model_name = None if model is None else model.model.name
        self._replaced: list[tuple[Identifier, str | None]] = []  # by adopted models, with names
        self._keep = False  # the session, once this connection is over
        self._ending = threading.Lock()

    @property
    def vents(self) -> int:
        """How often a vent was ordered; `arm` and `start` take it, to stay behind a later vent."""
        return self._vents

    # ---- at once, from any thread -------------------------------------------------------------

    def vent(self, reason: str) -> None:
        """Vent; whatever was on its way is abandoned."""
        self._vents += 1
        probe = self._probe
        if probe is not None:
            probe.vent(reason)

    def acknowledge(self, text: str) -> None:
        """Unlatch the alarm that said this; the session's audit trail tells who did.

        Raises:
            SkinlabError: the trail cannot be written; the alarm is unlatched all the same.
        """
        probe = self._probe
        if probe is not None:
            probe.acknowledge_alarm()
        if self._visit is not None:
            self.audit("alarm acknowledged", text=text)

    def audit(self, what: str, **detail: object) -> None:
        """Record in the session's audit trail that the operator decided this.

        Raises:
            SkinlabError: there is no session, or it cannot be written.
        """
        visit = self._visit
        if visit is None:
            raise AcquisitionError("there is no session to keep this in")
        visit.recording.audit(what, **detail)
        self._unsaved = True

    # ---- slow: to be called in a worker thread ------------------------------------------------

    def prepare(self) -> None:
        """Load what identification needs."""
        self._worker(self._load_identifier())

    def arm(self, order: Order, vents: int) -> None:
        """Make the connected probe ready for this order; the first time, open the session.

        Raises:
            SkinlabError, DriverError: it was refused, or a vent came in between.
        """
        identifier = self._load_identifier()
        probe = self._probe
        if probe is None or probe.hello is None:
            raise LinkError("no probe is connected")
        visit = self._visit or self._open_visit(order, probe, identifier)
        self._stay_behind(vents)
        visit.source.arm(order.setup)
        self._stay_behind(vents)

    def start(self, vents: int) -> None:
        """Start the armed run.

        Raises:
            SkinlabError, DriverError: it was refused, or a vent came in between.
        """
        visit = self._visit
        if visit is None:
            raise AcquisitionError("nothing is armed")
        self._stay_behind(vents)
        visit.source.start()
        self._stay_behind(vents)

    def reset(self) -> None:
        """Acknowledge a fault of the instrument.

        Raises:
            DriverError: the cause persists.
        """
        probe = self._probe
        if probe is None:
            raise LinkError("no probe is connected")
        probe.reset()

    def fit_together(self, curves: Sequence[Curve]) -> None:
        """Post one answer for several curves.

        Raises:
            SkinlabError: it cannot be computed.
        """
        identifier = self._load_identifier()
        self._post(Fitted(identifier(curves[0]) if len(curves) == 1 else identifier.joint(curves)))

    def compare(self, before: Path, curves: Sequence[Curve]) -> None:
        """Post how these curves differ from an earlier session.

        Raises:
            SkinlabError: it cannot be read, or one of the two gives nothing to compare.
        """
        from skinlab.inference.compare import compare, in_words
        from skinlab.recording.session import read_session
        from skinlab.recording.session_fit import fit_curves, fit_session

        identifier = self._load_identifier()
        session = read_session(before)
        earlier = fit_session(identifier, before, session)
        found = compare(earlier, fit_curves(identifier, "this session", curves))
        meta = session.meta
        who = ", ".join(str(meta[k]) for k in ("subject", "site") if meta.get(k))
        title = f"Compared with {before.name} ({who or 'no subject'}):"
        self._post(Compared((title, *(f"  {line}" for line in in_words(found)))))

    def leave(self) -> None:
        """Vent and let go of the probe; the session waits for the next one. Raises nothing."""
        self._let_go(keep=True)

    def explain(self, curves: Sequence[Curve]) -> None:
        """Look for what the model misses in these curves; post each stage, and the answer.

        Raises:
            SkinlabError: there is none.
        """
        from skinlab.curves.campaign import Campaign

        identifier = self._load_identifier()
        sensor = identifier.sensor
        campaign = Campaign("", sensor.noise_um, sensor.pressure_noise_mbar, tuple(curves))
        outcome = self._explain(campaign, identifier.model, lambda s: self._post(Explaining(s)))
        if outcome is not None:
            self._post(Explained(outcome))

    def stop_explaining(self) -> None:
        """Give the search up; at once, from any thread."""
        self._explain.cancel()

    def adopt(self, outcome: Outcome, session: Path | None) -> None:
        """Write the model with the missing effect, and identify with it from the next session on.

        `session` is the file that the curves are in, where there is one.

        Raises:
            SkinlabError: it cannot be written.
        """
        from skinlab.discrepancy.model_identifier import with_model
        from skinlab.tui.adopting import write_adopted

        identifier = self._load_identifier()
        path, model = write_adopted(
            outcome, identifier.model, self._folder, session, identifier.database, self._now()
        )
        if self._visit is not None:
            self.audit("model adopted", file=path.name, hash=model.hash)
        self._replaced.append((identifier, self._model_name))
        self._model_name = model.model.name
        self._identifier = with_model(identifier, model)
        self._post(Adopted(path, model.model.name, anew=self._another_model))

    def undo_adoption(self) -> None:
        """Identify with the model that was replaced last; the written file stays.

        Raises:
            SkinlabError: no model was adopted, or it cannot be recorded.
        """
        if not self._replaced:
            raise AcquisitionError("no model was adopted: there is nothing to undo")
        if self._visit is not None:
            self.audit("model adoption undone")
        self._identifier, self._model_name = self._replaced.pop()
        self._post(Adopted(None, self._model_name, anew=self._another_model))

    @property
    def _another_model(self) -> bool:
        """Whether the open session was identified with another model than is used now."""
        return self._visit is not None and self._visit.identifier is not self._identifier

    def close(self) -> None:
        """Vent, let go of the probe and finish the session. Raises nothing."""
        self._let_go(keep=False)
        if self._free.is_set():
            self._end_visit()
        self._explain.cancel()
        if self._process is not None:
            self._process.close()

    def _let_go(self, *, keep: bool) -> None:
        self._vents += 1
        self._closes += 1
        self._keep = keep
        self._closing.set()
        probe = self._probe
        if probe is not None:
            probe.close()
        self._free.wait(_CLOSE_S)

    def serve(self, port: str, *, anew: bool = False) -> None:
        """Connect, and pass on all that comes until the connection is over.

        A session that was left open goes on, unless `anew`. It is finished with the connection,
        unless that was left for another one.

        Raises:
            DriverError: no probe answered at this port; a session that was left open waits on.
            Exception: a bug; the probe was vented and the session finished.
        """
        if not self._free.is_set():
            raise LinkError(f"{self._port} is still connected")
        self._free.clear()
        self._port = port
        self._messages = []
        closes = self._closes
        self._closing.clear()
        if anew:
            self._end_visit()
        self._keep = True
        self._tape = Tape()
        probe = self._probe = self._make_probe(port, on_bytes=self._tape)
        probe.carry_dose(self._dose)
        try:
            hello = probe.open()
            if closes == self._closes:  # else it was closed before it was open
                self._keep = False
                self._post(Connected(port, hello, goes_on=self._take_up(port, probe, hello)))
                self._pull(probe)
                while closes == self._closes and self._find(probe, closes):
                    self._pull(probe)
        finally:
            probe.close()
            _wait_closed(probe)
            self._probe = None
            self._dose = probe.dose
            try:
                self._finish(probe)
            finally:
                self._free.set()
        self._post(Disconnected(port))

    # ---- inside -------------------------------------------------------------------------------

    def _take_up(self, port: str, probe: Probe, hello: Hello) -> bool:
        """Go on with the session that was left open; False: there is none, or not of this kind."""
        from skinlab.acquisition.sources import LiveSource

        visit = self._visit
        if visit is not None and (
            visit.simulated != hello.simulated
            or visit.source.probe.dialect.name != probe.dialect.name
        ):
            self._end_visit()
            probe.carry_dose(Dose())
            visit = None
        if visit is None:
            return False
        self._tape.into(visit.recording.journal)
        visit.recording.audit(
            "probe changed",
            url=port,
            model=hello.model,
            serial_number=hello.serial_number,
            aperture_mm=hello.aperture_mm,
        )
        self._visit = replace(visit, source=LiveSource(probe, visit.recording.journal))
        return True

    def _load_identifier(self) -> Identifier:
        with self._loading:
            if self._identifier is None:
                identifier = self._make_identifier()
                if self._model is not None:
                    from skinlab.discrepancy.model_identifier import with_model

                    identifier = with_model(identifier, self._model)
                self._identifier = identifier
                shorten_pauses()
            return self._identifier

    def _worker(self, identifier: Identifier) -> Identifier | OwnProcess:
        """Return what identifies curves as this identifier does."""
        if not self._apart:
            return identifier
        with self._loading:
            if self._process is None or self._process.identifier is not identifier:
                if self._process is not None:
                    self._process.close()
                self._process = OwnProcess(identifier)
            return self._process

    def _stay_behind(self, vents: int) -> None:
        if vents != self._vents:
            self.vent("a vent was ordered before")
            raise AcquisitionError("abandoned: a vent was ordered")

    def _open_visit(self, order: Order, probe: Probe, identifier: Identifier) -> _Visit:
        from skinlab.acquisition.pipeline import Pipeline
        from skinlab.acquisition.sources import LiveSource
        from skinlab.recording.recorder import Recording as SessionRecording
        from skinlab.recording.recorder import new_session_path

        path = new_session_path(self._folder, self._now())
        recording = SessionRecording(
            path,
            identifier,
            subject=order.subject,
            site=order.site,
            url=order.port,
            dialect=probe.dialect,
        )
        self._tape.into(recording.journal)
        analyst = Analyst(self._worker(identifier), self._estimated)
        visit = _Visit(
            recording,
            LiveSource(probe, recording.journal),
            Pipeline(identifier, [recording, self._note, analyst.listen], analyst.hand_over),
            analyst,
            identifier,
            simulated=probe.hello is not None and probe.hello.simulated,
        )
        self._visit, self._unsaved = visit, False
        self._post(Recording(path))
        return visit

    def _note(self, message: Message) -> None:
        self._messages.append(message)
        self._unsaved = self._unsaved or isinstance(message, Identified)
        if isinstance(message, CurveCompleted | Identified):
            self._flush()  # now, not with the batch: it is waited for

    def _estimated(self, index: int, result: Identification) -> None:
        self._post(Estimated(index, result))

    def _pull(self, probe: Probe) -> None:
        while True:
            took = self._take_batch(probe)
            if took:
                continue
            if not probe.is_open:
                return
            if self._visit is not None and self._visit.analyst.busy:
                continue
            if self._unsaved and self._visit is not None:
                self._save(self._visit)

    def _find(self, probe: Probe, closes: int) -> bool:
        """Look for a lost link; False where it stays lost, or nobody wants it any more."""
        self._post(Searching(self._port))
        if self._visit is not None:
            self._settle(self._visit)
            self._flush()
            if self._unsaved:
                self._save(self._visit)
        try:
            reconnect(
                probe,
                self._backoff,
                sleep=self._closing.wait,
                stop=lambda: closes != self._closes,
            )
        except DriverError as error:
            if closes == self._closes:
                self._post(Failed("searching", str(error)))
            return False
        self._post(Found(self._port))
        return True

    def _take_batch(self, probe: Probe) -> bool:
        """Take what is there, for as long as a batch lasts; post it. False: nothing came."""
        took = self._take(probe, _POLL_S)
        end = time.monotonic() + _BATCH_S
        while took and (left := end - time.monotonic()) > 0 and self._take(probe, left):
            pass
        self._flush()
        return took

    def _take(self, probe: Probe, timeout_s: float) -> bool:
        visit = self._visit
        if visit is None:
            timed = probe.next_event(timeout_s)
            if timed is not None:
                self._note(Happened(timed.event))
            return timed is not None
        found = visit.analyst.take()
        if found is not None:
            visit.pipeline.identified(*found)
            return True
        item = visit.source.next_item(min(timeout_s, _LOOK_S) if visit.analyst.busy else timeout_s)
        if item is None:
            return False
        visit.pipeline.handle(item)
        return True

    def _settle(self, visit: _Visit) -> None:
        """Wait for the identifications that are under way; nothing else comes now."""
        while (found := visit.analyst.take(wait=True)) is not None:
            visit.pipeline.identified(*found)

    def _flush(self) -> None:
        if self._messages:
            messages, self._messages = tuple(self._messages), []
            self._post(Heard(messages, self._moment()))

    def _moment(self) -> datetime | None:
        """Return when what is posted now happened, in local time."""
        return self._now()

    # ---- the session --------------------------------------------------------------------------

    def _save(self, visit: _Visit) -> None:
        """Write the session as it is by now; the journal goes on."""
        self._unsaved = False
        try:
            visit.recording.save()
        except SkinlabError as error:
            self._post(Failed("saving", str(error)))
        else:
            self._post(Saved(visit.recording.path))

    def _finish(self, probe: Probe) -> None:
        try:
            while self._take(probe, 0.0):
                pass
            if self._visit is not None:
                self._visit.pipeline.end("the connection ended")
                self._settle(self._visit)
        finally:
            self._flush()
            if self._keep and self._visit is not None:
                if self._unsaved:
                    self._save(self._visit)
            else:
                self._end_visit()

    def _end_visit(self) -> None:
        """Finish the session, if there is one; whoever comes second waits until it is done."""
        with self._ending:
            visit, self._visit = self._visit, None
            self._dose = Dose()
            if visit is None:
                return
            visit.analyst.close()
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
