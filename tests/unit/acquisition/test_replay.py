"""Replay: original times, pace, pause and step; differences with their reason."""

from __future__ import annotations

import dataclasses
import threading
from itertools import pairwise
from pathlib import Path

import pytest

from drivers.events import Sample, TimedEvent
from drivers.probe import Probe
from skinlab.acquisition.measure import measure
from skinlab.acquisition.measurement_messages import Plan
from skinlab.acquisition.messages import Played
from skinlab.acquisition.pipeline import Pipeline
from skinlab.acquisition.replay import identifier_of, reasons, replay
from skinlab.acquisition.replay_control import ReplayControl
from skinlab.acquisition.replayer import Replayer
from skinlab.cli.main import run
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.inference.problem import Options
from skinlab.recording.recorded_items import dialect_of, recorded_items
from skinlab.recording.recorder import Recording
from skinlab.recording.session import Session, example_session, read_session, write_session
from skinlab.recording.stream import CurveCompleted, Identified, Sampled
from skinlab.versions import code_hash, versions

SETUP = Setup(6.0, 1.0, parse_program("ramp:100@50"))


class Clock:
    """Time that passes only where somebody sleeps."""

    def __init__(self) -> None:
        self.now = 100.0
        self.naps = 0
        self.at_nap: dict[int, list] = {}

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        assert self.now + seconds > self.now, "a nap that the clock does not show never ends"
        self.now += seconds
        self.naps += 1
        for action in self.at_nap.pop(self.naps, ()):
            action()


@pytest.fixture(scope="module")
def path(tmp_path_factory, grid) -> Path:
    path = tmp_path_factory.mktemp("session") / "s.h5"
    identifier = Identifier(grid, method="sto", options=Options(samples=100))
    recording = Recording(path, identifier, url="sim://")
    with Probe("sim://?seed=1&speed=20", on_bytes=recording.journal.raw) as probe:
        probe.open()
        source = LiveSourceOf(probe, recording)
        measure(source, Plan(SETUP, 2, 0.05), Pipeline(identifier, [recording]))
    recording.finish()
    return path


def LiveSourceOf(probe, recording):
    from skinlab.acquisition.sources import LiveSource

    return LiveSource(probe, recording.journal)


@pytest.fixture(scope="module")
def session(path) -> Session:
    return read_session(path)


def sample_times(session: Session) -> list[float]:
    return [
        item.host_time_s
        for item in recorded_items(session.records, dialect_of(session.meta))
        if isinstance(item, TimedEvent) and isinstance(item.event, Sample)
    ]


def play(session: Session, control: ReplayControl, clock: Clock) -> list[tuple[float, object]]:
    """Messages with the time at which they were told."""
    heard: list[tuple[float, object]] = []
    replay(session, None, [lambda message: heard.append((clock.now, message))], control)
    return heard


@pytest.mark.parametrize("speed", [1.0, 10.0, 0.5])
def test_times_are_kept_at_every_speed(session, speed):
    clock = Clock()
    heard = play(session, ReplayControl(speed, clock=clock, sleep=clock.sleep), clock)
    told = [now for now, message in heard if isinstance(message, Sampled)]
    recorded = sample_times(session)
    events = [
        i
        for i in recorded_items(session.records, dialect_of(session.meta))
        if isinstance(i, TimedEvent)
    ]
    first = events[0].host_time_s
    assert len(told) == len(recorded) > 60
    assert told == pytest.approx([100.0 + (t - first) / speed for t in recorded], abs=1e-6)


def test_slow_listeners_do_not_add_up(session):
    clock = Clock()
    control = ReplayControl(1.0, clock=clock, sleep=clock.sleep)

    def dawdle(message) -> None:
        if isinstance(message, Sampled):
            clock.now += 1e-4

    replay(session, None, [dawdle], control)
    events = [
        i
        for i in recorded_items(session.records, dialect_of(session.meta))
        if isinstance(i, TimedEvent)
    ]
    assert clock.now - 100.0 == pytest.approx(
        events[-1].host_time_s - events[0].host_time_s, abs=0.01
    )


