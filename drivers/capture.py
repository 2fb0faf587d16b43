"""Captures: the raw bytes between an instrument and the software that drives it, with times.

A text file, one JSON document a line, so that a crash leaves all but the last line; described in
docs/files.md. It is what a dialect is written from, and tested with.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from drivers.dialect import Dialect
from drivers.errors import RemoteProtocolError
from drivers.events import Command, Damaged, InstrumentEvent
from drivers.guarded import GuardedDialect, guarded
from drivers.reading import read_whole

SCHEMA = "skinlab.capture/1"


class Side(StrEnum):
    """Who sent the bytes."""

    INSTRUMENT = "instrument"
    SOFTWARE = "software"


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes that came together, and the seconds since the capture began."""

    time_s: float
    side: Side
    data: bytes


class CaptureWriter:
    """Writes a capture, readable by its owner only. Raises OSError; an existing file is refused."""

    def __init__(self, path: Path, facts: Mapping[str, Any]) -> None:
        """`facts` go into the first line: port, settings of the line, date."""
        self._path = str(path)
        self._file = os.fdopen(
            os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8"
        )
        self.bytes_of = dict.fromkeys(Side, 0)
        self._line({"schema": SCHEMA, **facts})

    def write(self, chunk: Chunk) -> None:
        """Add a chunk; it is out of this process when this returns."""
        self.bytes_of[chunk.side] += len(chunk.data)
        self._line(
            {
                "time_s": round(chunk.time_s, 6),
                "from": chunk.side.value,
                "hex": chunk.data.hex(" "),
                "text": chunk.data.decode("latin-1"),
            }
        )

    def _line(self, document: Mapping[str, Any]) -> None:
        with self._named():
            self._file.write(json.dumps(document) + "\n")
            self._file.flush()

    def close(self) -> None:
        """Close the file."""
        with self._named():
            self._file.close()

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Name the file in an error: the system says that a disk is full, and not of which file."""
        try:
            yield
        except OSError as error:
            error.filename = self._path
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def read_capture(path: Path) -> tuple[dict[str, Any], list[Chunk]]:
    """Read the facts and the chunks of a capture; a last line that was cut off is left out.

    Raises OSError, and ValueError (one sentence that names file and line) for what is no capture.
    """
    lines = read_whole(path).split(b"\n")[:-1]  # whole lines end with a newline
    facts: dict[str, Any] = {}
    chunks = []
    for number, line in enumerate(lines, start=1):
        try:
            document = json.loads(line)
            if number == 1:
                facts = document
                if facts["schema"] != SCHEMA:
                    raise ValueError(f"schema {facts['schema']!r}, expected {SCHEMA!r}")
                continue
            chunks.append(
                Chunk(
                    float(document["time_s"]),
                    Side(document["from"]),
                    bytes.fromhex(document["hex"]),
                )
            )
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            raise ValueError(f"{path}: line {number}: not a line of a capture ({error})") from None
    if not facts:
        raise ValueError(f"{path}: empty; expected a capture")
    return facts, chunks


def decode_capture(
    chunks: list[Chunk], dialect: Dialect
) -> Iterator[tuple[float, Side, InstrumentEvent | Command | Damaged]]:
    """Say what a dialect makes of a capture: time in s, who spoke, and what was said.

    Bytes that it does not understand come as Damaged. Both sides are framed by the dialect's
    `take`; the instrument's frames are events, the software's are commands.
    Raises BrokenDialectError.
    """
    speaks = guarded(dialect)
    buffers = {side: bytearray() for side in Side}
    for chunk in chunks:
        buffer = buffers[chunk.side]
        buffer += chunk.data
        while (taken := speaks.take(buffer)) is not None:
            yield chunk.time_s, chunk.side, _meaning(taken, chunk.side, speaks)


def _meaning(
    taken: bytes | Damaged, side: Side, dialect: GuardedDialect
) -> InstrumentEvent | Command | Damaged:
    if isinstance(taken, Damaged):
        return taken
    try:
        if side is Side.INSTRUMENT:
            return dialect.decode_event(taken)[0]
        return dialect.decode_command(taken)[0]
    except RemoteProtocolError as error:
        return Damaged(str(error), taken)
