"""The items that records hold: recorded bytes through dialect and connection, as when live."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from drivers.connection import Connection
from drivers.dialects import get_dialect
from drivers.errors import RemoteProtocolError
from drivers.events import TimedEvent
from skinlab.io.documents import read_json_object
from skinlab.recording.records import Kind, Record
from skinlab.recording.stream import Item, Planned, setup_from_json


def _ignore(_: str) -> None:
    return


def recorded_items(
    records: Iterable[Record],
    dialect: str = "reference",
    damaged: Callable[[str], None] = _ignore,
) -> Iterator[Item]:
    """Yield the items that these records hold, through dialect and connection as when live."""
    for _, item in numbered_items(records, dialect, damaged):
        yield item


def numbered_items(
    records: Iterable[Record],
    dialect: str = "reference",
    damaged: Callable[[str], None] = _ignore,
) -> Iterator[tuple[int, Item]]:
    """Yield the items with the index of the record that completed each.

    A plan that cannot be read is told to `damaged` in a sentence; no curve is made of its run,
    because nobody knows what it was of.
    """
    connection = Connection(get_dialect(dialect))
    for index, record in enumerate(records):
        if record.kind is Kind.PLAN:
            try:
                setup = setup_from_json(read_json_object(record.data))
            except (ValueError, TypeError, KeyError, OverflowError) as error:
                damaged(f"record {index + 1}, a plan, cannot be read ({error}): no curve of it")
                yield index, Planned(None)
            else:
                yield index, Planned(setup)
        elif record.kind is Kind.RECEIVED:
            try:
                connection.receive_data(record.data)
            except RemoteProtocolError:
                continue  # the live run dropped these bytes too
            for item in _events(connection, record.host_time_s):
                yield index, item


def _events(connection: Connection, host_time_s: float) -> Iterator[Item]:
    while True:
        try:
            event = connection.next_event()
        except RemoteProtocolError:
            continue
        if event is None:
            return
        yield TimedEvent(host_time_s, event)