def test_at_full_speed_nobody_sleeps(session):
    clock = Clock()
    heard = play(session, ReplayControl(None, clock=clock, sleep=clock.sleep), clock)
    assert clock.naps == 0
    assert len([m for _, m in heard if isinstance(m, CurveCompleted)]) == 2


def test_a_pause_stands_still_and_what_was_left_to_wait_is_waited(session):
    clock = Clock()
    control = ReplayControl(0.1, clock=clock, sleep=clock.sleep)
    clock.at_nap = {30: [control.pause], 130: [control.resume]}
    told = [now for now, message in play(session, control, clock) if isinstance(message, Sampled)]
    plain = Clock()
    without = [
        now
        for now, message in play(session, ReplayControl(0.1, clock=plain, sleep=plain.sleep), plain)
        if isinstance(message, Sampled)
    ]
    paused_s = 100 * 0.05
    late = [a - b for a, b in zip(told, without, strict=True)]
    assert late[0] == pytest.approx(0.0, abs=1e-6) or late[0] == pytest.approx(paused_s, abs=1e-6)
    assert late[-1] == pytest.approx(paused_s, abs=1e-6)


def test_what_is_due_in_less_than_the_clock_shows_is_due():
    clock = Clock()
    control = ReplayControl(10.0, clock=clock, sleep=clock.sleep)
    assert control.wait(414.4, sample=True)
    clock.now += 0.1
    assert control.wait(415.4 + 5e-14, sample=True)
    assert clock.naps == 0


def test_a_step_lets_one_sample_through(session):
    clock = Clock()
    control = ReplayControl(1.0, paused=True, clock=clock, sleep=clock.sleep)
    heard: list = []
    counts: list[int] = []

    def count() -> None:
        counts.append(sum(isinstance(m, Sampled) for m in heard))
        control.step()

    clock.at_nap = {n: [count] for n in range(10, 15)} | {20: [count, control.resume]}
    replay(session, None, [heard.append], control)
    assert counts == [0, 1, 2, 3, 4, 5]
    assert sum(isinstance(m, CurveCompleted) for m in heard) == 2


def test_the_speed_can_change_on_the_way(session):
    clock = Clock()
    control = ReplayControl(0.01, clock=clock, sleep=clock.sleep)
    clock.at_nap = {50: [lambda: control.set_speed(None)]}
    play(session, control, clock)
    assert clock.naps == 50
    assert control.speed is None
    with pytest.raises(InputError, match="positive"):
        control.set_speed(0.0)
    with pytest.raises(InputError, match="positive"):
        ReplayControl(float("nan"))


def test_a_stopped_replay_ends_with_a_cut_curve(session):
    clock = Clock()
    control = ReplayControl(1.0, clock=clock, sleep=clock.sleep)
    heard: list = []

    def listen(message) -> None:
        heard.append(message)
        if isinstance(message, Sampled) and message.sample.sequence == 20:
            control.stop()

    (curve,) = replay(session, None, [listen], control)
    assert curve.partial
    assert len(curve) == 21
    assert control.stopped


def test_another_thread_may_steer(session):
    """Paused from the start; the thread of a screen steps, waits for the sample, and resumes."""
    control = ReplayControl(None, paused=True)
    came = threading.Event()
    seen: list = []

    def listen(message) -> None:
        if isinstance(message, Sampled):
            seen.append(message)
            came.set()

    thread = threading.Thread(target=lambda: replay(session, None, [listen], control))
    thread.start()
    control.step()
    assert came.wait(30)
    assert len(seen) == 1
    control.resume()
    thread.join(30)
    assert not thread.is_alive()
    assert len(seen) == len(sample_times(session))


def test_results_agree_bit_for_bit_at_any_pace(session):
    identifier, warning = identifier_of(session)
    assert warning is None
    clock = Clock()
    for control in (None, ReplayControl(1.0, clock=clock, sleep=clock.sleep)):
        heard: list = []
        replay(session, identifier, [heard.append], control)
        again = [m.result.to_json() | {"seconds": 0} for m in heard if isinstance(m, Identified)]
        assert again == [result | {"seconds": 0} for result in session.results]


