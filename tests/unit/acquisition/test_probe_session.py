from __future__ import annotations

import gc
import sqlite3
import threading
import time
from dataclasses import replace

import pytest

from drivers.errors import DriverError, LinkError
from drivers.events import HostVented, VentConfirmed
from drivers.link import open_link
from drivers.probe import Probe
from drivers.reconnect import Backoff
from skinlab.acquisition.analysis import default_identifier
from skinlab.acquisition.measurement import Policy
from skinlab.acquisition.measurement_messages import Phase
from skinlab.acquisition.measurement_request import Order
from skinlab.acquisition.messages import (
    Connected,
    Disconnected,
    Estimated,
    Failed,
    Heard,
    Over,
    Saved,
    Went,
)
from skinlab.acquisition.probe_session import ProbeSession
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.errors import AcquisitionError, InputError
from skinlab.recording.audit import entries
from skinlab.recording.journal import Journal
from skinlab.recording.session import read_session
from skinlab.recording.session_check import check
from skinlab.recording.stream import CurveCompleted, Happened, Identified, Sampled

PORT = "sim://?seed=1&speed=20"
SLOW = "sim://?seed=1&speed=2"  # where a curve of 50 s is interrupted: 25 s, and 0.5 s waited for
PATIENCE_S = 120.0


def order(program="ramp:100@20", port=PORT):
    return Order(port, "P07", "forearm", Setup(6.0, 1.0, parse_program(program)))


class Room:
    """A probe session whose news are collected, served in a thread."""

    def __init__(self, folder, identifier, make_probe=Probe, **options):
        self.news = []
        self.error = None
        self.session = ProbeSession(
            folder,
            self.news.append,
            make_identifier=lambda: identifier,
            make_probe=make_probe,
            **options,
        )

    def connect(self, port=PORT):
        self.thread = threading.Thread(target=self._serve, args=(port,), daemon=True)
        self.thread.start()
        self.until(lambda: self.of(Connected))

    def _serve(self, port):
        try:
            self.session.serve(port)
        except Exception as error:  # noqa: BLE001
            self.error = error

    def of(self, kind):
        return [n for n in self.news if isinstance(n, kind)]

    def went(self, phase):
        return [n for n in self.of(Went) if n.phase is phase]

    def messages(self, kind):
        return [m for heard in self.of(Heard) for m in heard.messages if isinstance(m, kind)]

    def until(self, condition):
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, self.news[-3:]
            time.sleep(0.005)

    def close(self):
        self.session.close()
        self.thread.join(PATIENCE_S)
        assert not self.thread.is_alive()


@pytest.fixture(scope="module")
def identifier():
    return default_identifier()


@pytest.fixture
def room(tmp_path, identifier):
    return Room(tmp_path, identifier)


class CutLink:
    """A link that can be pulled out."""

    def __init__(self, url):
        self._link = open_link(url)
        self.cut = False

    def read(self, max_bytes, timeout_s):
        if self.cut:
            raise LinkError("pulled out")
        return self._link.read(max_bytes, timeout_s)

    def write(self, data):
        if self.cut:
            raise LinkError("pulled out")
        self._link.write(data)

    def close(self):
        self._link.close()


def test_a_run_is_posted_saved_and_finished(room, tmp_path):
    room.connect()
    room.session.measure(order(), room.session.vents)
    room.until(lambda: room.of(Saved))
    assert len(room.messages(CurveCompleted)) == len(room.messages(Identified)) == 1
    room.close()
    assert room.error is None
    assert isinstance(room.news[-1], Disconnected)
    (path,) = tmp_path.iterdir()
    session = read_session(path)
    assert session.meta["subject"] == "P07"
    assert session.meta["instrument"]["simulated"] is True  # bytes from before the journal


class Cable:
    """What makes links, and can be pulled out and put back."""

    def __init__(self):
        self.links = []
        self.plugged = True

    def open(self, url):
        if not self.plugged:
            raise LinkError(f"cannot open {url}: pulled out")
        self.links.append(CutLink(url))
        return self.links[-1]

    def pull(self):
        self.plugged = False
        self.links[-1].cut = True

    def make_probe(self, url, **options):
        return Probe(url, open_link=self.open, **options)


