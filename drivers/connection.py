"""Sans-I/O conversation with one instrument: bytes in, events out; commands in, bytes out.

No clock, thread, socket or serial port here. Any bytes at all give events or RemoteProtocolError.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.dialect import Dialect
from drivers.errors import LocalProtocolError, RemoteProtocolError
from drivers.events import (
    Abilities,
    Arm,
    Command,
    Damaged,
    Gap,
    Hello,
    Identify,
    InstrumentEvent,
    InstrumentState,
    KeepAlive,
    Load,
    Loaded,
    Refused,
    Reset,
    Sample,
    Start,
    State,
    Vent,
)
from drivers.incoming import Incoming
from drivers.limits import DEFAULT_LIMITS, NO_ABILITIES, Limits, check_load

_UNSAID = "not said: samples came"
_NUMBERS = 1 << 16  # command numbers wrap here


@dataclass(frozen=True, slots=True)
class StateRow:
    """One row of the state table: what we may send, and where the instrument may go by itself."""

    commands: frozenset[type[Command]]
    followers: frozenset[InstrumentState]


_S = InstrumentState
_ALWAYS: frozenset[type[Command]] = frozenset({Identify, Vent})
_SAFE = frozenset({_S.VENTING, _S.FAULT})
_DOWN = _SAFE | {_S.IDLE, _S.LOADED}  # VENTING in between may be a frame that was lost

# The one table. `None`: the instrument has not said its state yet. Staying is always allowed.
STATES: Mapping[InstrumentState | None, StateRow] = {
    None: StateRow(_ALWAYS, frozenset(_S)),
    _S.IDLE: StateRow(_ALWAYS | {Load, Reset}, _SAFE | {_S.LOADED}),
    _S.LOADED: StateRow(_ALWAYS | {Load, Arm, Reset}, _SAFE | {_S.IDLE, _S.ARMED}),
    _S.ARMED: StateRow(_ALWAYS | {Start, KeepAlive}, _DOWN | {_S.RUNNING}),
    _S.RUNNING: StateRow(_ALWAYS | {KeepAlive}, _DOWN),
    _S.VENTING: StateRow(_ALWAYS | {KeepAlive}, _DOWN),
    _S.FAULT: StateRow(_ALWAYS | {Reset}, frozenset({_S.IDLE})),
}

_NEEDS_KEEP_ALIVE = frozenset({_S.ARMED, _S.RUNNING, _S.VENTING})


class Connection(Incoming):
    """The host's side of the conversation with one instrument.

    `receive_data` takes bytes as they come, `next_event` gives what they mean, `send` gives the
    bytes of a command that is legal now and within the limits.
    """

    can_vent = True

    def __init__(self, dialect: Dialect, limits: Limits = DEFAULT_LIMITS) -> None:
        super().__init__(dialect)
        self._limits = limits
        self._state: InstrumentState | None = None
        self._hello: Hello | None = None
        self._abilities = NO_ABILITIES
        self._number = -1
        self._load_number: int | None = None  # None: this side asked for no program
        self._next_sequence: int | None = None  # None: whatever comes first
        self._sampled_s: float | None = None  # when the last sample of this run was taken

    @property
    def state(self) -> InstrumentState | None:
        """The instrument's state as it last said; None before that."""
        return self._state

    @property
    def hello(self) -> Hello | None:
        """Who the instrument is; None before it said so."""
        return self._hello

    @property
    def abilities(self) -> Abilities:
        """What the instrument said that it can do besides."""
        return self._abilities

    @property
    def keeps_alive(self) -> bool:
        """Whether the instrument is to hear a keep-alive now."""
        return self._state in _NEEDS_KEEP_ALIVE

    @property
    def keep_alive_s(self) -> float:
        """Time between two keep-alives."""
        return self._limits.keep_alive_s

    def send(self, command: Command) -> bytes:
        """Bytes of `command`.

        Raises LocalProtocolError where it is not legal in the instrument's state or exceeds a
        limit; nothing may be sent then.
        """
        name = type(command).__name__
        if type(command) not in STATES[self._state].commands:
            where = "not identified yet" if self._state is None else self._state.value
            raise LocalProtocolError(f"{name} is not allowed: the instrument is {where}")
        if isinstance(command, Load):
            if self._hello is None:
                raise LocalProtocolError(f"{name} is not allowed before the instrument's Hello")
            check_load(command, self._limits, self._hello, self._abilities)
        number = self._number
        if isinstance(command, Load | Arm | Start | Reset):
            number = (number + 1) % _NUMBERS
        data = self._dialect.encode_command(command, max(number, 0))
        self._number = number
        if isinstance(command, Load):
            self._load_number = number
        return data

    # ---- what an event means ------------------------------------------------------------

    def _miss(self) -> None:
        """Nothing: the instrument counts its samples itself."""

    def _judge(self, event: InstrumentEvent, number: int | None, frame: bytes) -> None:
        match event:
            case Sample():
                self._judge_sample(event, frame)
            case State():
                self._ready.append(event)
                self._judge_state(event.state)
            case Hello():
                self._ready.append(event)
                if event.protocol_version != self._dialect.protocol_version:
                    raise RemoteProtocolError(
                        f"{event.model} speaks version {event.protocol_version} of "
                        f"{event.dialect!r}; this driver speaks {self._dialect.protocol_version}"
                    )
                self._hello, self._abilities = event, NO_ABILITIES
            case Abilities():
                self._ready.append(event)
                self._abilities = event
            case Loaded():
                self._judge_loaded(event, number, frame)
            case Refused() if 0 <= self._number != number and not event.of_vent:
                # A vent has no number, and no instrument may refuse one
                self._ready.append(Damaged("answer to an older command", frame))
            case _:
                self._ready.append(event)

    def _judge_sample(self, sample: Sample, frame: bytes) -> None:
        if self._state is InstrumentState.ARMED:  # samples are of runs: that frame was lost
            running = State(InstrumentState.RUNNING, _UNSAID)
            self._ready.append(running)
            self._judge_state(running.state)
        due = self._next_sequence
        if due is not None and sample.sequence < due:
            reason = f"sample {sample.sequence} again where {due} was due"
            self._ready.append(Damaged(reason, frame))
            return
        if self._sampled_s is not None and sample.device_time_s <= self._sampled_s:
            reason = f"sample {sample.sequence} is not later than the one before"
            self._ready.append(Damaged(reason, frame))
            return
        self._sampled_s = sample.device_time_s
        if due is not None and sample.sequence > due:
            self._ready.append(Gap(expected=due, received=sample.sequence))
        self._next_sequence = sample.sequence + 1
        self._ready.append(sample)

    def _judge_state(self, state: InstrumentState) -> None:
        before, self._state = self._state, state
        if state is not before and state in {InstrumentState.ARMED, InstrumentState.RUNNING}:
            self._sampled_s = None
        if state is InstrumentState.ARMED:
            self._next_sequence = 0  # here and not at RUNNING: that frame may be lost
        elif state is InstrumentState.RUNNING and before not in {state, InstrumentState.ARMED}:
            self._next_sequence = None
        if state is not before and state not in STATES[before].followers:
            raise RemoteProtocolError(f"the instrument went from {before} to {state}")

    def _judge_loaded(self, event: Loaded, number: int | None, frame: bytes) -> None:
        if self._load_number is not None and number != self._load_number:
            self._ready.append(Damaged("read-back of an older program", frame))
            return
        self._ready.append(event)
        if self._state in {InstrumentState.ARMED, InstrumentState.RUNNING}:
            raise RemoteProtocolError(f"the instrument changed its program while {self._state}")
