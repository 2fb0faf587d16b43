"""The items that records hold: recorded bytes through dialect and connection, as when live."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from drivers.capabilities import READ_ONLY
from drivers.connection import Connection
from drivers.dialect import Dialect
from drivers.dialects import DEFAULT, describe_dialect, described_dialect, get_dialect
from drivers.errors import BrokenDialectError, RemoteProtocolError
from drivers.events import Identify, TimedEvent
from drivers.stream import StreamConnection, connect
from skinlab.errors import InputError
from skinlab.io.documents import read_json_object
from skinlab.plugins import warn
from skinlab.recording.records import Kind, Record
from skinlab.recording.stream import Item, Planned, setup_from_json
from skinlab.versions import missing_plugins


def _ignore(_: str) -> None:
    return


def dialect_facts(dialect: Dialect) -> dict[str, Any]:
    """Return what a session states of its dialect, so that its bytes can be read again."""
    facts = {"dialect": describe_dialect(dialect)}
    return facts if dialect.capabilities.controllable else {**facts, "control": READ_ONLY}


def dialect_of(meta: Mapping[str, Any]) -> Dialect:
    """Return the dialect of a session's bytes; the first sessions do not say it: `reference`.

    Raises:
        InputError: it is not there, or was another one.
    """
    said = meta.get("dialect")
    if said is None:
        return get_dialect(DEFAULT)
    try:
        return described_dialect(said)
    except ValueError as error:  # all that a dialect raises is one
        missing = missing_plugins(_versions_of_dialect(said) or meta.get("versions"))
        raise InputError(
            f"the session's field dialect: {error}{f'; {missing}' if missing else ''}"
        ) from None


def _versions_of_dialect(said: object) -> dict[str, str] | None:
    """Return the package that a session's dialect came from, as `versions` says it."""
    plugin = said.get("plugin") if isinstance(said, dict) else None
    if not isinstance(plugin, list) or len(plugin) != 2:
        return None
    return {f"plugin {plugin[0]}": str(plugin[1])}


def recorded_items(
    records: Iterable[Record],
    dialect: Dialect,
    damaged: Callable[[str], None] = _ignore,
) -> Iterator[Item]:
    """Yield the items that these records hold, through dialect and connection as when live."""
    for _, item in numbered_items(records, dialect, damaged):
        yield item


def numbered_items(
    records: Iterable[Record],
    dialect: Dialect,
    damaged: Callable[[str], None] = _ignore,
) -> Iterator[tuple[int, Item]]:
    """Yield the items with the index of the record that completed each.

    A plan that cannot be read is told to `damaged` in a sentence; no curve is made of its run,
    because nobody knows what it was of.
    """
    connection = connect(dialect)
    begun = not isinstance(connection, StreamConnection)
    for index, record in enumerate(records):
        if record.kind is Kind.PLAN:
            try:
                setup = setup_from_json(read_json_object(record.data))
            except (ValueError, TypeError, KeyError, OverflowError) as error:
                damaged(f"record {index + 1}, a plan, cannot be read ({error}): no curve of it")
                yield index, Planned(None)
            else:
                yield index, Planned(setup)
        elif record.kind is Kind.RECEIVED or record.kind is Kind.MARK:
            if not begun:
                connection.send(Identify())
                begun = True
            try:
                if record.kind is Kind.RECEIVED:
                    connection.receive_data(record.data, record.host_time_s)
                elif isinstance(connection, StreamConnection):
                    connection.mark(record.data)
            except RemoteProtocolError:
                continue  # the live run dropped these bytes too
            for item in _events(connection, record.host_time_s):
                yield index, item


def _events(connection: Connection | StreamConnection, host_time_s: float) -> Iterator[Item]:
    while True:
        try:
            event = connection.next_event()
        except RemoteProtocolError:
            continue
        except BrokenDialectError as error:  # the live run went on with what came behind it
            warn(str(error))
            return
        if event is None:
            return
        yield TimedEvent(host_time_s, event)
