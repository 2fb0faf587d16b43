"""The items that records hold: recorded bytes through dialect and connection, as when live."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator

from drivers.connection import Connection
from drivers.dialects import get_dialect
from drivers.errors import RemoteProtocolError
from drivers.events import TimedEvent
from skinlab.recording.records import Kind, Record
from skinlab.recording.stream import Item, Planned, setup_from_json


def recorded_items(records: Iterable[Record], dialect: str = "reference") -> Iterator[Item]:
    """Yield the items that these records hold, through dialect and connection as when live."""
    for _, item in numbered_items(records, dialect):
        yield item


def numbered_items(
    records: Iterable[Record], dialect: str = "reference"
) -> Iterator[tuple[int, Item]]:
    """Yield the items with the index of the record that completed each."""
    connection = Connection(get_dialect(dialect))
    for index, record in enumerate(records):
        if record.kind is Kind.PLAN:
            yield index, Planned(setup_from_json(json.loads(record.data)))
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
