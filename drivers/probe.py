"""Probe: the only object that moves hardware."""

from __future__ import annotations

import atexit
import queue
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from drivers.capabilities import READ_ONLY
from drivers.dialect import Dialect
from drivers.dialects import DEFAULT, get_dialect, split_dialect, stream_of
from drivers.dose import Dose
from drivers.engine import Engine, Follow, OnBytes, Request
from drivers.errors import (
    DriverError,
    LinkError,
    LocalProtocolError,
    RemoteProtocolError,
    UnknownDialectError,
)
from drivers.events import (
    Abilities,
    Arm,
    Command,
    Event,
    Hello,
    Identify,
    InstrumentState,
    LinkRestored,
    Load,
    Loaded,
    Reset,
    Segment,
    Start,
    State,
    TimedEvent,
    VentConfirmed,
)
from drivers.guarded import guarded
from drivers.limits import DEFAULT_LIMITS, NO_ABILITIES, Limits, program_bounds
from drivers.link import Link, open_link
from drivers.onlooker import Onlooker
from drivers.stream import connect, follow_mark
from drivers.watchdog import Watchdog

__all__ = ["DEFAULTS", "DEFAULT_LIMITS", "Limits", "Probe"]

_LOAD_TIMEOUT_S = 60.0  # a simulated skin is computed while it loads
_JOIN_TIMEOUT_S = 5.0
_UNSETTLED = frozenset({InstrumentState.ARMED, InstrumentState.RUNNING, InstrumentState.VENTING})


@dataclass(slots=True)
class Defaults:
    """What holds for a probe that is told nothing else; a process may set it before it makes one.

    `clock` gives seconds and never goes back.
    """

    limits: Limits = DEFAULT_LIMITS
    clock: Callable[[], float] = time.monotonic
    open_timeout_s: float = 5.0
    command_timeout_s: float = 2.0


DEFAULTS = Defaults()