def test_the_shipped_example_is_answered_as_it_was_when_it_was_recorded():
    # Its file is recorded anew whenever an answer changes (docs/decisions/0011). The last bits may
    # be another processor's; a rule that changed moves an end by more than this.
    example = read_session(example_session())
    heard: list = []
    replay(example, identifier_of(example)[0], [heard.append])
    again = [m.result.to_json() for m in heard if isinstance(m, Identified)]
    assert len(again) == len(example.results) > 0
    for now, then in zip(again, example.results, strict=True):
        assert now["flags"] == then["flags"]
        for name, stored in then["parameters"].items():
            near = pytest.approx(stored, abs=1e-3 * (stored["high"] - stored["low"]))
            assert now["parameters"][name] == near, name


@pytest.mark.parametrize(
    ("share", "agrees"), [(0.0, "bit for bit"), (1e-9, "to a millionth"), (1e-5, "")]
)
def test_rounding_is_no_difference(session, tmp_path, capsys, share, agrees):
    """A visit that was recorded on another processor differed in every number."""

    def off(part):
        if isinstance(part, dict):
            return {key: off(value) for key, value in part.items()}
        return part * (1.0 + share) if isinstance(part, float) else part

    results = [result | {"parameters": off(result["parameters"])} for result in session.results]
    out = tmp_path / "s.h5"
    write_session(out, dataclasses.replace(session, results=results))
    assert run(["replay", str(out), "--verify"]) == (0 if agrees else 1)
    told = capsys.readouterr()
    assert f"agree {agrees}" in told.out if agrees else "parameters was" in told.err


def test_nothing_is_named_where_nothing_is_different(session):
    assert reasons(session, identifier_of(session)[0]) == []


def test_reasons_name_what_is_not_as_it_was(session):
    meta = session.meta | {
        "versions": versions() | {"numpy": "0.1", "code": "abc", "machine": "PDP-11"},
        "identification": session.meta["identification"] | {"database_hash": "sha256:1"},
    }
    other = dataclasses.replace(session, meta=meta)
    identifier, warning = identifier_of(other)
    assert "another database, sha256:1; here is sha256:" in warning
    found = reasons(other, identifier)
    assert found[0].startswith("another database: it was sha256:1, is sha256:")
    assert f"another version of skinlab's source files: it was abc, is {code_hash()}" in found
    assert any(text.startswith("another version of numpy: it was 0.1, is ") for text in found)
    assert any(text.startswith("another machine: it was PDP-11, is ") for text in found)


def test_the_command_explains_a_difference(session, tmp_path, capsys):
    result = session.results[0] | {"error_um": 9.0}
    other = dataclasses.replace(session, results=(result, session.results[1]))
    write_session(tmp_path / "a.h5", other)
    assert run(["replay", str(tmp_path / "a.h5"), "--verify"]) == 1
    told = capsys.readouterr().err
    assert "curve 1: error_um was 9.0, is " in told
    assert "same software, database and machine" in told
    meta = session.meta | {"versions": versions() | {"skinlab": "0.0.9"}}
    write_session(tmp_path / "b.h5", dataclasses.replace(other, meta=meta))
    assert run(["replay", str(tmp_path / "b.h5"), "--verify"]) == 1
    assert "a reason: another version of skinlab: it was 0.0.9" in capsys.readouterr().err


def test_a_pause_needs_a_terminal(path):
    assert run(["replay", str(path), "--paused"]) == 3


def test_the_time_goes_on_where_nothing_was_recorded(tmp_path):
    """The example is silent between its two runs."""
    posted, seen = [], threading.Event()
    session = read_session(example_session())
    items = recorded_items(session.records, dialect_of(session.meta))
    times = [item.host_time_s for item in items if isinstance(item, TimedEvent)]
    begin, end = max(pairwise(times), key=lambda pair: pair[1] - pair[0])
    middle = (begin + end) / 2

    def post(news):
        posted.append(news)
        if isinstance(news, Played) and middle < news.at_s + times[0] < end:
            seen.set()

    replayer = Replayer(tmp_path, post)
    replayer.again(ahead_s=begin - times[0])
    playing = threading.Thread(target=replayer.serve, args=(str(example_session()),))
    playing.start()
    assert seen.wait(60.0)
    replayer.close()
    playing.join(60.0)
    assert not playing.is_alive()
