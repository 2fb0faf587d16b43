"""A journal that a crash left, with damage in the file that SQLite keeps beside it."""

from __future__ import annotations

import sqlite3

import pytest

from skinlab.errors import InputError
from skinlab.recording.journal import Journal, read_journal
from skinlab.recording.wal import mended

RECORDS = 200


@pytest.fixture(scope="module")
def left(tmp_path_factory):
    """The journal and its log, as a killed process leaves them."""
    folder = tmp_path_factory.mktemp("journal")
    journal = Journal(folder / "j", {"subject": "P-7"})
    for number in range(RECORDS):
        journal.raw("rx", float(number), b"$S,%d" % number)
        if number % 10 == 0:
            journal.flush()  # a commit of its own, so a frame or more
    journal.flush()
    parts = (folder / "j").read_bytes(), (folder / "j-wal").read_bytes()
    journal.close()
    return parts


@pytest.fixture
def put(tmp_path):
    def make(journal, log):
        (tmp_path / "j").write_bytes(journal)
        if log is not None:
            (tmp_path / "j-wal").write_bytes(log)
        return tmp_path / "j"

    return make


def flipped(data, at):
    return data[:at] + bytes([data[at] ^ 8]) + data[at + 1 :]


def times(path):
    return [record.host_time_s for record in read_journal(path, left=True).records]


def test_a_whole_log_is_left_to_sqlite(left, put):
    journal, log = left
    assert mended(log) is None
    assert mended(log[: len(log) // 2]) is None  # what a crash cuts off was never committed
    assert mended(log + bytes(5000)) is None
    assert mended(b"") is None
    path = put(journal, log)
    assert times(path) == [float(n) for n in range(RECORDS)]
    assert read_journal(path, left=True).skipped == []


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.9])
def test_what_lies_behind_a_damaged_byte_is_kept(left, put, share):
    """SQLite gave nothing from there on, said nothing, and deleted the log."""
    journal, log = left
    broken = flipped(log, int(share * len(log)))
    path = put(journal, broken)
    read = read_journal(path, left=True)
    found = [record.host_time_s for record in read.records]
    assert found[-1] == RECORDS - 1
    assert len(found) > 0.9 * RECORDS
    assert "j-wal is damaged at byte" in read.skipped[0]
    assert path.with_name("j-wal").read_bytes() == broken  # for somebody who knows more


def test_the_mended_log_is_one_that_sqlite_takes(left, put):
    journal, log = left
    whole, at = mended(flipped(log, 40 + 4120))
    assert 32 < at <= 40 + 4120
    with sqlite3.connect(put(journal, whole)) as db:
        assert db.execute("SELECT count(*) FROM record").fetchone()[0] >= 0.9 * RECORDS


def test_an_empty_journal_with_its_log_is_read(left, put):
    _, log = left
    path = put(b"", log)
    assert times(path) == [float(n) for n in range(RECORDS)]
    assert path.with_name("j-wal").read_bytes() == log


def test_a_journal_that_came_without_its_log_asks_for_it(left, put):
    journal, _ = left
    with pytest.raises(InputError, match="what was recorded is in j-wal; expected it beside"):
        read_journal(put(journal, None), left=True)
