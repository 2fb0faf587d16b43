"""Dialects: one file each is the grammar of one instrument, found by looking.

A module of this folder has a `DIALECT` that meets `Dialect`; an installed package offers one by an
entry point of the group `skinlab.dialects`, `name = "package.module:DIALECT"`. It holds both
sides of the conversation, so that the simulated probe and the host share one grammar and every
frame can be tested round trip.
"""

from __future__ import annotations

import contextlib
import importlib
import pkgutil
import sys
from functools import cache
from typing import Protocol

from drivers.events import Command, Damaged, InstrumentEvent

GROUP = "skinlab.dialects"


class Dialect(Protocol):
    """The grammar of one instrument. Stateless: framing works on a buffer that the caller owns."""

    @property
    def name(self) -> str:
        """How it is called: the name of its file, or of its entry point."""

    @property
    def protocol_version(self) -> int:
        """The version that is spoken; another one in Hello is refused by the connection."""

    def take(self, buffer: bytearray) -> bytes | Damaged | None:
        """Remove one frame from the front of `buffer`, or bytes that cannot belong to one.

        None: more bytes are needed; `buffer` then holds less than one longest frame. What comes
        out does not depend on how the bytes were cut into pieces on their way.
        """

    def encode_command(self, command: Command, number: int) -> bytes:
        """Bytes of one command; `number` lets an answer name it and a repeat be told apart.

        Raises LocalProtocolError for a value that the wire cannot carry.
        """

    def decode_event(self, frame: bytes) -> tuple[InstrumentEvent, int | None]:
        """One frame of the instrument, and the number of the command that it answers, if any.

        Raises RemoteProtocolError, and nothing else, for every frame that is not valid.
        """

    def decode_command(self, frame: bytes) -> tuple[Command, int | None]:
        """Be the instrument's side of `encode_command`. Raises RemoteProtocolError."""

    def encode_event(self, event: InstrumentEvent, number: int | None = None) -> bytes:
        """Be the instrument's side of `decode_event`. Raises LocalProtocolError."""


def dialect_names() -> tuple[str, ...]:
    """Names of all dialects, in this folder and installed, sorted."""
    return tuple(sorted({*_built_in(), *_installed()}))


def get_dialect(name: str) -> Dialect:
    """Get the dialect called `name`; an error while importing one of ours comes through.

    Raises ValueError if there is none.
    """
    if name in _built_in():
        ours: Dialect = importlib.import_module(f"{__name__}.{name}").DIALECT
        return ours
    if name in _installed():
        return _installed()[name][0]
    raise ValueError(f"no dialect {name!r}; known: {', '.join(dialect_names())}")


def dialect_origin(name: str) -> tuple[str, str] | None:
    """Distribution and version that a dialect comes from; None: it is one of this folder."""
    return None if name in _built_in() else _installed()[name][1]


def _built_in() -> tuple[str, ...]:
    return tuple(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_"))


@cache
def _installed() -> dict[str, tuple[Dialect, tuple[str, str]]]:
    """Dialects that installed packages offer; what is wrong with one is said, and it is left out.

    The same rules as for all other kinds of plugins, which this package may not know of.
    """
    import importlib.metadata  # only where a dialect is asked for

    found: dict[str, tuple[Dialect, tuple[str, str]]] = {}
    try:
        entries = sorted(importlib.metadata.entry_points(group=GROUP), key=lambda e: e.name)
    except Exception:  # noqa: BLE001 -- metadata that somebody else has damaged
        return found
    for entry in entries:
        dist = entry.dist
        origin = ("unknown", "unknown") if dist is None else (dist.name, dist.version)
        try:
            if entry.name in _built_in() or entry.name in found:
                raise TypeError("one of this name is there already")
            one = entry.load()
            missing = [n for n in dir(Dialect) if not n.startswith("_") and not hasattr(one, n)]
            if missing or one.name != entry.name:
                raise TypeError(f"it has no {', '.join(missing)}" if missing else "another name")
            found[entry.name] = one, origin
        except (Exception, SystemExit) as error:  # noqa: BLE001 -- anything may be in it
            _warn(
                f"plugin {origin[0]}, dialect {entry.name!r}: left out, because it is broken: "
                f"{type(error).__name__}: {error}"
            )
    return found


def _warn(sentence: str) -> None:
    sentence = "".join(sign if sign.isprintable() else "?" for sign in sentence)
    if sys.stderr is not None:
        with contextlib.suppress(OSError, ValueError):
            sys.stderr.write(f"drivers: {sentence}\n")