def test_a_pulled_link_saves_what_was_measured(tmp_path, identifier):
    cable = Cable()
    backoff = Backoff(first_s=0.01, most_s=0.01, give_up_s=0.05)
    room = Room(tmp_path, identifier, cable.make_probe, policy=Policy(backoff))
    room.connect(SLOW)
    room.session.measure(order("ramp:100@2"), room.session.vents)
    room.until(lambda: len(room.messages(Sampled)) > 20)
    cable.pull()
    room.thread.join(PATIENCE_S)
    assert room.error is None
    assert room.messages(CurveCompleted)[0].cut is not None
    assert room.went(Phase.SEARCHING)
    assert "gave up" in room.of(Failed)[0].text
    assert isinstance(room.news[-1], Disconnected)
    saved = room.of(Saved)[-1].path
    assert read_session(saved).curves[0].partial
    room.session.audit("curve excluded", curve=1, text="cut")  # there was no session for it
    room.session.close()
    (path,) = tmp_path.iterdir()
    assert path == saved
    assert "curve excluded" in heads_of(path)[0]


def test_the_visit_goes_on_with_the_next_probe_where_the_search_was_given_up(tmp_path, identifier):
    cable = Cable()
    backoff = Backoff(first_s=0.01, most_s=0.01, give_up_s=0.05)
    room = Room(tmp_path, identifier, cable.make_probe, policy=Policy(backoff))
    room.connect()
    measure(room, order())
    cable.pull()
    room.thread.join(PATIENCE_S)
    cable.plugged = True
    room.news.clear()
    room.connect()
    assert room.of(Connected)[0].goes_on
    measure(room, order())
    room.close()
    (path,) = tmp_path.iterdir()
    assert len(read_session(path).curves) == 2


def back_again(tmp_path, identifier):
    """A room whose link was pulled in a run, and is back; the alarm is acknowledged."""
    cable = Cable()
    backoff = Backoff(first_s=0.01, most_s=0.01, give_up_s=PATIENCE_S)
    room = Room(tmp_path, identifier, cable.make_probe, policy=Policy(backoff))
    room.connect(SLOW)
    room.session.measure(order("ramp:100@2"), room.session.vents)
    room.until(lambda: len(room.messages(Sampled)) > 20)
    cable.pull()
    room.until(lambda: room.went(Phase.SEARCHING))
    room.until(lambda: room.messages(Identified))  # of what there was of the curve
    cable.plugged = True
    room.until(lambda: room.went(Phase.INTERRUPTED))
    left = room.went(Phase.INTERRUPTED)[0].left
    assert (left.setup.cycle, left.setup.repeat, left.repeats) == (2, 1, 1)
    room.session.go_on(room.session.vents)
    room.until(lambda: room.of(Failed))
    assert "acknowledge the alarm" in room.of(Failed)[0].text
    room.session.acknowledge("lift the probe")
    return room


def test_the_cut_repeat_is_taken_again_once_somebody_says_so(tmp_path, identifier):
    room = back_again(tmp_path, identifier)
    room.session.go_on(room.session.vents)
    room.until(lambda: len([m for m in room.messages(Sampled) if m.index == 2]) > 20)
    room.close()
    assert room.error is None
    (path,) = tmp_path.iterdir()
    session = read_session(path)
    assert [curve.setup.cycle for curve in session.curves] == [1, 2]
    assert [curve.setup.repeat for curve in session.curves] == [1, 1]
    assert check(path)[1] == []


@pytest.mark.long
def test_something_else_may_be_measured_in_the_same_session_instead(tmp_path, identifier):
    room = back_again(tmp_path, identifier)
    room.session.measure(order(), room.session.vents)
    room.until(lambda: len(room.messages(Identified)) == 2)
    room.close()
    assert room.error is None
    (path,) = tmp_path.iterdir()
    assert [curve.partial for curve in read_session(path).curves] == [True, False]


def test_closing_ends_the_search(tmp_path, identifier):
    cable = Cable()
    room = Room(tmp_path, identifier, cable.make_probe, policy=Policy(Backoff(20, 1, 20, 20)))
    room.connect()
    cable.pull()
    room.until(lambda: room.went(Phase.SEARCHING))
    room.close()
    assert room.error is None
    assert room.of(Failed) == []


def heads_of(path):
    """Audit entries and curves of a session: what, opening of each curve."""
    session = read_session(path)
    return [e.what for e in entries(session.records)], [
        curve.setup.aperture_mm for curve in session.curves
    ]


def measure(room, order_):
    n = len(room.messages(Identified))
    over = len(room.of(Over))
    room.session.measure(order_, room.session.vents)
    room.until(lambda: len(room.messages(Identified)) > n and len(room.of(Over)) > over)


