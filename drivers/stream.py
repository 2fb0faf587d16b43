"""Sans-I/O conversation with an instrument that only streams: readings in, runs out.

To all that comes behind it, it looks like `Connection`: it says Hello, and that the instrument runs
or is idle; but it is this side that finds out, by the rule of `Stream`. What the host decides (from
now on a curve is waited for; no more) are marks. They are recorded between the bytes, so that the
same record gives the same runs, without a clock.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence

from drivers.capabilities import READ_ONLY, Stream
from drivers.connection import Connection
from drivers.dialect import Dialect
from drivers.dialects import stream_of
from drivers.errors import LocalProtocolError, RemoteProtocolError
from drivers.events import (
    PROGRAM_DONE,
    Abilities,
    Command,
    Damaged,
    Gap,
    Hello,
    Identify,
    InstrumentEvent,
    InstrumentFault,
    InstrumentState,
    KeepAlive,
    Reading,
    Sample,
    Segment,
    SegmentKind,
    State,
    Vent,
)
from drivers.incoming import Incoming
from drivers.limits import DEFAULT_LIMITS, NO_ABILITIES, Limits

_HELD_S = 10.0  # between zero and `begin_mbar`; what stays there for longer begins no run
_Held = tuple[float, int, Reading, float | None]  # time, count, reading, host's time of it
_MICRO = 6  # digits of times: sums of floats end a little off
_WORD, _STOP, _LOST = b"follow", b"stop", b"lost"


def follow_mark(segments: Sequence[Segment] | None) -> bytes:
    """Mark from which on a curve is waited for, of this program where it is known."""
    ends: list[float] = []
    longest_zero_s = target = time_s = zero_s = 0.0
    for segment in segments or ():
        step_s = segment.duration_s
        if segment.kind in {SegmentKind.RAMP, SegmentKind.UNTIL}:
            step_s = abs(segment.target_mbar - target) / segment.rate_mbar_per_s
        before, target = target, segment.target_mbar
        if segment.kind is SegmentKind.HOLD:
            target = before
        zero_s = zero_s + step_s if target == 0 else 0.0
        longest_zero_s = max(longest_zero_s, zero_s)
        time_s += step_s
        ends.append(round(time_s, _MICRO))
    return b" ".join([_WORD, *(repr(x).encode() for x in [longest_zero_s, *ends])])


def stop_mark(reason: str) -> bytes:
    """Mark from which on no curve is waited for; one that is under way ends there."""
    return _STOP + b" " + reason.encode("utf-8", "replace")


def lost_mark(reason: str) -> bytes:
    """Mark of a lost link: as `stop_mark`, and the bytes behind it begin anew."""
    return _LOST + b" " + reason.encode("utf-8", "replace")


class StreamConnection(Incoming):
    """The host's side of an instrument that only streams; used as `Connection` is."""

    def __init__(self, dialect: Dialect, limits: Limits = DEFAULT_LIMITS) -> None:
        super().__init__(dialect)
        self._rule: Stream = stream_of(dialect)
        self._hello = _hello(dialect, self._rule, limits)
        self._state = InstrumentState.IDLE
        self._vented = False  # a vent was asked for, so that nothing is kept alive
        self._following = False
        self._ends: tuple[float, ...] = ()  # of the program's segments, s; empty: not known
        self._zero_s = self._rule.zero_s
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Know nothing of the instrument's clock and count."""
        self._damaged = 0  # lines that are counted as readings, where the instrument does not count
        self._count = 0
        self._last: tuple[float, int] | None = None  # time and count of the last reading
        self._origin: tuple[float, int] | None = None  # of the last run
        self._due: int | None = None
        self._step_s = 0.0
        self._seen_zero = False
        self._held: list[_Held] = []  # not yet known to be of a run, or not

    @property
    def state(self) -> InstrumentState | None:
        """Whether a run is under way, as far as the pressure shows."""
        return self._state

    @property
    def hello(self) -> Hello | None:
        """What its dialect says of the instrument."""
        return self._hello

    @property
    def abilities(self) -> Abilities:
        """None: it takes no programs."""
        return NO_ABILITIES

    @property
    def keeps_alive(self) -> bool:
        """Whether the instrument is to hear a keep-alive now."""
        return self._dialect.capabilities.keep_alive and not self._vented

    @property
    def keep_alive_s(self) -> float:
        """Time between two keep-alives."""
        return self._rule.keep_alive_s

    @property
    def can_vent(self) -> bool:
        """Whether there is a command for it."""
        return self._dialect.capabilities.vent

    @property
    def silent_s(self) -> float:
        """For how long nothing has to come, before a run is over."""
        return max(self._rule.silent_s, 3 * self._step_s)

    def _miss(self) -> None:
        self._damaged += 1

    def send(self, command: Command) -> bytes:
        """Bytes of `command`; none where there is nothing to say.

        Raises LocalProtocolError for what could begin suction, and for what it cannot do.
        """
        match command:
            case Identify():  # nobody is asked
                self._ready += [self._hello, State(self._state, "connected")]
                return b""
            case Vent() if self.can_vent:
                self._vented = True
                return self._dialect.encode_command(command, 0)
            case KeepAlive() if self._dialect.capabilities.keep_alive:
                return self._dialect.encode_command(command, 0)
            case _:
                raise LocalProtocolError(f"{type(command).__name__} is not allowed: {READ_ONLY}")

    def mark(self, data: bytes) -> None:
        """Take note of what the host decided: `follow_mark`, `stop_mark` or `lost_mark`.

        Raises RemoteProtocolError for what is none of them (in a record that is damaged).
        """
        word, _, rest = data.partition(b" ")
        if word == _WORD:
            try:
                zero_s, *ends = (float(x) for x in rest.split())
            except ValueError:
                raise RemoteProtocolError(f"{data[:40]!r} is not a mark") from None
            self._stop("another curve is waited for")
            self._following, self._vented, self._seen_zero = True, False, False
            self._say(InstrumentState.ARMED, "waits for the pressure to leave zero")
            self._ends = tuple(ends)
            self._zero_s = self._rule.zero_s + zero_s
        elif word in {_STOP, _LOST}:
            self._stop(rest.decode("utf-8", "replace"))
            if word == _LOST:
                self._buffer.clear()
                self._begin_anew()
        else:
            raise RemoteProtocolError(f"{data[:40]!r} is not a mark")

    # ---- what a reading means ---------------------------------------------------------------

    def _judge(self, event: InstrumentEvent, number: int | None, frame: bytes) -> None:
        match event:
            case Reading():
                self._take(event, frame)
            case Sample():
                self._take(
                    Reading(
                        event.pressure_mbar,
                        event.deflection_mm,
                        event.device_time_s,
                        event.sequence,
                    ),
                    frame,
                )
            case InstrumentFault():
                self._ready.append(event)
            case _:
                pass  # what it says of itself does not make it controllable

    def _take(self, reading: Reading, frame: bytes) -> None:
        count = self._count + self._damaged if reading.sequence is None else reading.sequence
        time_s = reading.time_s
        if time_s is None:
            if self._rule.rate_hz is None:  # any rate would be a wrong time under suction
                self._ready.append(Damaged("neither a time nor stream.rate_hz tells when", frame))
                return
            time_s = count / self._rule.rate_hz
        if self._last is not None:
            if time_s == self._last[0]:
                self._ready.append(Damaged("reading at the same time as the one before", frame))
                return
            if time_s < self._last[0]:
                waits = self._state is InstrumentState.ARMED
                self._stop("the instrument's clock went back", following=waits)
                self._begin_anew()
                count = count if reading.sequence is not None else 0
            else:
                self._step_s = time_s - self._last[0]
        self._count, self._damaged = (count + 1, 0) if reading.sequence is None else (0, 0)
        self._last = time_s, count
        one = time_s, count, reading, self._host_time_s
        if self._state is InstrumentState.RUNNING:
            self._in_run(one)
        else:
            self._between(one)

    def _between(self, one: _Held) -> None:
        time_s, _, reading, _ = one
        if not self._following:
            self._give(*one)
            return
        at_zero = reading.pressure_mbar <= self._rule.zero_mbar
        if at_zero or not self._seen_zero:
            self._let_go()
        self._seen_zero = self._seen_zero or at_zero
        if not self._seen_zero:
            self._give(*one)
            return
        self._held.append(one)
        if reading.pressure_mbar >= self._rule.begin_mbar:
            self._begin()
        elif time_s - self._held[0][0] > _HELD_S:
            self._give(*self._held.pop(0))

    def _begin(self) -> None:
        held, self._held = self._held, []
        self._origin, self._due = (held[0][0], held[0][1]), held[0][1]
        self._say(InstrumentState.RUNNING, "the pressure left zero")
        for one in held:
            self._give(*one)

    def _in_run(self, one: _Held) -> None:
        assert self._origin is not None
        time_s, _, reading, _ = one
        run_s = round(time_s - self._origin[0], _MICRO)
        if self._ends and run_s > self._ends[-1]:
            self._end(PROGRAM_DONE)
            self._give(*one)
        elif reading.pressure_mbar > self._rule.zero_mbar:
            self._let_go()
            self._give(*one)
        else:
            self._held.append(one)
            if time_s - self._held[0][0] >= self._zero_s:
                self._end(PROGRAM_DONE)

    def _end(self, reason: str) -> None:
        """End the run with the first reading at zero, or the last one above it."""
        held, self._held = self._held, []
        # The foot of the next curve is the last reading; with a program, rests belong to the run
        inside = len(held) if self._ends and reason == PROGRAM_DONE else 1
        for one in held[:inside]:
            self._give(*one)
        self._following = False
        self._say(InstrumentState.IDLE, reason)
        for one in held[inside:]:
            self._give(*one)

    def _stop(self, reason: str, *, following: bool = False) -> None:
        if self._state is InstrumentState.RUNNING:
            self._end(PROGRAM_DONE if self._complete() else reason)
        self._let_go()
        self._following = following
        waits = InstrumentState.ARMED if following else InstrumentState.IDLE
        if self._state is not waits:
            self._say(waits, reason)

    def _say(self, state: InstrumentState, reason: str) -> None:
        self._state = state
        self._ready.append(State(state, reason))

    def _complete(self) -> bool:
        """Whether the run has come to its end, as far as anybody can tell."""
        if not self._ends:
            return bool(self._held)  # it is back at zero
        assert self._origin is not None
        assert self._last is not None
        return self._last[0] - self._origin[0] >= self._ends[-1] - 1.5 * self._step_s

    def _let_go(self) -> None:
        held, self._held = self._held, []
        for one in held:
            self._give(*one)

    def _give(self, time_s: float, count: int, reading: Reading, host_time_s: float | None) -> None:
        if self._origin is None:
            self._origin = time_s, count
        since_s = round(time_s - self._origin[0], _MICRO)
        running = self._state is InstrumentState.RUNNING
        if running and self._due is not None and count > self._due:
            first = self._origin[1]
            self._ready.append(Gap(expected=self._due - first, received=count - first))
        self._due = count + 1
        segment = 0
        if running and self._ends:
            # A boundary belongs to the segment before it, as in skinlab's programs
            segment = min(bisect.bisect_left(self._ends, since_s), len(self._ends) - 1)
        self._ready.append(
            Sample(
                max(0, count - self._origin[1]),
                since_s,
                reading.pressure_mbar,
                reading.deflection_mm,
                segment,
                host_time_s,
            )
        )


def connect(dialect: Dialect, limits: Limits = DEFAULT_LIMITS) -> Connection | StreamConnection:
    """Begin the conversation that the dialect's instrument allows."""
    kind = Connection if dialect.capabilities.controllable else StreamConnection
    return kind(dialect, limits)


def _hello(dialect: Dialect, rule: Stream, limits: Limits) -> Hello:
    rate_hz = rule.rate_hz or 20.0  # only for estimates of what a run needs on the disk
    return Hello(
        dialect=dialect.name,
        protocol_version=dialect.protocol_version,
        model=rule.model or dialect.name,
        firmware="",
        serial_number="",
        aperture_mm=rule.aperture_mm,
        max_pressure_mbar=limits.max_pressure_mbar,
        max_suction_s=limits.max_suction_s,
        min_rate_hz=rate_hz,
        max_rate_hz=rate_hz,
        simulated=False,
        default_rate_hz=rate_hz,
        read_only=True,
    )
