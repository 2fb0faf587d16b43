"""Dialects of plain line protocols, each described by one TOML file; docs/dialects.md has a recipe.

An instrument of this kind only streams: every line is a reading of both channels. A file cannot say
how a program is loaded and read back, so that nothing here ever starts suction.
"""

from __future__ import annotations

import binascii
import math
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from drivers.capabilities import Capabilities, Stream
from drivers.dialect import Dialect
from drivers.errors import DialectFileError, LocalProtocolError, RemoteProtocolError
from drivers.events import (
    Command,
    Damaged,
    InstrumentEvent,
    KeepAlive,
    Reading,
    Start,
    Vent,
)
from drivers.numbers import number_in
from drivers.patterns import bounded_pattern
from drivers.reading import read_whole

IGNORED = "a line to be ignored"
MAX_LINE_BYTES = 250  # the most that a file may ask for: what bounds the time of its pattern
_USUAL_LINE_BYTES = 120
_MOST_DOTS = 5_000  # of one line
_MAX_FILE_BYTES = 100_000
_ROUNDED = 1e-3  # to which an example may state its numbers: units are further apart
_LARGEST = 1e12  # of any number in a line, in mbar, mm or s

_UNITS: Mapping[str, Mapping[str, float]] = {
    "pressure": {"mbar": 1.0, "hPa": 1.0, "Pa": 0.01, "kPa": 10.0, "mmHg": 1.33322387415},
    "deflection": {"mm": 1.0, "µm": 1e-3, "um": 1e-3, "nm": 1e-6},
    "time": {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "us": 1e-6},
    "sequence": {"1": 1.0},
}
# Divided, where the factor is the inverse of a whole number: correctly rounded, as on the wire
_INVERSES = {0.01: 100.0, 1e-3: 1e3, 1e-6: 1e6}


def _xor8(data: bytes) -> int:
    total = 0
    for byte in data:
        total ^= byte
    return total


def _crc16_modbus(data: bytes) -> int:
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return crc


CHECKSUMS: Mapping[str, Callable[[bytes], int]] = {
    "xor8": _xor8,
    "sum8": lambda data: sum(data) & 0xFF,
    "crc16-ccitt-false": lambda data: binascii.crc_hqx(data, 0xFFFF),
    "crc16-xmodem": lambda data: binascii.crc_hqx(data, 0),
    "crc16-modbus": _crc16_modbus,
}


@dataclass(frozen=True, slots=True)
class Column:
    """How the text of one column becomes a number in mbar, mm or s."""

    unit: str
    scale: float = 1.0  # the number in the line times this is in `unit`
    offset: float = 0.0  # added behind it, in `unit`


@dataclass(frozen=True, slots=True)
class LineGrammar:
    """What a file says of its lines."""

    name: str
    version: int
    pattern: re.Pattern[str]
    columns: Mapping[str, Column]
    ignore: re.Pattern[str] | None
    line_end: bytes
    max_line_bytes: int
    decimal: str
    checksum: str | None
    commands: Mapping[str, bytes]  # start, stop, vent, keep_alive


