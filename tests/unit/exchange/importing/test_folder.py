"""A watched folder: each file once, when it is complete."""

from __future__ import annotations

import os

import pytest

from skinlab.acquisition.replay import differences, identifier_of, replay
from skinlab.curves.curve import Setup
from skinlab.errors import InputError
from skinlab.exchange.importing.folder import Folder
from skinlab.exchange.importing.questions import Answers
from skinlab.exchange.importing.reader import import_bytes
from skinlab.exchange.importing.session import Who
from skinlab.exchange.importing.watch import Watch, watch
from skinlab.inference.identify import Identifier
from skinlab.recording.session import read_session
from skinlab.recording.session_check import check
from skinlab.recording.stream import Identified

WHO = Who("P-7", "forearm", "somebody", clock=lambda: 0.0, now=lambda: 0.0)
CURVE = "t (s);p (mbar);w (mm)\n" + "".join(
    f"{0.1 * i:.1f};{2 * i};{0.006 * i:.3f}\n" for i in range(51)
)


def names(arrivals):
    return [arrival.path.name for arrival in arrivals]


def test_a_file_is_taken_once_it_rests(tmp_path):
    folder = Folder(tmp_path, settle_s=1.0)
    file = tmp_path / "a.csv"
    file.write_text("")
    assert names(folder.poll(0.0)) == []
    assert names(folder.poll(5.0)) == []  # empty: not begun
    file.write_text("half")
    assert names(folder.poll(6.0)) == []
    assert names(folder.poll(6.9)) == []
    file.write_text("half and whole")  # it grew: the wait begins anew
    assert names(folder.poll(7.1)) == []
    assert names(folder.poll(8.0)) == []
    (arrival,) = folder.poll(8.2)
    assert (arrival.path, arrival.data, arrival.continues) == (file, b"half and whole", False)
    assert names(folder.poll(20.0)) == []


def test_a_file_of_any_size_is_not_read_whole(tmp_path, monkeypatch):
    for module in ("folder", "reader"):
        monkeypatch.setattr(f"skinlab.exchange.importing.{module}.MOST_BYTES", 1 << 20)
    (tmp_path / "a.csv").write_bytes(b"1" * (3 << 20))
    folder = Folder(tmp_path, settle_s=0.0)
    folder.poll(0.0)
    (arrival,) = folder.poll(1.0)
    assert len(arrival.data) == (1 << 20) + 1
    with pytest.raises(InputError, match=r"a\.csv: larger than 1 MB"):
        import_bytes(arrival.path, arrival.data, Setup(6.0, 1.0), Answers())


def test_a_file_renamed_into_place_or_out_of_it(tmp_path):
    folder = Folder(tmp_path, settle_s=1.0)
    (tmp_path / "a.csv.part").write_text("1")
    for now in (0.0, 2.0):
        assert names(folder.poll(now)) == []
    (tmp_path / "a.csv.part").rename(tmp_path / "a.csv")
    assert names(folder.poll(3.0)) == []
    assert names(folder.poll(4.0)) == ["a.csv"]
    (tmp_path / "a.csv").rename(tmp_path / "b.csv")  # taken already, whatever it is called
    for now in (5.0, 7.0):
        assert names(folder.poll(now)) == []


def test_the_same_content_is_not_taken_again_and_another_is(tmp_path):
    folder = Folder(tmp_path, settle_s=1.0)
    file = tmp_path / "a.csv"
    file.write_text("one")
    folder.poll(0.0)
    assert names(folder.poll(1.0)) == ["a.csv"]
    os.utime(file, (1, 1))
    folder.poll(2.0)
    assert names(folder.poll(3.0)) == []
    file.write_text("one and more")
    folder.poll(4.0)
    (arrival,) = folder.poll(5.0)
    assert arrival.continues
    file.write_text("other")
    folder.poll(6.0)
    (arrival,) = folder.poll(7.0)
    assert not arrival.continues


def test_only_plain_files_that_may_be_exports(tmp_path):
    for name in ("a.h5", ".hidden.csv", "~$a.xlsx", "a.exe", "noend"):
        (tmp_path / name).write_text("x")
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "gone.csv").symlink_to(tmp_path / "nowhere")
    (tmp_path / "A.TXT").write_text("x")
    folder = Folder(tmp_path, settle_s=1.0)
    folder.poll(0.0)
    assert names(folder.poll(1.0)) == ["A.TXT"]


def test_the_oldest_comes_first(tmp_path):
    for name, age in (("b.csv", 100), ("a.csv", 200), ("c.csv", 300)):
        (tmp_path / name).write_text(name)
        os.utime(tmp_path / name, (age, age))
    folder = Folder(tmp_path, settle_s=1.0)
    folder.poll(0.0)
    assert names(folder.poll(1.0)) == ["b.csv", "a.csv", "c.csv"]


