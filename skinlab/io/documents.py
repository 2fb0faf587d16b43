"""JSON and TOML from files that anybody may have changed: any damage is a ValueError."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import tomli_w

from skinlab.text import escaped

_DEEP = "nested too deeply"
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
        ValueError: it is none, is no UTF-8, or is nested too deeply.
    """
    # A key of thousands of parts takes the parser a time that grows with their square.
    dots, line_end = (b".", b"\n") if isinstance(raw, bytes) else (".", "\n")
    if any(line.count(dots) > _MOST_DOTS for line in raw.split(line_end)):  # type: ignore[arg-type]
        raise ValueError(_DEEP)
    try:
        found: dict[str, Any] = msgspec.toml.decode(raw)
    except RecursionError:
        raise ValueError(_DEEP) from None
    return found


def toml_text(tables: dict[str, Any]) -> str:
    """Return tables as TOML; what is None is left out, and nothing in it acts on a terminal."""
    return escaped(tomli_w.dumps(_without_none(tables)))


def _without_none(value: Any) -> Any:
    if isinstance(value, list):
        return [_without_none(v) for v in value]
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return value