class LineDialect:
    """A plain line protocol, as a file describes it. Reads only."""

    def __init__(self, grammar: LineGrammar, stream: Stream, text: str) -> None:
        self.name = grammar.name
        self.protocol_version = grammar.version
        self.capabilities = Capabilities(
            vent="vent" in grammar.commands, keep_alive="keep_alive" in grammar.commands
        )
        self.stream = stream
        self.text = text  # of the file, whole
        self._grammar = grammar

    def take(self, buffer: bytearray) -> bytes | Damaged | None:
        """Remove one line; see `Dialect.take`. What is no reading is told apart here."""
        grammar = self._grammar
        end = buffer.find(grammar.line_end, 0, grammar.max_line_bytes)
        size = end + len(grammar.line_end) if end >= 0 else grammar.max_line_bytes
        if len(buffer) < size:
            return None
        data = bytes(buffer[:size])
        del buffer[:size]
        if end < 0:
            return Damaged(f"no end of a line in {size} bytes", data)
        line = data.decode("latin-1").strip()
        if not line or (grammar.ignore and grammar.ignore.fullmatch(line)):
            return Damaged(IGNORED, data)
        return data

    def decode_event(self, frame: bytes) -> tuple[InstrumentEvent, int | None]:
        """Read one line; see `Dialect.decode_event`."""
        grammar = self._grammar
        if len(frame) > grammar.max_line_bytes:
            raise RemoteProtocolError("longer than any line")
        line = frame.decode("latin-1").strip()
        match = grammar.pattern.fullmatch(line)
        if match is None:
            raise RemoteProtocolError("not of the form of the pattern")
        if grammar.checksum is not None:
            _verify(grammar.checksum, match)
        values = {name: self._value(name, match[name]) for name in grammar.columns}
        sequence = values.get("sequence")
        if sequence is not None and not (sequence >= 0 and sequence.is_integer()):
            raise RemoteProtocolError(f"sequence {sequence:g} is not a count")
        return Reading(
            pressure_mbar=values["pressure"],
            deflection_mm=values["deflection"],
            time_s=values.get("time"),
            sequence=None if sequence is None else int(sequence),
        ), None

    def _value(self, name: str, text: str | None) -> float:
        column = self._grammar.columns[name]
        if text is None:
            raise RemoteProtocolError(f"there is no {name}")
        try:
            number = number_in(text.strip().replace(self._grammar.decimal, "."))
        except ValueError:
            raise RemoteProtocolError(f"{name} {text[:40]!r} is not a number") from None
        number = number * column.scale + column.offset
        factor = _UNITS[name][column.unit]
        inverse = _INVERSES.get(factor)
        value = number * factor if inverse is None else number / inverse
        if not (math.isfinite(value) and abs(value) <= _LARGEST):
            raise RemoteProtocolError(f"{name} {text[:40]!r} is out of range")
        return value

    def encode_command(self, command: Command, number: int) -> bytes:
        """Give the text of a vent or a keep-alive, where the file has one; see `Dialect`."""
        del number
        word = {Vent: "vent", KeepAlive: "keep_alive"}.get(type(command))
        if word is None or word not in self._grammar.commands:
            raise LocalProtocolError(f"dialect {self.name!r} has no {type(command).__name__}")
        return self._grammar.commands[word]

    def decode_command(self, frame: bytes) -> tuple[Command, int | None]:
        """Know the commands of the file again, in a capture; see `Dialect.decode_command`."""
        kinds: dict[str, Command] = {
            "start": Start(), "stop": Vent(), "vent": Vent(), "keep_alive": KeepAlive(),
        }  # fmt: skip
        for word, text in self._grammar.commands.items():
            if frame.strip() == text.strip():
                return kinds[word], None
        raise RemoteProtocolError("no command of this dialect")

    def encode_event(self, event: InstrumentEvent, number: int | None = None) -> bytes:
        """Refuse: a pattern says how lines are read, not how they are made."""
        del number
        raise LocalProtocolError(f"{type(event).__name__} cannot be written from a pattern")


def read_line_dialect(path: Path) -> Dialect:
    """Read a dialect from its file.

    Raises DialectFileError: one sentence that names file and field.
    """
    try:
        data = read_whole(path, _MAX_FILE_BYTES)
    except OSError as error:
        raise DialectFileError(f"{path}: cannot be read ({error.strerror or error})") from None
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise DialectFileError(f"{path}: not UTF-8 (byte {error.start})") from None
    return line_dialect(text, str(path))


def line_dialect(text: str, where: str) -> Dialect:
    """Make a dialect of the text of a file; `where` is what messages call it.

    Raises DialectFileError.
    """
    # A key of thousands of parts takes the parser a time that grows with their square.
    if any(line.count(".") > _MOST_DOTS for line in text.split("\n")):
        raise DialectFileError(f"{where}: nested too deeply")
    try:
        said = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise DialectFileError(f"{where}: no TOML: {error}") from None
    try:
        return _dialect(said, text)
    except _BadFieldError as error:
        raise DialectFileError(f"{where}: {error}") from None


# ---- decoding -------------------------------------------------------------------------------


class _BadFieldError(Exception):
    """A sentence that names the field."""