@pytest.mark.long
def test_a_session_goes_on_with_another_head(tmp_path, identifier):
    probes = []

    def make_probe(url, **options):
        probes.append(Probe(url, **options))
        return probes[-1]

    room = Room(tmp_path, identifier, make_probe)
    room.connect()
    measure(room, order())
    room.session.leave()
    once = probes[-1].dose.suction_mbar_s
    assert once > 250
    room.thread.join(PATIENCE_S)
    assert isinstance(room.news[-1], Disconnected)
    with pytest.raises(LinkError, match="no such port"):  # which harms nothing
        room.session.serve("/dev/no-such-port")
    other = f"{PORT}&aperture_mm=2"
    room.news.clear()
    room.connect(other)
    assert room.of(Connected)[0].goes_on
    setup = Setup(2.0, 1.0, parse_program("ramp:100@20"))
    measure(room, Order(other, "P07", "forearm", setup))
    room.close()
    assert probes[-1].dose.suction_mbar_s > 1.9 * once  # one site, one dose
    assert room.error is None
    (path,) = tmp_path.iterdir()
    deeds, openings = heads_of(path)
    assert openings == [6.0, 2.0]
    assert "probe changed" in deeds
    assert check(path)[1] == []


def test_a_port_whose_dialect_is_none_leaves_room_for_the_next(room, tmp_path):
    """Every further port was "still connected" until the program was started again."""
    with pytest.raises(DriverError, match="dialect 'nope' is not known"):
        room.session.serve("sim://?dialect=nope")
    room.connect()
    measure(room, order())
    room.close()
    assert room.error is None


def test_with_room_again_the_session_goes_on_with_the_next_connection(room, tmp_path, monkeypatch):
    """The disk fills up in a run, which vents. It had been full until the program was ended."""
    full = threading.Event()

    def commit(self, batch, whole=Journal._commit):
        if full.is_set():
            raise sqlite3.OperationalError("database or disk is full")
        whole(self, batch)

    monkeypatch.setattr(Journal, "_commit", commit)
    room.connect(SLOW)
    room.session.measure(order("ramp:100@2"), room.session.vents)
    room.until(lambda: len(room.messages(Sampled)) > 20)
    full.set()
    room.until(lambda: room.messages(CurveCompleted))
    room.until(lambda: room.messages(Identified))  # of what there was of the curve
    assert room.session.recording_failed
    with pytest.raises(InputError, match="make room: the next record tries again"):
        room.session.audit("note", text="not kept")
    room.session.leave()
    room.thread.join(PATIENCE_S)
    with pytest.raises(InputError, match="disk is full"):
        room.session.serve(PORT)  # too early: the session waits on
    full.clear()
    room.news.clear()
    room.connect()
    assert room.of(Connected)[0].goes_on
    assert not room.session.recording_failed
    measure(room, order())
    room.close()
    assert room.error is None
    (path,) = tmp_path.iterdir()
    session, problems = check(path)
    assert problems == []
    assert [curve.partial for curve in session.curves] == [True, False]
    assert len(session.results) == 2
    assert None not in session.results
    deeds = heads_of(path)[0]
    assert "journal written again" in deeds
    assert "note" not in deeds


def test_anew_or_without_a_probe_the_session_is_finished(room, tmp_path):
    room.connect()
    measure(room, order())
    room.session.leave()
    room.thread.join(PATIENCE_S)
    room.news.clear()
    room.thread = threading.Thread(
        target=room.session.serve, args=(PORT,), kwargs={"anew": True}, daemon=True
    )
    room.thread.start()
    room.until(lambda: room.of(Connected))
    assert not room.of(Connected)[0].goes_on
    assert [heads_of(path)[1] for path in tmp_path.glob("*.h5")] == [[6.0]]
    measure(room, order())
    room.session.leave()
    room.close()  # nothing is connected any more
    assert not list(tmp_path.glob("*.journal"))
    assert len(list(tmp_path.glob("*.h5"))) == 2


def test_an_acknowledged_alarm_is_in_the_trail(room, tmp_path):
    room.connect()
    room.session.acknowledge("no session is there yet")
    measure(room, order())
    room.session.acknowledge("the pressure did not fall: lift the probe")
    room.close()
    (path,) = tmp_path.iterdir()
    found = [e.detail for e in entries(read_session(path).records) if e.what.startswith("alarm")]
    assert found == [{"text": "the pressure did not fall: lift the probe"}]


def test_a_vent_that_was_ordered_meanwhile_abandons_the_measurement(room, tmp_path):
    room.connect()
    before = room.session.vents
    room.session.vent("operator")
    with pytest.raises(AcquisitionError, match="vent"):
        room.session.measure(order(), before)
    room.session.measure(order(), room.session.vents)
    room.session.vent("operator")
    room.until(lambda: room.of(Over) or room.of(Failed))
    room.close()
    assert not room.messages(CurveCompleted)
    assert room.error is None


