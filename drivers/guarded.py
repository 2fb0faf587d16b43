"""A dialect whose faults are told by name: what calls its code goes through here.

A plugin may raise anything, return anything, or take nothing of the buffer for ever. All of that is
BrokenDialectError, on which the engine vents; readings that are no numbers are no samples.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import replace
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

from drivers.breakdown import reason
from drivers.capabilities import Capabilities, Stream
from drivers.dialect import Dialect
from drivers.dialects import dialect_name, stream_of
from drivers.errors import (
    BrokenDialectError,
    DriverError,
    LocalProtocolError,
    RemoteProtocolError,
)
from drivers.events import (
    NO_NUMBERS,
    Command,
    Damaged,
    InstrumentEvent,
    Reading,
    Sample,
    Segment,
    State,
)

# Readings may be numpy's numbers; all else is written into a session as it is
_OF_A_READING: dict[type, tuple[type, ...]] = {float: (float, Real), int: (int, Integral)}
_OF_ALL_ELSE: dict[type, tuple[type, ...]] = {float: (float, int)}


def _types(said: Any, wide: dict[type, tuple[type, ...]]) -> tuple[type, ...]:
    """Return the types that an annotation allows."""
    if isinstance(said, UnionType):
        return tuple(kind for one in get_args(said) for kind in _types(one, wide))
    kind = get_origin(said) or said
    return wide.get(kind, (kind,))


_FIELDS: dict[type, tuple[tuple[str, tuple[type, ...]], ...]] = {
    kind: tuple(
        (name, _types(said, _OF_A_READING if kind in (Sample, Reading) else _OF_ALL_ELSE))
        for name, said in get_type_hints(kind).items()
    )
    for kind in (*get_args(InstrumentEvent), Segment)
}


class GuardedDialect:
    """The host's side of a dialect, checked at every call."""

    def __init__(self, dialect: Dialect) -> None:
        self._dialect = dialect

    @property
    def protocol_version(self) -> int:
        """The version that is spoken."""
        return self._dialect.protocol_version

    @property
    def capabilities(self) -> Capabilities:
        """What the instrument can be asked for."""
        return self._dialect.capabilities

    @property
    def stream(self) -> Stream:
        """How its readings become runs."""
        return stream_of(self._dialect)

    @property
    def name(self) -> str:
        """How it is called."""
        return self._dialect.name

    def take(self, buffer: bytearray) -> bytes | Damaged | None:
        """See `Dialect.take`. Raises BrokenDialectError."""
        if not buffer:
            return None
        with self._at_work():
            before = len(buffer)
            taken: object = self._dialect.take(buffer)
            if taken is None:
                return None
            if isinstance(taken, Damaged):
                _check_fields(taken.data, taken.reason)
            elif isinstance(taken, bytearray):
                taken = bytes(taken)
            elif not isinstance(taken, bytes):
                raise TypeError(f"take returned {_a(taken)}; expected bytes, Damaged or None")
            if len(buffer) >= before:  # it would be asked for ever
                raise ValueError("take returned a frame and removed nothing from the buffer")
            return taken

    def decode_event(self, frame: bytes) -> tuple[InstrumentEvent, int | None]:
        """See `Dialect.decode_event`. Raises RemoteProtocolError, BrokenDialectError."""
        with self._at_work(RemoteProtocolError):
            found: object = self._dialect.decode_event(frame)
            if not isinstance(found, tuple) or len(found) != 2:
                raise TypeError(
                    f"decode_event returned {_a(found)}; expected an event and a number or None"
                )
            event, number = found
            if type(event) not in _FIELDS or isinstance(event, Segment):
                raise TypeError(
                    f"decode_event returned {_a(event)}; expected one of drivers.events"
                )
            if number is not None and not isinstance(number, int):
                raise TypeError(f"the number of a command is {_a(number)}; expected an int")
            return _checked(event), number

    def encode_command(self, command: Command, number: int) -> bytes:
        """See `Dialect.encode_command`. Raises LocalProtocolError, BrokenDialectError."""
        with self._at_work(LocalProtocolError):
            data: object = self._dialect.encode_command(command, number)
            if not isinstance(data, bytes):
                raise TypeError(f"encode_command returned {_a(data)}; expected bytes")
            return data

    def decode_command(self, frame: bytes) -> tuple[Command, int | None]:
        """See `Dialect.decode_command`. Raises RemoteProtocolError, BrokenDialectError."""
        with self._at_work(RemoteProtocolError):
            found: object = self._dialect.decode_command(frame)
            if not isinstance(found, tuple) or len(found) != 2:
                raise TypeError(
                    f"decode_command returned {_a(found)}; expected a command and a number or None"
                )
            command, number = found
            if not isinstance(command, Command):
                raise TypeError(f"decode_command returned {_a(command)}; expected a command")
            return command, number

    @contextlib.contextmanager
    def _at_work(self, *allowed: type[DriverError]) -> Iterator[None]:
        try:
            yield
        except allowed:
            raise
        except (KeyboardInterrupt, GeneratorExit):
            raise
        except BaseException as error:
            raise BrokenDialectError(
                f"{dialect_name(self._dialect)}: broke down: {reason(error)}"
            ) from error


def guarded(dialect: Dialect | GuardedDialect) -> GuardedDialect:
    """Give a dialect that is checked at every call."""
    return dialect if isinstance(dialect, GuardedDialect) else GuardedDialect(dialect)


def _checked(event: Any) -> InstrumentEvent:
    """Return an event whose fields are what they have to be.

    A state's pressure that is no number is one that the instrument does not say. Raises TypeError,
    ValueError, and RemoteProtocolError for a reading that is no number.
    """
    strange = _strange(event)
    if strange and isinstance(event, Sample | Reading):
        raise RemoteProtocolError(f"{NO_NUMBERS} ({strange})")
    if strange and isinstance(event, State):
        return replace(event, pressure_mbar=None)
    if strange:
        raise ValueError(f"{type(event).__name__}.{strange}; expected a finite number")
    return event  # type: ignore[no-any-return]


def _strange(one: Any) -> str:
    """Return which number of an event is not finite, and what it is; empty: none."""
    for name, allowed in _FIELDS[type(one)]:
        value = getattr(one, name)
        if not isinstance(value, allowed):
            wanted = " or ".join(dict.fromkeys(_CALLED.get(k, k.__name__) for k in allowed))
            raise TypeError(f"{type(one).__name__}.{name} is {_a(value)}; expected {wanted}")
        # Also numpy's numbers, of which only one width is a float
        if isinstance(value, Real) and not math.isfinite(value):
            return f"{name} is {value}"
        if isinstance(value, tuple):
            for part in value:
                if not isinstance(part, Segment):
                    raise TypeError(f"{name} holds {_a(part)}; expected segments")
                if inner := _strange(part):
                    return f"{name}: {inner}"
    return ""


_CALLED: dict[type, str] = {
    Real: "a number",
    float: "a number",
    Integral: "an int",
    int: "an int",
    NoneType: "None",
    str: "a text",
}


def _check_fields(data: object, reason: object) -> None:
    if not isinstance(data, bytes) or not isinstance(reason, str):
        raise TypeError(
            f"take returned Damaged of {_a(reason)} and {_a(data)}; expected a text and bytes"
        )


def _a(value: object) -> str:
    name = type(value).__name__
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"