class Probe:
    """One suction probe at a port. Constructing is not connecting; every method is thread-safe.

    What happens comes out of `next_event`, the driver's own orders and alarms included. Leaving the
    `with` block, `close` and the end of the interpreter vent first.

    `on_bytes(direction, host_time_s, data)` sees every chunk, "rx" and "tx", in the I/O thread; if
    it raises, the probe vents and refuses to go on. Of an instrument that only streams it also sees
    a "mark" where the host decides what is a run. What is not given is as in `DEFAULTS`.

    dialect: one, or its name, or a file (`.toml`); None: what the URL says (`?dialect=NAME`), else
    `reference`. Raises UnknownDialectError for one that does not exist, or two, DialectFileError.
    """

    def __init__(
        self,
        url: str,
        *,
        dialect: str | Dialect | None = None,
        limits: Limits | None = None,
        clock: Callable[[], float] | None = None,
        open_link: Callable[[str], Link] = open_link,
        on_bytes: OnBytes | None = None,
    ) -> None:
        self.url = url
        self._port, self._dialect = choose_dialect(url, dialect)
        self._limits = limits = DEFAULTS.limits if limits is None else limits
        self._clock = DEFAULTS.clock if clock is None else clock
        self._open_link = open_link
        self._on_bytes = on_bytes
        # One for all connections, one after the other
        self._watchdog = Watchdog(limits) if self._controls else self._onlooker()
        self._events: queue.SimpleQueue[TimedEvent] = queue.SimpleQueue()
        self._calls = threading.RLock()  # one command at a time; vent and close go past it
        self._engine: Engine | None = None
        self._seen: Engine | None = None  # the last one, still good to read after close
        self._link: Link | None = None
        self._thread: threading.Thread | None = None
        self._verified = False  # the loaded program is the one that was asked for
        self._first_hello: Hello | None = None
        self._lost_at: float | None = None

    # ---- what is known ------------------------------------------------------------

    @property
    def dialect(self) -> Dialect:
        """What the instrument speaks."""
        return self._dialect

    @property
    def read_only(self) -> bool:
        """Whether the instrument only streams: it is never started from here."""
        return not self._controls

    @property
    def hello(self) -> Hello | None:
        """Who the instrument is; None before `open`."""
        engine = self._seen
        return None if engine is None else engine.connection.hello

    @property
    def abilities(self) -> Abilities:
        """What the instrument said that it can do besides."""
        engine = self._seen
        return NO_ABILITIES if engine is None else engine.connection.abilities

    @property
    def state(self) -> InstrumentState | None:
        """The instrument's state as it last said; None before `open`."""
        engine = self._seen
        return None if engine is None else engine.connection.state

    @property
    def alarm(self) -> str | None:
        """Text of the latched alarm, or None."""
        engine = self._seen
        return None if engine is None else engine.alarm

    @property
    def recording_error(self) -> str | None:
        """Why bytes are not recorded any more; nothing is started before it is open anew."""
        engine = self._seen
        return None if engine is None else engine.recording_error

    @property
    def dose(self) -> Dose:
        """Suction that the site has had: of all samples so far, and of what was carried over."""
        return self._watchdog.dose

    def carry_dose(self, dose: Dose) -> None:
        """Say, before anything is loaded, what the same site had in the same visit already."""
        self._watchdog.carry_dose(dose)

    @property
    def is_open(self) -> bool:
        """Whether the I/O thread runs; False again once the link is lost."""
        engine = self._seen
        return engine is not None and engine.ended is None

    @property
    def waiting(self) -> int:
        """How many events `next_event` has by now; an instrument may send faster than one reads."""
        return self._events.qsize()

    def next_event(self, timeout_s: float | None = None) -> TimedEvent | None:
        """Give the next event in order, or None if none came in `timeout_s` (None: wait for ever).

        Events stay readable after the link was lost and after `close`.
        """
        try:
            if timeout_s is not None and timeout_s <= 0:
                return self._events.get_nowait()
            return self._events.get(timeout=timeout_s)
        except queue.Empty:
            return None

    # ---- commands ------------------------------------------------------------

    def open(self, timeout_s: float | None = None) -> Hello:
        """Connect and identify. An instrument that is found armed or running is vented first.

        Raises LinkError (no port, no answer), RemoteProtocolError (another protocol version),
        LocalProtocolError (open already).
        """
        with self._calls:
            if self._engine is not None:
                raise LocalProtocolError(f"{self.url} is open already")
            self._link = self._open_link(self._port)
            if self._seen is not None:
                self._watchdog.reconnected(self._clock())
            engine = Engine(
                self._link,
                connect(self._dialect, self._limits),
                self._clock,
                self._events.put,
                self._on_bytes,
                self._watchdog,
            )
            self._verified = False
            thread = threading.Thread(target=engine.run, name=f"probe {self.url}", daemon=True)
            thread.start()
            # Who closes or vents meanwhile finds an engine that runs, or none.
            self._thread, self._seen, self._engine = thread, engine, engine
            atexit.register(self.close)
            try:
                wait_s = DEFAULTS.open_timeout_s if timeout_s is None else timeout_s
                hello = self._meet(engine, wait_s)
            except BaseException:
                self.close()
                raise
            self._first_hello = self._first_hello or hello
            return hello

    def reopen(self, timeout_s: float = 2.0) -> Hello:
        """Connect again after the link was lost, to the same instrument. LinkRestored follows.

        The program that was loaded is gone; a latched alarm stays, and a vent that nobody could see
        is confirmed now (VentConfirmed) or raises the alarm again. Raises LinkError (still gone),
        RemoteProtocolError (another instrument than before, or another protocol version).
        """
        with self._calls:
            lost_at = None if self._seen is None else self._seen.lost_at
            self._lost_at = self._lost_at if lost_at is None else lost_at
            self.close()
            hello = self.open(timeout_s)
            first = self._first_hello
            if first is not None and _identity(first) != _identity(hello):
                self.close()
                raise RemoteProtocolError(
                    f"another instrument is at {self.url} now: {_who(hello)}; it was {_who(first)}"
                )
            now = self._clock()
            outage_s = 0.0 if self._lost_at is None else now - self._lost_at
            self._lost_at = None
            self._events.put(TimedEvent(now, LinkRestored(outage_s)))
            return hello

    def load(self, segments: Sequence[Segment], rate_hz: float) -> Loaded:
        """Load a program, with the bounds that it needs, and compare what is read back.

        segments: in order; rate_hz: samples a second. Returns what the instrument will do: what was
        asked for, to the resolution of the wire. Raises LocalProtocolError (a limit, or the state),
        InstrumentRefusedError, LinkError, RemoteProtocolError (the read-back differs; vented),
        BrokenDialectError.
        """
        with self._calls:
            self._check_controls("load")
            self._verified = False
            bounds = program_bounds(segments)
            load = Load(tuple(segments), rate_hz, bounds.max_pressure_mbar, bounds.max_suction_s)
            # As the wire carries it, which refuses here what it cannot carry: that is what is
            # read back, and what the watchdog follows
            speaks = guarded(self._dialect)
            asked, _ = speaks.decode_command(speaks.encode_command(load, 0))
            answer = self._call(
                asked,
                lambda event: isinstance(event, Loaded),
                _is_state(InstrumentState.LOADED),
                timeout_s=_LOAD_TIMEOUT_S,
            )
            loaded = next(event for event in answer if isinstance(event, Loaded))
            if not isinstance(asked, Load) or loaded != _read_back(asked):
                self.vent("read-back differs from the program that was sent")
                raise RemoteProtocolError(
                    f"the instrument read back another program than was sent: {loaded}"
                )
            self._verified = True
            return loaded

    def arm(self) -> None:
        """Make ready to start; keep-alive runs from here on.

        Raises LocalProtocolError (no program of ours is loaded, an alarm is latched),
        InstrumentRefusedError, LinkError.
        """
        with self._calls:
            self._check_controls("arm")
            if not self._verified:
                raise LocalProtocolError("load a program first")
            self._call(Arm(), _is_state(InstrumentState.ARMED))

    def start(self) -> None:
        """Run the loaded program once; samples come as events. To repeat: arm and start again.

        Raises LocalProtocolError (not armed), InstrumentRefusedError, LinkError.
        """
        with self._calls:
            self._check_controls("start")
            self._call(Start(), _is_state(InstrumentState.RUNNING))

    def follow(self, segments: Sequence[Segment] | None = None) -> None:
        """Wait for one run of an instrument that only streams, which somebody starts there.

        segments: its program, where it is known: the run then ends with it. State (running) follows
        once the pressure leaves zero, samples, and State (idle) at the end. Returns at once.
        Raises LocalProtocolError (an alarm is latched, it is no such instrument), LinkError.
        """
        with self._calls:
            if self._controls:
                raise LocalProtocolError("follow is for instruments that only stream")
            self._call(Follow(follow_mark(segments)))

    def reset(self) -> None:
        """Acknowledge a fault of the instrument, or drop its program: it becomes idle.

        Raises LocalProtocolError (state), InstrumentRefusedError (the cause persists), LinkError.
        """
        with self._calls:
            self._check_controls("reset")
            self._verified = False
            self._call(Reset(), _is_state(InstrumentState.IDLE))

    def vent(self, reason: str = "operator") -> None:
        """Open the valve before anything else is done. Returns at once, in every state.

        HostVented follows when it was sent, VentConfirmed when the pressure fell, Alarm if it did
        not. Without a link it does nothing: LinkLost has said so. An instrument that only streams
        is no longer followed; it is told to vent only where its dialect has a command for it.
        """
        engine = self._engine
        if engine is not None:
            engine.order_vent(reason)

    def acknowledge_alarm(self) -> None:
        """Unlatch the alarm; it comes back if its cause is still there."""
        engine = self._seen
        if engine is not None:
            engine.acknowledge()

    def close(self) -> None:
        """Vent, wait up to 1 s for the pressure to fall, let go of the port. Raises nothing."""
        engine, self._engine = self._engine, None
        if engine is None:
            return
        atexit.unregister(self.close)
        try:
            confirmed = engine.submit(
                Request(None, [_is_confirmed], self._limits.vent_time_s + 0.1)
            )
            engine.order_vent("close")
            if self._controls and engine.connection.hello is not None:  # else nobody confirms
                confirmed.result(_JOIN_TIMEOUT_S)
        except (DriverError, TimeoutError):
            pass  # the event stream has said why
        finally:
            engine.stop()
            if self._thread is not None:
                self._thread.join(_JOIN_TIMEOUT_S)
            if self._link is not None:
                self._link.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    # ---- inside ------------------------------------------------------------

    @property
    def _controls(self) -> bool:
        return self._dialect.capabilities.controllable

    def _onlooker(self) -> Onlooker:
        silent_s = stream_of(self._dialect).silent_s
        can_vent = self._dialect.capabilities.vent
        return Onlooker(self._limits, can_vent=can_vent, silent_s=silent_s)

    def _check_controls(self, what: str) -> None:
        if not self._controls:
            raise LocalProtocolError(f"cannot {what}: {READ_ONLY}")

    def _meet(self, engine: Engine, timeout_s: float) -> Hello:
        is_state = _is_state(*InstrumentState)
        answer = self._call(
            Identify(), lambda event: isinstance(event, Hello), is_state, timeout_s=timeout_s
        )
        hello = next(event for event in answer if isinstance(event, Hello))
        state = next(event for event in answer if isinstance(event, State))
        if state.state in _UNSETTLED:
            settled = _is_state(*(set(InstrumentState) - _UNSETTLED))
            wait = engine.submit(Request(None, [settled], timeout_s))
            engine.order_vent(f"found {state.state} when opened")
            wait.result()
        return hello

    def _call(
        self,
        command: Command | Follow,
        *wanted: Callable[[Event], bool],
        timeout_s: float | None = None,
    ) -> list[Event]:
        engine = self._engine
        if engine is None:
            raise LinkError(f"{self.url} is not open")
        if timeout_s is None:
            timeout_s = DEFAULTS.command_timeout_s
        return engine.submit(Request(command, list(wanted), timeout_s)).result()


