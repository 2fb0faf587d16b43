from __future__ import annotations

import signal
import threading

import pytest

from drivers.dialects import get_dialect
from drivers.passthrough import listen
from skinlab.acquisition.session_run import plan_of, run_session
from skinlab.acquisition.shutdown import INTERRUPTED, HeldInterrupt, Lifeline
from skinlab.cli.main import run
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.inference.identify import Identifier
from skinlab.recording.audit import entries
from skinlab.recording.session import read_session
from skinlab.recording.stream import CurveCompleted, CurveStarted, Sampled
from skinlab.tables.store import shipped_table

PATIENCE_S = 120.0


class Program:
    def __init__(self):
        self.calls = []
        self.left = threading.Event()
        self.ended = threading.Event()

    def lifeline(self, grace_s=PATIENCE_S):
        return Lifeline(
            lambda reason: self.calls.append(f"vent {reason}"),
            self.leave,
            lambda: self.calls.append("close"),
            self.end,
            grace_s,
        )

    def leave(self):
        self.calls.append("leave")
        self.left.set()

    def end(self, status):
        self.calls.append(f"end {status}")
        self.ended.set()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_vents_first_and_a_screen_that_ends_is_not_killed(number):
    program = Program()
    before = signal.getsignal(number)
    with program.lifeline():
        signal.raise_signal(number)
        assert program.left.wait(PATIENCE_S)
    assert program.calls == [f"vent {number.name}", "leave", "close"]
    assert signal.getsignal(number) is before


def test_a_screen_that_hangs_is_ended_after_all_is_saved():
    program = Program()
    with program.lifeline(grace_s=0.01):
        signal.raise_signal(signal.SIGTERM)
        assert program.ended.wait(PATIENCE_S)
    assert program.calls[-2:] == ["close", f"end {INTERRUPTED}"]


def test_a_thread_that_dies_pulls_it_and_prints_no_traceback(capsys, monkeypatch):
    logged = []
    monkeypatch.setattr("skinlab.acquisition.shutdown.log_exception", logged.append)
    program = Program()

    def write():
        raise OSError("the terminal is gone")

    with program.lifeline():
        threading.Thread(target=write).start()
        assert program.left.wait(PATIENCE_S)
    assert program.calls[0] == "vent a thread failed"
    assert isinstance(logged[0], OSError)
    assert capsys.readouterr().err == ""


def test_nothing_happens_where_nothing_does():
    program = Program()
    with program.lifeline():
        pass
    assert program.calls == []


def test_an_interrupt_is_held_until_it_is_asked_for_and_vents_at_once():
    vented = threading.Event()
    with HeldInterrupt(lambda reason: vented.set()) as held:
        held.check()
        signal.raise_signal(signal.SIGINT)
        assert vented.wait(PATIENCE_S)
        signal.raise_signal(signal.SIGINT)  # one too many
        with pytest.raises(KeyboardInterrupt):
            held.check()


def test_without_a_vent_it_only_holds():
    with HeldInterrupt() as held:
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            held.check()


def test_a_capture_ends_between_two_reads_and_loses_none():
    class Instrument:
        def read(self, most, timeout_s):
            signal.raise_signal(signal.SIGINT)  # comes while a chunk is in hand
            return b"abc"

    chunks = []
    with HeldInterrupt() as held, pytest.raises(KeyboardInterrupt):
        listen(Instrument(), None, chunks.append, lambda: 0.0, None, held.check)
    assert [chunk.data for chunk in chunks] == [b"abc"]


def test_an_alarm_that_is_acknowledged_without_a_person_is_in_the_audit_trail(tmp_path):
    (tmp_path / "f.toml").write_text('[[fault]]\nkind = "unplug"\nat_s = 1.0\nfor_s = 1.0\n')
    out = tmp_path / "s.h5"
    status = run(
        ["measure", "--port", f"sim://?seed=1&speed=5&faults={tmp_path / 'f.toml'}",
         "--aperture-mm", "6", "--thickness-mm", "1", "--program", "ramp:50@20",
         "--rest-s", "0", "--out", str(out)]
    )  # fmt: skip
    assert status == 0
    trail = entries(read_session(out).records)
    alarm = next(e for e in trail if e.what == "alarm")
    acknowledged = next(e for e in trail if e.what == "alarm acknowledged")
    assert acknowledged.number > alarm.number
    assert acknowledged.detail["text"] == alarm.detail["text"]


@pytest.mark.parametrize("seen", [CurveStarted, Sampled, CurveCompleted])
def test_whatever_a_listener_does_the_probe_is_vented_and_the_record_has_it(tmp_path, seen):
    heard = []

    def bad(message):
        heard.append(message)
        if any(isinstance(one, seen) for one in heard):  # from then on, whatever comes
            raise ZeroDivisionError("a bug")

    path = tmp_path / "s.h5"
    plan = plan_of(Setup(6.0, 1.0, parse_program("ramp:50@20")), 2, 0.0, None)
    with pytest.raises(ZeroDivisionError):
        run_session(
            "sim://?seed=1&speed=20", plan, path, Identifier(shipped_table()),
            dialect=get_dialect("reference"), saved=lambda *_: None, listener=bad,
        )  # fmt: skip
    session = read_session(path)
    assert any(e.what == "vent ordered" for e in entries(session.records))
    assert len(session.curves) == 1


def test_an_interrupt_is_the_caller_s_again_afterwards():
    with HeldInterrupt(lambda reason: None):
        pass
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
