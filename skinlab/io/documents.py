"""JSON and TOML from files that anybody may have changed: any damage is a ValueError."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin

import msgspec
import tomli_w

from skinlab.text import did_you_mean, escaped

Kind = TypeVar("Kind")

_DEEP = "nested too deeply"
_MOST_BYTES = 16 << 20  # of a TOML: the parser takes a quarter of a second a MB
_MOST_DOTS = 5_000  # of one line: a list of so many numbers is no campaign or model


def read_json(text: str | bytes) -> Any:
    """Return what a JSON text says.

    Raises:
        ValueError: it is none, or nested too deeply.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError(_DEEP) from None


def read_json_object(text: str | bytes) -> dict[str, Any]:
    """Return what a JSON text says, which must be an object.

    Raises:
        ValueError: it is none, or nested too deeply.
    """
    found = read_json(text)
    if not isinstance(found, dict):
        raise ValueError(f"{type(found).__name__} in the place of an object")
    return found


def read_toml(raw: bytes | str) -> dict[str, Any]:
    """Return the tables of a TOML text.

    Raises:
        ValueError: it is none, is no UTF-8, is nested too deeply, or is very large.
    """
    if len(raw) > _MOST_BYTES:
        raise ValueError(f"{len(raw) >> 20} MB of text; expected at most {_MOST_BYTES >> 20} MB")
    # A key of thousands of parts takes the parser a time that grows with their square.
    dots, line_end = (b".", b"\n") if isinstance(raw, bytes) else (".", "\n")
    if any(line.count(dots) > _MOST_DOTS for line in raw.split(line_end)):  # type: ignore[arg-type]
        raise ValueError(_DEEP)
    try:
        found: dict[str, Any] = msgspec.toml.decode(raw)
    except RecursionError:
        raise ValueError(_DEEP) from None
    return found


def decode(said: Any, kind: type[Kind]) -> Kind:
    """Return decoded tables as a struct.

    Raises:
        ValueError: a key is unknown (with the one that was probably meant), missing, or of another
            type; the field comes first.
    """
    try:
        return msgspec.convert(said, kind)
    except msgspec.ValidationError as error:
        unknown = re.fullmatch(r"Object contains unknown field `(.*?)`(.*)", str(error), re.DOTALL)
        if unknown is None:
            raise ValueError(_counted(plain(str(error)))) from None
        key, where = unknown.groups()
        place = re.fullmatch(r" - at `\$(.*)`", where, re.DOTALL)
        names = sorted(_known_keys(kind, re.findall(r"\w+|\[", place[1] if place else "")))
        near = did_you_mean(key, names) or (f"; expected {', '.join(names)}" if names else "")
        raise ValueError(_counted(plain(f"unknown field `{key}`{near}{where}"))) from None


def _counted(message: str) -> str:
    """Count the tables of a list from 1: `step[0]: …` is of step 1."""
    return re.sub(r"^(\w+)\[(\d+)\]", lambda m: f"{m[1]} {int(m[2]) + 1}", message)


def _known_keys(kind: Any, path: Sequence[str]) -> set[str]:
    """Return the keys of the struct at a path below `kind`; nothing where that is none."""
    origin = get_origin(kind)
    if origin in {Union, UnionType}:
        return set().union(*(_known_keys(one, path) for one in get_args(kind)))
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        fields = {field.encode_name: field.type for field in msgspec.structs.fields(kind)}
        if not path:
            return set(fields)
        return _known_keys(fields.get(path[0]), path[1:])
    if path and isinstance(origin, type) and issubclass(origin, Mapping | Sequence):
        inner = get_args(kind)
        rest = path[2:] if path[0] == "[" and path[1:2] and path[1].isdigit() else path[1:]
        return _known_keys(inner[-1] if origin is not tuple else inner[0], rest)
    return set()


def plain(message: str) -> str:
    """Put msgspec's `... - at `$.model.law`` in front, where a reader looks for the field."""
    match = re.fullmatch(r"(.*) - at `(?:key in )?\$\.?(.*)`", message, re.DOTALL)
    if match is None:
        return message
    what, where = match.groups()
    return f"{where.replace('[...]', '.*')}: {what[:1].lower()}{what[1:]}" if where else what


def toml_text(tables: dict[str, Any]) -> str:
    """Return tables as TOML; what is None is left out, and nothing in it acts on a terminal."""
    return escaped(tomli_w.dumps(_without_none(tables)))


def _without_none(value: Any) -> Any:
    if isinstance(value, list):
        return [_without_none(v) for v in value]
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return value
