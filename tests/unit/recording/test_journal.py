"""The journal: what is committed when, what it costs, and what happens where it cannot write."""

from __future__ import annotations

import os
import resource
import sqlite3
import stat
from contextlib import contextmanager

import pytest
from crashes import journal_of_example

from skinlab.errors import InputError
from skinlab.recording import journal as module
from skinlab.recording.audit import Chain, entries
from skinlab.recording.byte_tap import ByteTap
from skinlab.recording.journal import (
    Journal,
    all_left_behind,
    journal_of,
    left_behind,
    read_journal,
    room_bytes,
)
from skinlab.recording.records import Kind


def test_records_keep_their_order_times_and_kind(tmp_path):
    now = iter(range(1000, 2000))
    journal = Journal(tmp_path / "j", {"subject": "P-7"}, now=lambda: float(next(now)))
    journal.raw("rx", 1.0, b"ab")
    journal.raw("tx", 2.0, b"\x00")
    journal.plan(3.0, {"x": 1})
    journal.raw("rx", 0.5, b"before", utc_s=900.0)
    journal.result(4.0, 1, {"error": None})
    journal.close()
    read = read_journal(tmp_path / "j")
    meta, records = read.meta, read.records
    assert meta == {"subject": "P-7"}
    assert [(r.kind, r.host_time_s, r.utc_s) for r in records] == [
        (Kind.RECEIVED, 1.0, 1000.0),
        (Kind.SENT, 2.0, 1001.0),
        (Kind.PLAN, 3.0, 1002.0),
        (Kind.RECEIVED, 0.5, 900.0),
        (Kind.RESULT, 4.0, 1003.0),
    ]
    assert records[0].data == b"ab"


def test_a_journal_that_nobody_closed_is_read_to_its_last_record(tmp_path):
    """As long as it is written, and after a crash, all but its first page is in a file beside."""
    journal = Journal(tmp_path / "j", {"subject": "P-7"})
    for number in range(3000):
        journal.raw("rx", float(number), b"$S,%d" % number)
    journal.flush()
    for name in ("j", "j-wal"):  # what a crash leaves
        (tmp_path / "crashed").mkdir(exist_ok=True)
        (tmp_path / "crashed" / name).write_bytes((tmp_path / name).read_bytes())
    for path in (tmp_path / "j", tmp_path / "crashed" / "j"):
        read = read_journal(path)
        assert [r.host_time_s for r in read.records] == [float(n) for n in range(3000)]
        assert read.skipped == []
    journal.close()


def test_what_a_crash_left_is_found_where_it_says_more_than_the_session(tmp_path):
    session, crashed = tmp_path / "v.h5", tmp_path / "crashed" / "v.h5"
    crashed.parent.mkdir()
    journal = Journal(journal_of(session), {"subject": "P-7"})
    journal.raw("rx", 1.0, b"$S")
    journal.flush()
    for name in ("v.h5.journal", "v.h5.journal-wal"):
        (crashed.parent / name).write_bytes((tmp_path / name).read_bytes())
    assert left_behind(session) is None  # somebody records there
    assert left_behind(crashed) == journal_of(crashed)
    assert all_left_behind(tmp_path) == []
    assert all_left_behind(crashed.parent) == [journal_of(crashed)]
    crashed.touch()
    last = (crashed.parent / "v.h5.journal-wal").stat().st_mtime
    for saved, left in ((last - 5.0, journal_of(crashed)), (last + 5.0, None)):
        os.utime(crashed, (saved, saved))
        assert left_behind(crashed) == left
    journal.close()
    journal.remove()
    assert left_behind(session) is None
    assert all_left_behind(tmp_path / "nowhere") == []


def test_it_and_its_side_files_are_for_their_owner_only(tmp_path):
    before = os.umask(0)
    try:
        journal = Journal(tmp_path / "j", {})
        journal.raw("rx", 1.0, b"x")
        journal.flush()
        modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()}
        journal.close()
    finally:
        os.umask(before)
    assert modes == {"j": 0o600, "j-wal": 0o600, "j-shm": 0o600}


def test_a_steady_stream_does_not_put_off_its_commit(tmp_path, monkeypatch):
    """It waits once, from the first record on, and takes what came meanwhile."""
    waits: list[float] = []

    def sleep(seconds):
        waits.append(seconds)
        if len(waits) == 1:
            for k in range(1, 1000):
                journal.raw("rx", float(k), b"")

    monkeypatch.setattr(module.time, "sleep", sleep)
    journal = Journal(tmp_path / "j", {})
    journal.raw("rx", 0.0, b"")
    journal.flush()  # which may come behind all of them, and waits for itself then
    assert 1 <= len(waits) <= 2
    journal.close()
    times = [r.host_time_s for r in read_journal(tmp_path / "j").records]
    assert times == [float(k) for k in range(1000)]


