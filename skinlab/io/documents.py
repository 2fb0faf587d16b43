"""JSON and TOML from files that anybody may have changed: any damage is a ValueError."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import msgspec
import tomli_w

from skinlab.text import did_you_mean, escaped

Kind = TypeVar("Kind")

_DEEP = "nested too deeply"
_MOST_BYTES = 16 << 20  # of a TOML: the parser takes a quarter of a second a MB
_MOST_DOTS = 5_000  # of one line: a list of so many numbers is no campaign or model


def text_of(raw: bytes) -> str:
    """Return UTF-8 text; the mark that editors of Windows begin it with is left out.

    Raises:
        ValueError: it is none; says where.
    """
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"byte {error.start + 1} is not UTF-8; expected a text file") from None


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
    text = text_of(raw) if isinstance(raw, bytes) else raw.removeprefix("\ufeff")
    # A key of thousands of parts takes the parser a time that grows with their square.
    if any(line.count(".") > _MOST_DOTS for line in text.split("\n")):
        raise ValueError(_DEEP)
    try:
        found: dict[str, Any] = msgspec.toml.decode(text)
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
        told = _counted(_plain(_with_expected(str(error), kind)))
        raise ValueError(told.replace(".*", f".{_key_of(str(error), said, kind)}", 1)) from None


def of_schema(said: Any, schema: str) -> Any:
    """Return decoded tables of a file that is of this schema, or states none.

    Raises:
        ValueError: it is of another one: what kind of file it is comes before its keys.
    """
    stated = said.get("schema") if isinstance(said, dict) else None
    if isinstance(stated, str) and stated != schema:
        raise ValueError(f"schema: {stated!r}, expected {schema!r}")
    return said


def _key_of(message: str, said: Any, kind: Any) -> str:
    """Return the key that msgspec writes as `[...]`: the one that is refused alone as well."""
    path = re.search(r"at `\$\.?([\w.]*)\[\.\.\.\]", message)
    names = [] if path is None else [name for name in path[1].split(".") if name]
    inner = said
    for name in names:
        inner = inner[name]
    for key, value in inner.items() if path is not None and isinstance(inner, dict) else ():
        try:
            msgspec.convert(_with_only(said, names, {key: value}), kind)
        except msgspec.ValidationError as error:
            if str(error) == message:
                return str(key)
    return "*"


def _with_only(said: Any, names: Sequence[str], inner: Any) -> Any:
    """Return what was said, the table at the end of these names replaced."""
    if not names:
        return inner
    return said | {names[0]: _with_only(said[names[0]], names[1:], inner)}


_NOT_KNOWN = re.compile(
    r"(?:Object contains unknown (?P<key>field `.*?`)|Invalid enum value (?P<value>.*?))"
    r"(?P<where>(?: - at `(?P<path>.*)`)?)",
    re.DOTALL,
)


def _with_expected(message: str, kind: Any) -> str:
    """Add to msgspec's message what it leaves out: the keys, or the values, that there are."""
    unknown = _NOT_KNOWN.fullmatch(message)
    if unknown is None:
        return message
    found = _kinds_at(kind, re.findall(r"\w+|\[", unknown["path"] or ""))
    if unknown["key"] is not None:
        what, structs = f"unknown {unknown['key']}", [one for one in found if _is_struct(one)]
        names = sorted({f.encode_name for one in structs for f in msgspec.structs.fields(one)})
        word = unknown["key"][len("field `") : -1]
    else:
        what, word = f"{unknown['value']} is not known", unknown["value"].strip("'")
        names = [str(v) for one in found if get_origin(one) is Literal for v in get_args(one)]
    near = did_you_mean(word, names) or (f"; expected {', '.join(names)}" if names else "")
    return f"{what}{near}{unknown['where']}"


def _counted(message: str) -> str:
    """Count the tables of a list from 1: `step[0]: …` is of step 1."""
    return re.sub(r"^(\w+)\[(\d+)\]", lambda m: f"{m[1]} {int(m[2]) + 1}", message)


def _is_struct(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


def _kinds_at(kind: Any, path: Sequence[str]) -> list[Any]:
    """Return the types that may stand at a path below `kind`."""
    origin = get_origin(kind)
    if origin is Annotated:
        return _kinds_at(get_args(kind)[0], path)
    if origin in {Union, UnionType}:
        return [found for one in get_args(kind) for found in _kinds_at(one, path)]
    if not path:
        return [kind]
    if _is_struct(kind):
        fields = {field.encode_name: field.type for field in msgspec.structs.fields(kind)}
        return _kinds_at(fields.get(path[0]), path[1:])
    if isinstance(origin, type) and issubclass(origin, Mapping | Sequence):
        inner = get_args(kind)
        rest = path[2:] if path[0] == "[" and path[1:2] and path[1].isdigit() else path[1:]
        return _kinds_at(inner[-1] if origin is not tuple else inner[0], rest)
    return []


_KINDS = {
    "str": "a text",
    "int": "an integer",
    "float": "a number",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
    "null": "nothing",
}
_KIND = "|".join(_KINDS)
_EXPECTED = re.compile(
    rf"(?<=[Ee]xpected )`((?:{_KIND})(?: \| (?:{_KIND}))*)`|(?<=got )`({_KIND})`"
)


def _plain(message: str) -> str:
    """Put msgspec's `... - at `$.model.law`` in front, where a reader looks for the field.

    Its types are called as a reader calls them.
    """
    message = re.sub(r"^Object missing required field (`.*?`)", r"\1 is missing", message)
    message = _EXPECTED.sub(
        lambda m: " or ".join(_KINDS[kind] for kind in (m[1] or m[2]).split(" | ")), message
    )
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