def choose_dialect(url: str, dialect: str | Dialect | None = None) -> tuple[str, Dialect]:
    """Give a port without its `dialect=NAME`, and the dialect that is meant.

    Raises UnknownDialectError (none, two different ones, or one that is not spoken there),
    DialectFileError.
    """
    port, named = split_dialect(url)
    if dialect is not None and not isinstance(dialect, str):
        found = dialect
    elif named is not None and dialect is not None and named != dialect:
        raise UnknownDialectError(f"{url} says dialect {named!r}, and {dialect!r} was asked for")
    else:
        found = get_dialect(dialect or named or DEFAULT)
    if port.startswith("sim:") and found.name != DEFAULT:
        raise UnknownDialectError(
            f"{port}: the simulated probe speaks {DEFAULT}, and not dialect {found.name!r}; leave "
            "the dialect out, or name the instrument's port"
        )
    return port, found


def _identity(hello: Hello) -> tuple[str, str, float | None]:
    return hello.model, hello.serial_number, hello.aperture_mm


def _who(hello: Hello) -> str:
    opening = "" if hello.aperture_mm is None else f", {hello.aperture_mm:g} mm"
    return f"{hello.model} {hello.serial_number}{opening}"


def _is_state(*states: InstrumentState) -> Callable[[Event], bool]:
    return lambda event: isinstance(event, State) and event.state in states


def _is_confirmed(event: Event) -> bool:
    return isinstance(event, VentConfirmed)


def _read_back(load: Load) -> Loaded:
    return Loaded(load.segments, load.rate_hz, load.max_pressure_mbar, load.max_suction_s)