class _Table:
    """A table of the file, taken key by key; what is left over is not known."""

    def __init__(self, where: str, said: Any) -> None:
        if not isinstance(said, dict):
            raise _BadFieldError(f"{where}: expected a table")
        self.where = where
        self._left = dict(said)
        self._known: list[str] = []

    def take(self, key: str, kind: type, default: Any = None, *, needed: bool = False) -> Any:
        """Give the value of a key, of this type; whole numbers are floats as well."""
        self._known.append(key)
        if key not in self._left:
            if needed:
                raise _BadFieldError(f"{self.named(key)} is missing")
            return default
        value = self._left.pop(key)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
            raise _BadFieldError(
                f"{self.named(key)} is {value!r}; expected {_KINDS.get(kind, kind.__name__)}"
            )
        return value

    def named(self, key: str) -> str:
        """Say where a key is."""
        return f"{self.where}.{key}" if self.where else key

    def end(self) -> None:
        """Refuse keys that nobody took."""
        for key in self._left:
            known = ", ".join(self._known)
            raise _BadFieldError(f"{self.named(key)} is not known; expected one of: {known}")


_KINDS = {float: "a number", int: "a whole number", str: "a text", dict: "a table", list: "a list"}


def _dialect(said: dict[str, Any], text: str) -> LineDialect:
    top = _Table("", said)
    head = _Table("dialect", top.take("dialect", dict, needed=True))
    columns = _columns(_Table("columns", top.take("columns", dict, needed=True)))
    check = _Table("checksum", top.take("checksum", dict, {}))
    commands = _Table("commands", top.take("commands", dict, {}))
    stream_said = _Table("stream", top.take("stream", dict, {}))
    examples = top.take("example", list, [])
    top.end()

    name = head.take("name", str, needed=True)
    if not (name.isidentifier() and name.isascii() and len(name) <= 60):
        raise _BadFieldError(f"dialect.name is {name!r}; expected letters, digits and _")
    version = head.take("version", int, 1)
    if not 1 <= version <= 65535:
        raise _BadFieldError(f"dialect.version is {version}; expected 1 to 65535")
    model = head.take("model", str, "")
    max_line_bytes = head.take("max_line_bytes", int, _USUAL_LINE_BYTES)
    if not 8 <= max_line_bytes <= MAX_LINE_BYTES:
        raise _BadFieldError(
            f"dialect.max_line_bytes is {max_line_bytes}; expected 8 to {MAX_LINE_BYTES}"
        )
    line_end = head.take("line_end", str, "\n")
    if line_end not in {"\n", "\r", "\r\n"}:
        raise _BadFieldError(f"dialect.line_end is {line_end!r}; expected \\n, \\r or \\r\\n")
    decimal = head.take("decimal", str, ".")
    if decimal not in {".", ","}:
        raise _BadFieldError(f"dialect.decimal is {decimal!r}; expected '.' or ','")
    pattern = _pattern(head.take("pattern", str, needed=True), "dialect.pattern")
    ignore = head.take("ignore", str)
    head.end()

    kind = check.take("kind", str)
    check.end()
    if kind is not None and kind not in CHECKSUMS:
        raise _BadFieldError(f"checksum.kind is {kind!r}; expected one of: {', '.join(CHECKSUMS)}")
    _check_groups(pattern, columns, kind)
    stream = _stream(stream_said, model, "time" in columns)
    grammar = LineGrammar(
        name=name,
        version=version,
        pattern=pattern,
        columns=columns,
        ignore=None if ignore is None else _pattern(ignore, "dialect.ignore"),
        line_end=line_end.encode(),
        max_line_bytes=max_line_bytes,
        decimal=decimal,
        checksum=kind,
        commands=_commands(commands),
    )
    dialect = LineDialect(grammar, stream, text)
    for number, example in enumerate(examples, start=1):
        _check_example(dialect, _Table(f"example {number}", example), grammar.line_end)
    return dialect


