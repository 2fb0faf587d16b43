"""The I/O loop of a probe: owns link, connection and watchdog; one thread runs it.

Everything that goes wrong in it vents, and becomes an event in the same stream.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from dataclasses import dataclass, field

from drivers.connection import Connection
from drivers.errors import (
    BrokenDialectError,
    DriverError,
    InstrumentRefusedError,
    LinkError,
    LocalProtocolError,
    RemoteProtocolError,
)
from drivers.events import (
    Alarm,
    Arm,
    Command,
    Event,
    HostVented,
    Identify,
    InstrumentFault,
    InstrumentState,
    KeepAlive,
    LinkLost,
    Load,
    Refused,
    Start,
    State,
    TimedEvent,
    Vent,
)
from drivers.link import Link
from drivers.onlooker import Onlooker
from drivers.stream import StreamConnection, lost_mark, stop_mark
from drivers.watchdog import SafetyEvent, Watchdog

OnBytes = Callable[[str, float, bytes], None]

_READ_BYTES = 1 << 16  # more than comes in a second: behind a read nothing old is waiting
_READ_S = 0.01  # also how long an order to vent may wait
_RESEND_S = 0.5  # a lost command is sent again; its number keeps it from being done twice
_VENT_RESEND_S = 0.1  # until the instrument answers; later once a second while not confirmed
_DONE_S = 0.5  # from a vent that was seen to the instrument's word that it is done
_NOBODY = ": is the instrument on, and are port, speed and dialect right?"
_MAX_FAILURES = 3  # of the loop itself, before it gives up

_PULLING = frozenset({InstrumentState.ARMED, InstrumentState.RUNNING})


@dataclass(frozen=True, slots=True)
class Follow:
    """Wait for a curve of an instrument that only streams; not a word of it goes out."""

    mark: bytes


_MOVES = (Load, Arm, Start, Follow)


@dataclass(slots=True, eq=False)
class Request:
    """A command, or none, and the events that together are its answer, in any order."""

    command: Command | Follow | None
    wanted: list[Callable[[Event], bool]]
    timeout_s: float
    answer: Future[list[Event]] = field(default_factory=Future)
    _got: list[Event] = field(default_factory=list)
    _frame: bytes = b""
    _deadline: float = 0.0
    _resend_at: float = 0.0

    @property
    def name(self) -> str:
        """What to call it in a message."""
        return "the vent" if self.command is None else type(self.command).__name__

    def take(self, event: Event) -> None:
        """Use `event` for the answer if it belongs there."""
        for index, wants in enumerate(self.wanted):
            if wants(event):
                del self.wanted[index]
                self._got.append(event)
                break
        if not self.wanted:
            self._settle(None)

    def fail(self, error: DriverError) -> None:
        """End without an answer."""
        self._settle(error)

    def _settle(self, error: DriverError | None) -> None:
        if self.answer.done():
            return
        if error is None:
            self.answer.set_result(self._got)
        else:
            self.answer.set_exception(error)


class Engine:
    """Moves bytes between a link and a connection, and keeps watch.

    `run` belongs to one thread; `submit`, `order_vent`, `acknowledge` and `stop` to any.
    """

    def __init__(
        self,
        link: Link,
        connection: Connection | StreamConnection,
        clock: Callable[[], float],
        post: Callable[[TimedEvent], None],
        on_bytes: OnBytes | None,
        watchdog: Watchdog | Onlooker,
    ) -> None:
        self._link = link
        self._connection = connection
        self._clock = clock
        self._post_timed = post
        self._on_bytes = on_bytes
        self._watchdog = watchdog
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        # shared between threads, under the lock
        self._queue: deque[Request] = deque()
        self._vent_reasons: deque[str] = deque()
        self._ended: str | None = None
        self._lost_at: float | None = None
        # of the I/O thread
        self._pending: list[Request] = []
        self._keep_alive_at = 0.0
        self._vent_at = 0.0
        self._ask_at = 0.0
        self._vent_answered = True
        self._heard_at = 0.0
        self._tap_error: str | None = None

    @property
    def connection(self) -> Connection | StreamConnection:
        """Read its `state` and `hello` only."""
        return self._connection

    @property
    def alarm(self) -> str | None:
        """Text of the latched alarm, or None."""
        return self._watchdog.alarm

    @property
    def recording_error(self) -> str | None:
        """Why bytes are not recorded any more, or None; nothing is started over this link then."""
        return self._tap_error

    @property
    def lost_at(self) -> float | None:
        """When the link was lost, or None if it was not."""
        return self._lost_at

    @property
    def ended(self) -> str | None:
        """Why the loop is over, or None while it runs."""
        return self._ended

    # ---- from any thread ------------------------------------------------------------

    def submit(self, request: Request) -> Future[list[Event]]:
        """Queue a request; its future is always settled. Raises LinkError once the loop is over."""
        with self._lock:
            if self._ended is not None:
                raise LinkError(self._ended)
            self._queue.append(request)
        return request.answer

    def order_vent(self, reason: str) -> None:
        """Vent before anything else is sent, and drop all that waits."""
        with self._lock:
            self._vent_reasons.append(reason)

    def acknowledge(self) -> None:
        """Unlatch the alarm; where its cause persists, the next step raises it again."""
        self._watchdog.acknowledge()

    def stop(self) -> None:
        """Let `run` return soon."""
        self._stopping.set()

    # ---- the I/O thread ------------------------------------------------------------

    def run(self) -> None:
        """Do steps until stopped or the link is lost. Raises nothing."""
        failures = 0
        reason = "the probe was closed"
        try:
            while not self._stopping.is_set():
                try:
                    self.step()
                except LinkError as error:
                    reason = str(error)
                    self._lost(reason)
                    return
                except Exception as error:  # noqa: BLE001 -- whatever it is: vent and say so
                    failures += 1
                    told = isinstance(error, BrokenDialectError)
                    reason = str(error) if told else f"driver failed: {error!r}"
                    if not self._vent_after(error, reason) or failures > _MAX_FAILURES:
                        self._lost(reason)
                        return
            if self._vent_reasons:
                self._send_due()  # an order that came with the stop
        except LinkError as error:
            reason = str(error)
        finally:
            self._end(reason)

    def step(self) -> None:
        """Send what is due, read once, judge. Raises LinkError.

        The silence is judged up to where the read began. A busy machine may stop this thread at any
        moment: what came while it stood is not read yet, and is no silence of the instrument.
        """
        self._send_due()
        now = self._clock()
        data = self._link.read(_READ_BYTES, _READ_S)
        if data:
            self._heard_at = self._clock()
            self._tap("rx", self._heard_at, data)
            self._feed(data)
        if isinstance(self._connection, StreamConnection):
            self._look_at_stream(self._connection, now)
        self._apply(self._watchdog.check(now), self._clock())
        for request in self._pending:
            if now > request._deadline:
                what = f"no answer to {request.name} in {request.timeout_s:g} s"
                unknown = isinstance(request.command, Identify)
                request.fail(LinkError(what + (_NOBODY if unknown else "")))
        self._forget_settled()

    def _send_due(self) -> None:
        now = self._clock()
        sent = self._send_vents(now)
        if self._watchdog.ordered and not sent and now >= self._vent_at:
            self._write_vent(now)
        if self._connection.keeps_alive and now >= self._keep_alive_at:
            self._write(self._connection.send(KeepAlive()))
            interval_s = self._connection.keep_alive_s
            due = self._keep_alive_at + interval_s  # no drift by late turns
            self._keep_alive_at = due if due > now else now + interval_s
        self._ask_whether_done(now)
        for request in self._pending:
            if request._frame and now >= request._resend_at:
                self._write(request._frame)
                request._resend_at = now + _RESEND_S
        with self._lock:
            queued = list(self._queue)
            self._queue.clear()
        try:
            while queued:
                self._begin(queued.pop(0), now)
        finally:
            self._pending += queued  # one that failed leaves the others waiting, and not forgotten

    def _ask_whether_done(self, now: float) -> None:
        """Ask for the state where a vent was seen and nothing said so: the frame may be lost."""
        connection, watchdog = self._connection, self._watchdog
        venting = connection.state is InstrumentState.VENTING
        over = venting and isinstance(watchdog, Watchdog) and watchdog.at_rest
        if not over or not isinstance(connection, Connection):
            self._ask_at = now + _DONE_S
        elif now >= self._ask_at:
            self._write(connection.send(Identify()))
            self._ask_at = now + _DONE_S

    def _begin(self, request: Request, now: float) -> None:
        request._deadline = now + request.timeout_s
        request._resend_at = now + _RESEND_S
        if isinstance(request.command, Follow):
            self._follow(request, request.command, now)
        elif request.command is not None:
            try:
                if isinstance(request.command, _MOVES):
                    self._check_move(request.command)
                request._frame = self._connection.send(request.command)
                self._watchdog.commanded(request.command, now)
            except LocalProtocolError as error:
                request.fail(error)
                return
            except BrokenDialectError as error:  # nothing was sent; who waits is told, and it vents
                request.fail(error)
                raise
            self._pending.append(request)
            self._write(request._frame)
        else:
            self._pending.append(request)

    def _follow(self, request: Request, follow: Follow, now: float) -> None:
        try:
            self._check_latched()
            self._mark(follow.mark, now)
        except DriverError as error:
            request.fail(error)
        else:
            request._settle(None)

    def _mark(self, mark: bytes, now: float) -> None:
        """Note in the record what the host decides about a stream, and do it."""
        if not isinstance(self._connection, StreamConnection):
            raise LocalProtocolError("this instrument knows of its runs by itself")
        self._tap("mark", now, mark)
        self._connection.mark(mark)
        self._heard_at = now
        self._feed(b"")

    def _look_at_stream(self, connection: StreamConnection, now: float) -> None:
        self._feed(b"")  # what it says without a byte of the instrument
        running = connection.state is InstrumentState.RUNNING
        if running and now - self._heard_at > connection.silent_s:
            self._mark(stop_mark(f"nothing came for {connection.silent_s:g} s"), now)

    def _check_move(self, command: Command) -> None:
        self._check_latched()
        if isinstance(command, Arm | Start) and self._watchdog.ordered:
            # What was asked for before the vent may come behind it, and be legal until the answer
            raise LocalProtocolError(
                f"{type(command).__name__} is not allowed: a vent was ordered and is not over"
            )
        refusal = self._watchdog.refusal(command)
        if refusal is not None:
            raise LocalProtocolError(refusal)

    def _check_latched(self) -> None:
        if self._watchdog.alarm is not None:
            raise LocalProtocolError(f"acknowledge the alarm first ({self._watchdog.alarm})")
        if self._tap_error is not None:
            raise LocalProtocolError(f"{self._tap_error}; close the probe and open it again")

    def _feed(self, data: bytes) -> None:
        now = self._clock()
        try:
            self._connection.receive_data(data, now)
        except RemoteProtocolError as error:
            self._blame(error, now)
        while True:
            self._vent_meanwhile()
            try:
                event = self._connection.next_event()
            except RemoteProtocolError as error:
                self._blame(error, now)
                continue
            if event is None:
                return
            self._deliver(event, now)

    def _vent_meanwhile(self) -> None:
        """Send a vent that was ordered while a dialect is slow with what came before.

        Not of a stream, whose record says between which bytes it was ordered.
        """
        if self._vent_reasons and isinstance(self._connection, Connection):
            self._send_vents(self._clock())

    def _send_vents(self, now: float) -> bool:
        with self._lock:
            reasons = list(self._vent_reasons)
            self._vent_reasons.clear()
        for reason in reasons:
            self._vent(reason, now)
        return bool(reasons)

    def _deliver(self, event: Event, now: float) -> None:
        self._post(event, now)
        self._apply(self._watchdog.on_event(event, now), now)
        if isinstance(event, State) and event.state not in _PULLING:
            self._vent_answered = True
        for request in self._pending:
            problem = _problem(request, event)
            if problem is None:
                request.take(event)
            else:
                request.fail(problem)
        self._forget_settled()

    def _apply(self, events: Iterable[SafetyEvent], now: float) -> None:
        for event in events:
            if isinstance(event, HostVented):
                self._vent(event.reason, now)
            else:
                self._deliver(event, now)

    def _vent(self, reason: str, now: float) -> None:
        """Send Vent first of all, then say so, then drop what else was on its way."""
        if self._connection.can_vent:
            self._write_vent(now, answered=False)
            self._post(HostVented(reason), now)
        if isinstance(self._connection, StreamConnection):
            self._mark(stop_mark(reason), now)
        abandoned = [r for r in self._pending if isinstance(r.command, _MOVES)]
        with self._lock:
            abandoned += [r for r in self._queue if isinstance(r.command, _MOVES)]
        for request in abandoned:
            request.fail(LocalProtocolError(f"{request.name} was abandoned: vent ({reason})"))
        with self._lock:
            self._queue = deque(r for r in self._queue if not r.answer.done())
        self._forget_settled()

    def _write_vent(self, now: float, *, answered: bool | None = None) -> None:
        if answered is not None:
            self._vent_answered = answered
        data = self._connection.send(Vent())
        self._watchdog.vent_ordered(now)  # before the write: it counts even where that fails
        self._vent_at = now + (1.0 if self._vent_answered else _VENT_RESEND_S)
        self._write(data)

    def _write(self, data: bytes) -> None:
        if not data:
            return
        self._link.write(data)
        self._tap("tx", self._clock(), data)

    def _tap(self, direction: str, now: float, data: bytes) -> None:
        if self._on_bytes is None:
            return
        try:
            self._on_bytes(direction, now, data)
        except Exception as error:  # noqa: BLE001 -- it is the caller's code; vent and say so
            self._on_bytes = None
            self._tap_error = f"recording the bytes failed: {str(error) or repr(error)}"
            self._vent(self._tap_error, now)

    # ---- when it goes wrong ------------------------------------------------------------

    def _blame(self, error: RemoteProtocolError, now: float) -> None:
        for request in self._pending:
            request.fail(error)
        self._forget_settled()
        if not self._watchdog.venting:
            self._vent(f"protocol error: {error}", now)

    def _vent_after(self, error: Exception, reason: str) -> bool:
        """Vent after an exception of the loop; False if even that fails."""
        for request in self._pending:
            request.fail(error if isinstance(error, DriverError) else DriverError(reason))
        self._forget_settled()
        try:
            self._vent(reason, self._clock())
        except Exception:  # noqa: BLE001 -- the first failure is the one that is reported
            return False
        return True

    def _lost(self, reason: str) -> None:
        now = self._lost_at = self._clock()
        behind: list[Event] = []
        try:
            if isinstance(self._connection, StreamConnection):
                behind = self._end_stream(self._connection, reason, now)
        except Exception as error:  # noqa: BLE001 -- the loss is told, whatever else goes wrong
            reason = f"{reason}; driver failed: {error!r}"
        self._post(LinkLost(reason), now)
        for event in self._watchdog.link_lost():
            if isinstance(event, Alarm):
                self._post(event, now)
        for other in behind:
            self._deliver(other, now)

    def _end_stream(self, connection: StreamConnection, reason: str, now: float) -> list[Event]:
        """Mark the loss, and deliver what comes before it: readings that were held back.

        Returns what comes behind it, from where the run is said to be cut. A replay, which has the
        mark only, ends the curve with the same reading.
        """
        self._tap("mark", now, lost_mark(reason))
        connection.mark(lost_mark(reason))
        behind: list[Event] = []
        # The mark drops the bytes, so that a dialect that broke down at them is asked for none
        while (event := connection.next_event()) is not None:
            if behind or event == State(InstrumentState.IDLE, reason):
                behind.append(event)
            else:
                self._deliver(event, now)
        return behind

    def _end(self, reason: str) -> None:
        with self._lock:
            self._ended = reason
            waiting = [*self._pending, *self._queue]
            self._queue.clear()
        for request in waiting:
            request.fail(LinkError(reason))

    def _post(self, event: Event, now: float) -> None:
        self._post_timed(TimedEvent(now, event))

    def _forget_settled(self) -> None:
        self._pending = [request for request in self._pending if not request.answer.done()]


def _problem(request: Request, event: Event) -> DriverError | None:
    """Give the reason for which `event` means that `request` will not be done, if it does."""
    command = request.command
    if command is None or isinstance(command, Identify):
        return None
    match event:
        case Refused():
            return InstrumentRefusedError(f"{event.command} was refused: {event.reason}")
        case InstrumentFault() if isinstance(command, _MOVES):
            return InstrumentRefusedError(f"instrument fault {event.code}: {event.text}")
        case State(InstrumentState.FAULT | InstrumentState.VENTING) if isinstance(command, _MOVES):
            return InstrumentRefusedError(
                f"{request.name} was not done: the instrument is {event.state} ({event.reason})"
            )
        case _:
            return None