def test_repeats_follow_by_themselves(room, tmp_path):
    room.connect()
    plan = replace(order("ramp:100@50"), repeats=3, rest_s=0.1)
    room.session.measure(plan, room.session.vents)
    room.until(lambda: room.of(Over))
    assert room.of(Over) == [Over(None, 0)]
    room.close()
    (path,) = tmp_path.iterdir()
    setups = [curve.setup for curve in read_session(path).curves]
    assert [(s.cycle, s.repeat) for s in setups] == [(1, 1), (2, 2), (3, 3)]
    assert len(room.went(Phase.RESTING)) == 2


def test_a_bug_in_the_pipeline_vents_and_saves(tmp_path, identifier):
    class Broken:
        def __getattr__(self, name):
            return getattr(identifier, name)

        def __call__(self, *_):
            raise ZeroDivisionError("a bug")

    room = Room(tmp_path, Broken())
    room.connect()
    room.session.measure(order(), room.session.vents)
    room.thread.join(PATIENCE_S)
    assert isinstance(room.error, ZeroDivisionError)
    (path,) = tmp_path.iterdir()
    assert len(read_session(path).curves) == 1


def test_what_was_loaded_is_set_apart_from_garbage_collections(room):
    """A collection stops all threads, and so keep-alive; it must have little to go through."""
    gc.unfreeze()
    try:
        everything = len(gc.get_objects())
        room.session.analysis.prepare()
        assert len(gc.get_objects()) < everything / 10
    finally:
        gc.freeze()  # as conftest.py has left it


def test_no_probe_at_the_port(room, tmp_path):
    with pytest.raises(LinkError, match="no such port"):
        room.session.serve("/dev/no-such-port")
    with pytest.raises(LinkError):
        room.session.measure(order(), 0)
    room.session.close()
    assert list(tmp_path.iterdir()) == []


def test_a_session_that_cannot_be_written_keeps_its_journal(room, tmp_path, monkeypatch):
    from skinlab.recording import recorder as recording

    def refuse(path, content, *, replace):
        raise InputError(f"{path}: cannot be written (disk full)")

    monkeypatch.setattr(recording, "write_session", refuse)
    room.connect()
    room.session.measure(order(), room.session.vents)
    room.until(lambda: room.messages(Identified))
    room.close()
    assert any("disk full" in failed.text for failed in room.of(Failed))
    assert any(path.name.endswith(".journal") for path in tmp_path.iterdir())


def test_an_identification_that_takes_long_holds_nothing_up(tmp_path, identifier):
    release = threading.Event()

    class Slow:
        def __getattr__(self, name):
            return getattr(identifier, name)

        def __call__(self, curve):
            assert release.wait(PATIENCE_S)
            return identifier(curve)

    room = Room(tmp_path, Slow())
    room.connect()
    room.session.measure(order(), room.session.vents)
    room.until(lambda: room.messages(CurveCompleted))
    room.until(lambda: [m for m in room.messages(Happened) if isinstance(m.event, VentConfirmed)])
    room.until(lambda: room.of(Over))
    room.session.measure(order(), room.session.vents)  # even the next run can begin
    room.until(lambda: len(room.went(Phase.ARMING)) == 2)
    room.session.vent("operator")
    vents = [HostVented("operator")]
    room.until(lambda: [m for m in room.messages(Happened) if m.event in vents])
    assert not room.messages(Identified)
    release.set()
    room.until(lambda: room.messages(Identified))
    room.close()
    assert room.error is None
    (path,) = tmp_path.iterdir()
    assert read_session(path).results[0]["parameters"] is not None


def test_a_curve_that_is_identified_at_the_end_is_saved(tmp_path, identifier):
    room = Room(tmp_path, identifier)
    room.connect()
    room.session.measure(order(), room.session.vents)
    room.until(lambda: room.messages(CurveCompleted))
    room.close()
    (path,) = tmp_path.iterdir()
    assert read_session(path).results[0]["parameters"] is not None


def test_estimates_come_while_the_curve_grows(tmp_path, identifier):
    room = Room(tmp_path, identifier)
    room.connect(SLOW)
    room.session.measure(order("ramp:100@2", SLOW), room.session.vents)
    room.until(lambda: len(room.of(Estimated)) > 1)
    assert not room.messages(CurveCompleted)
    estimate = room.of(Estimated)[-1].result
    assert estimate.parameters["X1_MPa"].low is None  # no intervals yet
    room.close()
    assert room.error is None
