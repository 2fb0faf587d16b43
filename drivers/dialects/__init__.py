"""Dialects: one file each is the grammar of one instrument, found by looking.

A module of this folder has a `DIALECT` that meets `Dialect`; an installed package offers one by an
entry point of the group `skinlab.dialects`, `name = "package.module:DIALECT"`. It declares what its
instrument can be asked for (`Capabilities`). It holds both sides of the conversation, so that the
simulated probe and the host share one grammar and every frame can be tested round trip. A plain
line protocol needs no code: a TOML file will do (`drivers/line_dialect.py`).
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import pkgutil
import sys
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from drivers.breakdown import reason
from drivers.capabilities import Capabilities, Stream
from drivers.dialect import Dialect
from drivers.errors import UnknownDialectError

GROUP = "skinlab.dialects"
DEFAULT = "reference"
_KEY = "dialect"  # in a port's URL; pyserial has no option of this name


def dialect_names() -> tuple[str, ...]:
    """Names of all dialects, in this folder and installed, sorted."""
    return tuple(sorted({*_built_in(), *_installed()}))


def stream_of(dialect: Dialect) -> Stream:
    """How the readings of a dialect become runs."""
    stream = getattr(dialect, "stream", None)
    return stream if isinstance(stream, Stream) else Stream()


def get_dialect(name: str) -> Dialect:
    """Get the dialect called `name`, or the one in the file `name`, which ends with `.toml`.

    An error while importing one of ours comes through. Raises UnknownDialectError if there is
    none, DialectFileError for a file that is none or cannot be read.
    """
    if name.lower().endswith(".toml"):
        from drivers.line_dialect import read_line_dialect

        return read_line_dialect(Path(name))
    if name in _built_in():
        ours: Dialect = importlib.import_module(f"{__name__}.{name}").DIALECT
        return ours
    if name in _installed():
        return _installed()[name][0]
    raise UnknownDialectError(
        f"dialect {name!r} is not known; expected one of: {', '.join(dialect_names())}; or a file "
        "that ends with .toml"
    )


def split_dialect(url: str) -> tuple[str, str | None]:
    """Give a port's URL without its `dialect=NAME`, and that name; all else stays as it is.

    Raises UnknownDialectError where it is said twice, or is empty.

    >>> split_dialect("/dev/ttyUSB0?baud=9600&dialect=mine.toml")
    ('/dev/ttyUSB0?baud=9600', 'mine.toml')
    """
    base, question, query = url.partition("?")
    parts = query.split("&") if question else []
    named = [part for part in parts if part.partition("=")[0] == _KEY]
    if not named:
        return url, None
    name = unquote(named[0].partition("=")[2])
    if len(named) > 1 or not name:
        raise UnknownDialectError(f"{url}: expected dialect=NAME once")
    others = [part for part in parts if part not in named]
    return base + ("?" + "&".join(others) if others else ""), name


def describe_dialect(dialect: Dialect) -> dict[str, Any]:
    """All that a record has to keep, so that its bytes can be read again: plain data.

    Of a dialect that is a file, its whole text and the text's hash; of a plugin, where it is from.
    """
    said: dict[str, Any] = {
        "name": dialect.name,
        "version": dialect.protocol_version,
        "read_only": not dialect.capabilities.controllable,
    }
    text = getattr(dialect, "text", None)
    if isinstance(text, str):
        return {**said, "toml": text, "sha256": hashlib.sha256(text.encode()).hexdigest()}
    origin = dialect_origin(dialect.name)
    return said if origin is None else {**said, "plugin": list(origin)}


def described_dialect(said: Any) -> Dialect:
    """Give the dialect that `describe_dialect` described; no other file is needed.

    Raises UnknownDialectError where its plugin is not installed, ValueError for what describes
    none, or another text or version than was used.
    """
    if not isinstance(said, dict) or not isinstance(said.get("name"), str):
        raise ValueError("it describes no dialect")
    text = said.get("toml")
    if text is None:
        dialect = get_dialect(said["name"]) if "." not in said["name"] else None
    elif isinstance(text, str):
        if said.get("sha256") != hashlib.sha256(text.encode()).hexdigest():
            raise ValueError(f"the text of dialect {said['name']!r} does not agree with its hash")
        from drivers.line_dialect import line_dialect

        dialect = line_dialect(text, said["name"])
    else:
        dialect = None
    if dialect is None or dialect.protocol_version != said.get("version"):
        raise ValueError(
            f"it needs version {said.get('version')!r} of dialect {said['name']!r}; here is "
            f"{None if dialect is None else dialect.protocol_version!r}"
        )
    return dialect


def check_dialect(one: Any) -> None:
    """Check that an object is a dialect. Raises TypeError, which says what is missing."""
    missing = [n for n in dir(Dialect) if not n.startswith("_") and not hasattr(one, n)]
    if missing:
        raise TypeError(f"it has no {', '.join(missing)}")
    calls = ("take", "decode_event", "encode_command", "decode_command", "encode_event")
    if silent := [name for name in calls if not callable(getattr(one, name))]:
        raise TypeError(f"its {', '.join(silent)} cannot be called; expected functions")
    if type(one.protocol_version) is not int:
        raise TypeError(f"its protocol_version is {one.protocol_version!r}; expected an int")
    if not isinstance(one.capabilities, Capabilities):
        raise TypeError("its capabilities are not drivers.capabilities.Capabilities")
    if not isinstance(getattr(one, "stream", Stream()), Stream):
        raise TypeError("its stream is not a drivers.capabilities.Stream")


def dialect_origin(name: str) -> tuple[str, str] | None:
    """Distribution and version that a dialect comes from; None: it is one of this folder."""
    if name in _built_in():
        return None
    found = _installed().get(name)
    return None if found is None else found[1]


def dialect_name(dialect: Dialect) -> str:
    """How a sentence names a dialect: with the package that it comes from, if it is installed."""
    origin = dialect_origin(dialect.name)
    if origin is None or get_dialect(dialect.name) is not dialect:
        return f"dialect {dialect.name!r}"
    return f"plugin {origin[0]}, dialect {dialect.name!r}"


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
        entries = [(e, _origin(e)) for e in importlib.metadata.entry_points(group=GROUP)]
    except Exception:  # noqa: BLE001 -- metadata that somebody else has damaged
        return found
    for entry, origin in sorted(entries, key=lambda pair: (pair[0].name, pair[1])):
        who = f"plugin {origin[0]}, dialect {entry.name!r}: left out, because"
        if entry.name in _built_in():
            _warn(f"{who} one of this name is built in")
            continue
        if entry.name in found:
            _warn(f"{who} one of this name comes from {found[entry.name][1][0]}")
            continue
        try:
            one = entry.load()
            check_dialect(one)
            if one.name != entry.name:
                raise TypeError(f"it calls itself {one.name!r}; expected its entry point's name")
            found[entry.name] = one, origin
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 -- anything may be in it
            _warn(f"{who} it is broken: {reason(error)}")
    return found


def _origin(entry: Any) -> tuple[str, str]:
    dist = entry.dist
    return ("unknown", "unknown") if dist is None else (dist.name, dist.version)


def _warn(sentence: str) -> None:
    sentence = "".join(sign if sign.isprintable() else "?" for sign in sentence)
    if sys.stderr is not None:
        with contextlib.suppress(OSError, ValueError):
            sys.stderr.write(f"drivers: {sentence}\n")