def _columns(said: _Table) -> dict[str, Column]:
    found = {}
    for name, units in _UNITS.items():
        table = said.take(name, dict, needed=name in {"pressure", "deflection"})
        if table is None:
            continue
        column = _Table(f"columns.{name}", table)
        unit = column.take("unit", str, "1" if name == "sequence" else None)
        if unit not in units:
            raise _BadFieldError(
                f"columns.{name}.unit is {unit!r}; expected one of: {', '.join(units)}"
            )
        scale = column.take("scale", float, 1.0)
        offset = column.take("offset", float, 0.0)
        if not (math.isfinite(scale) and scale and math.isfinite(offset)):
            raise _BadFieldError(
                f"columns.{name}.scale is {scale}, offset {offset}; expected finite numbers, "
                "and a scale that is not 0"
            )
        column.end()
        found[name] = Column(unit, scale, offset)
    said.end()
    return found


def _check_groups(
    pattern: re.Pattern[str], columns: Mapping[str, Column], checksum: str | None
) -> None:
    groups = set(pattern.groupindex)
    wanted = set(columns) | ({"checksum"} if checksum else set())
    for name in sorted(wanted - groups):
        raise _BadFieldError(f"dialect.pattern has no group (?P<{name}>...)")
    for name in sorted(groups - wanted - ({"payload"} if checksum else set())):
        if name in _UNITS:
            raise _BadFieldError(
                f"columns.{name} is missing: dialect.pattern has a group {name!r}; expected a "
                f"table [columns.{name}]"
            )
        raise _BadFieldError(
            f"dialect.pattern has a group {name!r}, which is not a column"
            + (" and needs [checksum]" if name in {"checksum", "payload"} else "")
        )


def _stream(said: _Table, model: str, timed: bool) -> Stream:
    names = [field.name for field in fields(Stream)[1:]]
    values = {name: said.take(name, float) for name in names}
    said.end()
    if not timed and values["rate_hz"] is None:
        raise _BadFieldError(
            "stream.rate_hz is missing: without a column time, the times of readings come from it"
        )
    try:
        return Stream(model, **{k: v for k, v in values.items() if v is not None})
    except ValueError as error:
        raise _BadFieldError(f"stream.{error}") from None


def _commands(said: _Table) -> dict[str, bytes]:
    found = {}
    for word in ("start", "stop", "vent", "keep_alive"):
        text = said.take(word, str)
        if text is None:
            continue
        if not 1 <= len(text) <= MAX_LINE_BYTES or any(ord(c) > 0xFF for c in text):
            raise _BadFieldError(f"commands.{word} is {text[:40]!r}; expected 1 to 250 bytes")
        found[word] = text.encode("latin-1")
    said.end()
    return found


def _check_example(dialect: LineDialect, said: _Table, line_end: bytes) -> None:
    line = said.take("line", str, needed=True)
    expected = {
        "pressure_mbar": said.take("pressure_mbar", float, needed=True),
        "deflection_mm": said.take("deflection_mm", float, needed=True),
        "time_s": said.take("time_s", float),
    }
    said.end()
    try:
        reading, _ = dialect.decode_event(line.encode("latin-1", "replace") + line_end)
    except RemoteProtocolError as error:
        raise _BadFieldError(f"{said.where}: {line!r} is not understood: {error}") from None
    for name, value in expected.items():
        found = getattr(reading, name)
        if value is not None and not (
            found is not None and math.isclose(found, value, rel_tol=_ROUNDED, abs_tol=1e-6)
        ):
            raise _BadFieldError(f"{said.where}: {name} is read as {found}; expected {value:g}")


def _verify(kind: str, match: re.Match[str]) -> None:
    groups = match.re.groupindex
    payload = match["payload"] if "payload" in groups else match.string[: match.start("checksum")]
    stated, found = match["checksum"], CHECKSUMS[kind]((payload or "").encode("latin-1"))
    try:
        agrees = int(stated, 16) == found
    except (ValueError, TypeError):
        agrees = False
    if not agrees:
        raise RemoteProtocolError(f"checksum {stated!r}, not {found:X}")


def _pattern(text: str, where: str) -> re.Pattern[str]:
    try:
        return bounded_pattern(text, where)
    except ValueError as error:
        raise _BadFieldError(str(error)) from None
