"""A recorded session in the place of a probe: the same news for the same screens."""

from __future__ import annotations

import threading
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.events import Hello, TimedEvent
from skinlab.acquisition.analysis import Analysis
from skinlab.acquisition.identification_worker import IdentificationWorker
from skinlab.acquisition.messages import Connected, Estimated, News, Played
from skinlab.acquisition.outbox import Outbox
from skinlab.acquisition.replay_control import ReplayControl
from skinlab.errors import AcquisitionError
from skinlab.recording.stream import CurveCompleted, Identified

if TYPE_CHECKING:
    from skinlab.acquisition.measurement_request import Order
    from skinlab.inference.identify import Identifier
    from skinlab.inference.result import Identification

_NOBODY = Hello("", 0, "recording", "", "", 0.0, 0.0, 0.0, 0.0, 0.0, simulated=False)


_SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 50.0)


def next_speed(speed: float | None, *, faster: bool) -> float | None:
    """Return the next speed up or down; None is without waiting."""
    if speed is None:
        return None if faster else _SPEEDS[-1]
    if faster:
        return next((s for s in _SPEEDS if s > speed), None)
    return next((s for s in reversed(_SPEEDS) if s < speed), _SPEEDS[0])


class Replayer:
    """Plays a session, in the place of a `ProbeSession`; nothing moves, and nothing is written."""

    recorded_with: Identifier | None = None  # no session is open

    def __init__(
        self,
        folder: Path,
        post: Callable[[News], None],
        speed: float | None = 1.0,
        *,
        database_path: Path | None = None,
    ) -> None:
        self._database_path = database_path
        self.analysis = Analysis(folder, post, self)
        self.control = ReplayControl(speed, sleep=self._nap)
        self._post = post
        self._outbox = Outbox(self._heard, self._moment)
        self._free = threading.Event()
        self._free.set()
        self._closing = threading.Event()
        self._vents = 0
        self._begin_s = self._length_s = 0.0
        self._told: Played | None = None
        self._created: datetime | None = None  # in local time
        self._created_s = 0.0  # the same by the clock of the record

    @property
    def vents(self) -> int:
        """How often a vent was asked for."""
        return self._vents

    @property
    def recording_failed(self) -> bool:
        """Nothing is recorded."""
        return False

    def again(self, ahead_s: float | None = None) -> None:
        """Be ready to play from the beginning, whose first `ahead_s` are not waited for.

        Speed and pause stay as they were.
        """
        paused = self.control.paused and ahead_s is not None
        speed = self.control.speed
        self.control = ReplayControl(speed, paused=paused, ahead_s=ahead_s, sleep=self._nap)

    def vent(self, reason: str) -> None:
        """Count it: there is nothing to vent."""
        self._vents += 1

    def acknowledge(self, text: str) -> None:
        """Do nothing: the alarm is one of then."""

    def audit(self, what: str, **detail: Any) -> None:
        """Refuse: a record is never changed.

        Raises:
            AcquisitionError: always.
        """
        raise AcquisitionError("this is a replay: what you decide here is not recorded")

    def measure(self, order: Order, vents: int) -> None:
        """Refuse.

        Raises:
            AcquisitionError: always.
        """
        raise AcquisitionError("this is a replay: no probe is connected")

    def go_on(self, vents: int) -> None:
        """Refuse.

        Raises:
            AcquisitionError: always.
        """
        raise AcquisitionError("this is a replay: no probe is connected")

    def reset(self) -> None:
        """Refuse.

        Raises:
            AcquisitionError: always.
        """
        raise AcquisitionError("this is a replay: no probe is connected")

    def leave(self) -> None:
        """Stop."""
        self.close()

    def close(self) -> None:
        """Stop."""
        self._vents += 1
        self.control.stop()
        self._closing.set()
        self._free.wait()
        self.analysis.close()

    def serve(self, port: str, *, anew: bool = False) -> None:
        """Play the session in the file `port` until its end, or until it is closed.

        Raises:
            InputError: it cannot be read.
        """
        from skinlab.acquisition.replay import identifier_of, replay
        from skinlab.recording.advised import MISSING_EFFECT, advised_curves
        from skinlab.recording.recorded_items import dialect_of, recorded_items
        from skinlab.recording.session import read_session

        del anew  # every replay is
        self._free.clear()
        self._closing.clear()
        worker: IdentificationWorker | None = None
        self._told = None
        try:
            session = read_session(Path(port))
            meta = session.meta
            self._created = _local(meta.get("created_utc"))
            self._created_s = float(meta.get("created_host_time_s") or 0.0)
            identifier, _ = identifier_of(session, self._database_path)
            self.analysis.use(identifier)
            worker = IdentificationWorker(identifier, self._estimated)
            items = recorded_items(session.records, dialect_of(session.meta))
            events = [item for item in items if isinstance(item, TimedEvent)]
            times = [event.host_time_s for event in events]
            self._begin_s = min(times, default=0.0)
            self._length_s = max(times, default=0.0) - self._begin_s
            hello = next((e.event for e in events if isinstance(e.event, Hello)), _NOBODY)
            whose = (str(meta.get("subject") or ""), str(meta.get("site") or ""))
            because = advised_curves(session)
            for_effect = frozenset(name for name, why in because.items() if why == MISSING_EFFECT)
            self._post(Connected(port, hello, visit=whose, for_effect=for_effect))
            if events:
                replay(session, identifier, [self._outbox.add, worker.listen], self.control)
            else:  # imported: there are curves, and nothing that came before them
                for index, curve in enumerate(session.curves, start=1):
                    self._outbox.add(CurveCompleted(index, curve, None, 0))
                    self._outbox.add(Identified(index, curve, identifier(curve)))
            self._outbox.flush()
            self._tell(ended=not self.control.stopped)
        finally:
            if worker is not None:
                worker.close()
            self._free.set()

    def _estimated(self, index: int, result: Identification) -> None:
        self._post(Estimated(index, result))

    def _moment(self) -> datetime | None:
        at_s = self.control.at_s
        if self._created is None or at_s is None:
            return self._created
        return self._created + timedelta(seconds=at_s - self._created_s)

    def _nap(self, seconds: float) -> None:
        self._outbox.flush()
        self._tell(ended=False)  # also where nothing was recorded for a while
        self._closing.wait(seconds)

    def _heard(self, news: News) -> None:
        self._post(news)
        self._tell(ended=False)

    def _tell(self, *, ended: bool) -> None:
        at_s = self.control.at_s
        done_s = 0.0 if at_s is None else at_s - self._begin_s
        now = Played(min(max(done_s, 0.0), self._length_s), self._length_s, ended)
        if now != self._told:
            self._told = now
            self._post(now)


def _local(text: object) -> datetime | None:
    """Return a time of a record in local time; None: it says none."""
    try:
        return datetime.fromisoformat(str(text)).astimezone()
    except ValueError:
        return None
