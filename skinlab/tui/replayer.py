"""A recorded session in the place of a probe: the same news for the same screens."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

from drivers.events import Hello, TimedEvent
from skinlab.acquisition.replay_control import ReplayControl
from skinlab.errors import AcquisitionError
from skinlab.recording.stream import CurveCompleted, Identified, Message
from skinlab.tui.identification_worker import Analyst
from skinlab.tui.messages import Connected, News, Played
from skinlab.tui.probe_session import Bench

_MOST_MESSAGES = 200  # of one post
_NOBODY = Hello("", 0, "recording", "", "", 0.0, 0.0, 0.0, 0.0, 0.0, simulated=False)


_SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 50.0)


def next_speed(speed: float | None, *, faster: bool) -> float | None:
    """Return the next speed up or down; None is without waiting."""
    if speed is None:
        return None if faster else _SPEEDS[-1]
    if faster:
        return next((s for s in _SPEEDS if s > speed), None)
    return next((s for s in reversed(_SPEEDS) if s < speed), _SPEEDS[0])


def example_session() -> Path:
    """Return the recorded example that is shipped."""
    return Path(__file__).parents[1] / "data" / "example.h5"


class Replayer(Bench):
    """Plays a session; nothing moves, and nothing is written."""

    def __init__(
        self, folder: Path, post: Callable[[News], None], speed: float | None = 1.0
    ) -> None:
        super().__init__(folder, post)
        self.control = ReplayControl(speed, sleep=self._nap)
        self._speed = speed
        self._begin_s = self._length_s = 0.0
        self._created: datetime | None = None  # in local time
        self._created_s = 0.0  # the same by the clock of the record

    def again(self) -> None:
        """Be ready to play from the beginning."""
        self.control = ReplayControl(self._speed, sleep=self._nap)

    def vent(self, reason: str) -> None:
        """Count it: there is nothing to vent."""
        self._vents += 1

    def audit(self, what: str, **detail: object) -> None:
        """Refuse: a record is never changed.

        Raises:
            AcquisitionError: always.
        """
        raise AcquisitionError("this is a replay: what you decide here is not recorded")

    def close(self) -> None:
        """Stop."""
        self._vents += 1
        self.control.stop()
        self._closing.set()
        self._free.wait()
        self._explain.cancel()

    def serve(self, port: str, *, anew: bool = False) -> None:
        """Play the session in the file `port` until its end, or until it is closed.

        Raises:
            InputError: it cannot be read.
        """
        from skinlab.acquisition.replay import identifier_of, replay
        from skinlab.recording.recorded import dialect_of, recorded_items
        from skinlab.recording.session import read_session

        del anew  # every replay is
        self._free.clear()
        self._closing.clear()
        self._messages = []
        analyst: Analyst | None = None
        try:
            session = read_session(Path(port))
            meta = session.meta
            self._created = _local(meta.get("created_utc"))
            self._created_s = float(meta.get("created_host_time_s") or 0.0)
            self._identifier, _ = identifier_of(session)
            analyst = Analyst(self._identifier, self._estimated)
            events = [
                i
                for i in recorded_items(session.records, dialect_of(session.meta))
                if isinstance(i, TimedEvent)
            ]
            times = [event.host_time_s for event in events]
            self._begin_s = min(times, default=0.0)
            self._length_s = max(times, default=0.0) - self._begin_s
            hello = next((e.event for e in events if isinstance(e.event, Hello)), _NOBODY)
            whose = (str(meta.get("subject") or ""), str(meta.get("site") or ""))
            self._post(Connected(port, hello, visit=whose))
            if events:
                replay(session, self._identifier, [self._note, analyst.listen], self.control)
            else:  # imported: there are curves, and nothing that came before them
                for index, curve in enumerate(session.curves, start=1):
                    self._note(CurveCompleted(index, curve, None, 0))
                    self._note(Identified(index, curve, self._identifier(curve)))
            self._flush()
            self._tell(ended=not self.control.stopped)
        finally:
            if analyst is not None:
                analyst.close()
            self._free.set()

    def _note(self, message: Message) -> None:
        self._messages.append(message)
        if isinstance(message, CurveCompleted) or len(self._messages) >= _MOST_MESSAGES:
            self._flush()

    def _moment(self) -> datetime | None:
        at_s = self.control.at_s
        if self._created is None or at_s is None:
            return self._created
        return self._created + timedelta(seconds=at_s - self._created_s)

    def _nap(self, seconds: float) -> None:
        self._flush()
        self._closing.wait(seconds)

    def _flush(self) -> None:
        if self._messages:
            super()._flush()
            self._tell(ended=False)

    def _tell(self, *, ended: bool) -> None:
        at_s = self.control.at_s
        done_s = 0.0 if at_s is None else at_s - self._begin_s
        self._post(Played(min(max(done_s, 0.0), self._length_s), self._length_s, ended))


def _local(text: object) -> datetime | None:
    """Return a time of a record in local time; None: it says none."""
    try:
        return datetime.fromisoformat(str(text)).astimezone()
    except ValueError:
        return None