def test_flush_returns_once_it_is_committed(tmp_path):
    journal = Journal(tmp_path / "j", {})
    for k in range(100):
        journal.raw("rx", float(k), b"x")
    journal.flush()
    with sqlite3.connect(f"file:{tmp_path / 'j'}?mode=ro", uri=True) as other:
        assert other.execute("SELECT count(*) FROM record").fetchone() == (100,)
    other.close()
    journal.close()


@contextmanager
def full_disk(path):
    """While open no file may grow any more; the journal's record "second" meets that."""
    used = path.with_name(path.name + "-wal").stat().st_size
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (used, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def refused(journal):
    """Write into a full disk; one reading is measured all the same."""
    journal.raw("rx", 1.0, b"second")
    with pytest.raises(InputError, match="cannot be written"):
        journal.flush()
    with pytest.raises(InputError, match="make room: the next record tries again"):
        journal.raw("rx", 2.0, b"third")
    for attempt in (
        lambda: journal.audit(2.0, "me", "x"),
        lambda: journal.plan(2.0, {}),
        lambda: journal.require_room(1.0, 1.0),
        lambda: ByteTap().into(journal),
    ):
        with pytest.raises(InputError, match="cannot be written"):
            attempt()


def test_of_a_stream_before_any_measurement_the_first_and_the_last_is_kept(tmp_path):
    """A screen left on overnight kept all of it in memory, and wrote it into every save."""
    tap = ByteTap(now=lambda: 900.0)
    lines = [b"%07d" % k + b"." * 1000 for k in range(4000)]
    for k, line in enumerate(lines):
        tap("rx", float(k), line)
    journal = Journal(tmp_path / "j", {})
    tap.into(journal)
    tap("rx", 4000.0, b"now")
    journal.close()
    kept = [record.data for record in read_journal(tmp_path / "j").records]
    assert kept[:65] == lines[:65]
    assert kept[-2:] == [lines[-1], b"now"]
    assert kept == sorted(kept)
    assert 1.0e6 < sum(map(len, kept)) < 1.2e6


@pytest.fixture
def begun(tmp_path):
    journal = Journal(tmp_path / "j", {})
    journal.raw("rx", 0.0, b"first")
    journal.flush()
    return journal


def told(path):
    """Return the raw records, and what the trail says, of a journal that is whole."""
    read = read_journal(path)
    assert read.skipped == []
    chain = Chain()
    assert [found for r in read.records if (found := chain.complaint(r))] == []
    raw = [r.data for r in read.records if r.kind is Kind.RECEIVED]
    return raw, [e.what for e in entries(read.records)]


AGAIN = "journal written again"


def test_what_could_not_be_committed_is_tried_again_at_the_end(begun):
    with full_disk(begun.path):
        refused(begun)
        whole = read_journal(begun.path)
        assert [r.data for r in whole.records] == [b"first"]  # no half record behind it
    begun.close()
    assert told(begun.path) == ([b"first", b"second", b"third"], [AGAIN])


@pytest.mark.parametrize(
    "write",
    [
        lambda journal: journal.flush(),
        lambda journal: journal.require_room(1.0, 1.0),
        lambda journal: ByteTap().into(journal),
    ],
    ids=["flush", "another run", "another probe"],
)
def test_where_room_was_made_the_journal_goes_on(begun, write):
    """It refused everything until the program was started anew."""
    with full_disk(begun.path):
        refused(begun)
    write(begun)
    assert begun.trouble is None
    begun.raw("rx", 3.0, b"fourth")
    begun.audit(3.0, "me", "x")
    begun.close()
    raw, trail = told(begun.path)
    assert raw == [b"first", b"second", b"third", b"fourth"]
    assert trail == [AGAIN, "x"]


def test_a_record_that_does_not_wait_has_it_tried_again(begun):
    """A probe's thread must not wait for a disk; the one behind it is taken."""
    with full_disk(begun.path):
        refused(begun)
    with pytest.raises(InputError):
        begun.audit(3.0, "me", "not taken")
    begun.flush()
    begun.audit(3.0, "me", "taken")
    begun.close()
    assert told(begun.path)[1] == [AGAIN, "taken"]


def test_a_disk_that_lost_what_was_written_is_not_trusted_again(tmp_path, monkeypatch):
    """What fsync fails for may be gone, whatever it says the next time."""

    def fail(number):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(module, "_SYNC_S", 0.0)
    monkeypatch.setattr(module.os, "fsync", fail)
    journal = Journal(tmp_path / "j", {})
    journal._syncer.join()
    for attempt in (journal.flush, journal.try_again, lambda: journal.raw("rx", 1.0, b"x")):
        with pytest.raises(InputError, match=r"cannot be written .*Input/output error"):
            attempt()
    monkeypatch.undo()
    journal.close()


def test_the_space_that_a_run_needs_is_not_underestimated(tmp_path):
    """A second of 1000 Hz, a commit for each reading of the port, measured on the disk."""
    journal = Journal(tmp_path / "j", {})
    for k in range(50):
        journal.raw("rx", k / 50, bytes(20 * 60))  # 20 samples of up to 60 bytes
        journal.flush()
    used = sum(path.stat().st_size for path in tmp_path.iterdir())
    journal.close()
    assert used < room_bytes(1.0, 1000.0)
    assert room_bytes(60.0, 20.0) < 50e6


def test_a_disk_without_room_is_told_before_the_run(tmp_path, monkeypatch):
    journal = Journal(tmp_path / "j", {})
    journal.require_room(10.0, 20.0)
    usage = module.shutil.disk_usage(tmp_path)
    monkeypatch.setattr(module.shutil, "disk_usage", lambda _: usage._replace(free=1_000_000))
    with pytest.raises(InputError, match=r"1\.0 MB are free .* expected at least"):
        journal.require_room(10.0, 20.0)
    journal.close()


def test_a_journal_that_was_killed_while_it_was_made_says_so(tmp_path):
    (tmp_path / "j").touch()
    with pytest.raises(InputError, match="before anything was recorded"):
        read_journal(tmp_path / "j")


@pytest.mark.parametrize("part", [0.5, 0.7, 0.9, 0.925, 0.99])
def test_a_journal_that_was_cut_off_gives_what_is_left(tmp_path, part):
    path = tmp_path / "j"
    journal_of_example(path).close()
    whole = read_journal(path)
    assert whole.skipped == []
    raw = path.read_bytes()
    path.write_bytes(raw[: int(part * len(raw))])
    left = read_journal(path)
    assert left.meta == whole.meta
    kept = (int(part * len(raw)) // 4096 - 4) * 60  # whole pages, but for those of the tables
    assert kept > 0
    assert left.records[:kept] == whole.records[:kept]
    assert left.skipped


def test_a_record_of_an_impossible_size_is_left_out_before_it_is_read(tmp_path):
    path = tmp_path / "j"
    journal_of_example(path).close()
    whole = read_journal(path)
    with sqlite3.connect(path) as db:
        db.execute("UPDATE record SET data = zeroblob(20000000) WHERE number = 5")
        db.execute("UPDATE record SET kind = zeroblob(20000000) WHERE number = 7")
        db.execute("UPDATE meta SET value = zeroblob(20000000) WHERE rowid = 2")
    db.close()
    left = read_journal(path)
    assert left.records == [*whole.records[:4], whole.records[5], *whole.records[7:]]
    fact, record, kind = left.skipped
    assert kind == "record 7: its kind is -20000000: left out"
    assert "19 MB in one" in fact
    assert record == "record 5: 19 MB in one: left out"


def test_a_journal_with_a_view_in_the_place_of_its_table_is_none(tmp_path):
    """Reading it went on for ever."""
    path = tmp_path / "j"
    journal_of_example(path).close()
    with sqlite3.connect(path) as db:
        db.execute("ALTER TABLE record RENAME TO other")
        db.execute(
            "CREATE VIEW record AS WITH RECURSIVE q(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM q) "
            "SELECT n AS number, n AS kind, n AS host_time_s, n AS utc_s, n AS data FROM q"
        )
    db.close()
    with pytest.raises(InputError, match="statements of its own"):
        read_journal(path)


def test_another_database_is_no_journal(tmp_path):
    with sqlite3.connect(tmp_path / "j") as db:
        db.execute("CREATE TABLE t (x)")
    db.close()
    with pytest.raises(InputError, match="not a journal"):
        read_journal(tmp_path / "j")


def test_audit_entries_are_chained_in_the_order_of_the_file(tmp_path):
    journal = Journal(tmp_path / "j", {}, now=lambda: 0.0)
    journal.audit(1.0, "me", "opened", file="x")
    journal.raw("rx", 2.0, b"x")
    journal.audit(3.0, "me", "closed")
    journal.close()
    found = entries(read_journal(tmp_path / "j").records)
    assert [(e.number, e.who, e.what, e.detail) for e in found] == [
        (1, "me", "opened", {"file": "x"}),
        (2, "me", "closed", {}),
    ]
    assert found[0].utc == "1970-01-01T00:00:00+00:00"