def test_a_folder_that_is_gone(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        Folder(tmp_path / "absent").poll(0.0)


class Done(BaseException):
    """Ends the watch, as Ctrl-C does."""


def test_what_lands_is_identified_and_kept(tmp_path, table):
    """A good file, a bad one, one that goes on, one that is replaced; the session after each."""
    exports, out = tmp_path / "exports", tmp_path / "s.h5"
    exports.mkdir()
    watcher = Watch(out, Setup(6, 1), Answers(), Identifier(table), WHO)
    told, kept, time_s = [], [], [0.0]
    steps = [
        lambda: (exports / "a.csv").write_text(CURVE.replace("0.006", "0.005")),
        lambda: (exports / "bad.csv").write_text("nothing"),
        lambda: (exports / "b.csv").write_text(CURVE[: CURVE.index("2.5;")]),
        lambda: (exports / "b.csv").write_text(CURVE),
        lambda: (exports / "a.csv").write_text(CURVE.replace("0.006", "0.007")),
        lambda: (exports / "bad.csv").write_text(CURVE.replace("0.006", "0.008")),
        lambda: (exports / "copy.csv").write_text(CURVE),
    ]

    def sleep(seconds):
        time_s[0] += seconds
        if time_s[0] % 4 == 0:
            if told:
                kept.append([(c.name, len(c)) for c in read_session(out).curves])
            if not steps:
                raise Done
            steps.pop(0)()

    with pytest.raises(Done):
        watch(
            Folder(exports),
            watcher,
            told.append,
            pytest.fail,
            lambda: time_s[0],
            sleep,
            lambda: None,
            poll_s=1.0,
        )
    assert [one.path.name for one in told] == [
        "a.csv",
        "bad.csv",
        "b.csv",
        "b.csv",
        "a.csv",
        "bad.csv",
        "copy.csv",
    ]
    assert [one.imported is None for one in told] == [False, True, *[False] * 4, True]
    assert "copy.csv: the same readings as b.csv" in told[-1].result.error
    assert kept == [
        [("a.csv", 51)],
        [("a.csv", 51)],
        [("a.csv", 51), ("b.csv", 25)],
        [("a.csv", 51), ("b.csv", 51)],
        [("a.csv", 51), ("b.csv", 51), ("a.csv (2)", 51)],
        *[[("a.csv", 51), ("bad.csv", 51), ("b.csv", 51), ("a.csv (2)", 51)]] * 2,
    ]
    session = read_session(out)
    assert all(result["parameters"] for result in session.results)
    assert check(out)[1] == []
    assert (session.meta["subject"], session.meta["site"]) == ("P-7", "forearm")
    assert watcher.save() == out
    again: list = []
    curves = replay(session, identifier_of(session)[0], [again.append])
    results = [m.result for m in again if isinstance(m, Identified)]
    assert len(results) == 4
    assert differences(session, curves, results) == []


def test_a_session_that_cannot_be_written_is_tried_again(tmp_path, table):
    exports, out = tmp_path / "exports", tmp_path / "no" / "s.h5"
    exports.mkdir()
    (tmp_path / "no").write_text("in the way")
    watcher = Watch(out, Setup(6, 1), Answers(), Identifier(table), WHO)
    (exports / "a.csv").write_text(CURVE)
    folder = Folder(exports, settle_s=1.0)
    folder.poll(0.0)
    (arrival,) = folder.poll(1.0)
    watcher.take(arrival)
    with pytest.raises(InputError, match="cannot be written"):
        watcher.save()
    (tmp_path / "no").unlink()
    assert watcher.save() == out
    assert len(read_session(out).curves) == 1


@pytest.mark.parametrize(
    ("before", "stated", "measured"),
    [
        (False, "", "1970-01-01T00:00:05+00:00"),
        (True, "", None),
        (True, "2020-01-02", "2020-01-02"),
    ],
)
def test_a_session_was_measured_as_its_first_file_landed(tmp_path, table, before, stated, measured):
    """A file that lay there before anybody watched may be of any day."""
    out, time_s = tmp_path / "s.h5", [0.0]
    who = Who("P-7", "forearm", "somebody", clock=lambda: 0.0, now=lambda: time_s[0])
    watcher = Watch(out, Setup(6, 1), Answers(), Identifier(table), who, stated)
    folder = Folder(tmp_path)
    for name, at_s, step in (("a.csv", 0.0 if before else 4.0, "5"), ("b.csv", 9.0, "8")):
        if not before or name != "a.csv":
            folder.poll(at_s - 1)
        (tmp_path / name).write_text(CURVE.replace("0.006", f"0.00{step}"))
        folder.poll(at_s)
        time_s[0] = at_s + 1
        (arrival,) = folder.poll(time_s[0])
        watcher.take(arrival)
        watcher.save()
    meta = read_session(out).meta
    assert len(meta["imported"]) == 2
    assert meta.get("measured_utc") == measured
