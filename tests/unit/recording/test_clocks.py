"""The instrument's clock against the host's: told from the bytes, kept in the session, shown."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest

from drivers.dialects import get_dialect
from drivers.events import PROGRAM_DONE, PROGRAM_END, Hello, Pace, Sample, State
from drivers.events import InstrumentState as S
from skinlab.cli.main import run
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.recording.clocks import clock_readings, compare_clocks
from skinlab.recording.records import Kind, Record
from skinlab.recording.session import session_from_records, write_session
from skinlab.recording.session_check import check
from skinlab.recording.stream import setup_to_json
from skinlab.report.session_text import clock_warning

WIRE = get_dialect("reference")
SETUP = Setup(6.0, 1.0, parse_program("ramp:100@20"))
HELLO = Hello("reference", 1, "clock", "1", "1", 6.0, 500.0, 60.0, 1.0, 1000.0, simulated=True)
UTC_S = 1.7e9


def late(rng, n):
    """How late samples come: a millisecond, and now and then a burst after a stall."""
    return 1e-3 + rng.exponential(1e-3, n) + np.where(rng.random(n) < 0.03, 0.2, 0.0)


def records(clock, *, runs=1, pace=1.0, seed=0):
    """What is recorded of an instrument whose clock shows `clock(t)` at the host's time t."""
    rng = np.random.default_rng(seed)
    opening = [HELLO, *([] if pace == 1.0 else [Pace(pace)]), State(S.IDLE, "", 0.0)]
    said = [Record(Kind.RECEIVED, 10.0, UTC_S, WIRE.encode_event(event)) for event in opening]
    for number in range(runs):
        begin = 20.0 + 60.0 * number

        def note(host_s, event):
            said.append(
                Record(Kind.RECEIVED, host_s, UTC_S + host_s - 10.0, WIRE.encode_event(event))
            )

        plan = json.dumps(setup_to_json(SETUP)).encode()
        said.append(Record(Kind.PLAN, begin, UTC_S + begin - 10.0, plan))
        note(begin, State(S.RUNNING, "started", 0.0))
        true_s = np.arange(100) * 0.05 / pace
        comes = np.maximum.accumulate(begin + true_s + late(rng, 100))
        for k, (t, host_s) in enumerate(zip(true_s, comes, strict=True)):
            shown = clock(t * pace + 60.0 * number) - clock(60.0 * number)
            note(float(host_s), Sample(k, float(shown), 20.0 * t * pace, 0.004 * t * pace, 0))
        note(begin + 5.1 / pace, State(S.VENTING, PROGRAM_END, 1.0))
        note(begin + 5.2 / pace, State(S.LOADED, PROGRAM_DONE, 0.0))
    return said


@pytest.mark.parametrize("off", [-0.02, 0.0, 0.02])
def test_a_clock_that_is_off_is_told(off):
    (clock,) = clock_readings({}, records(lambda t: (1 + off) * t))
    assert clock.rate == pytest.approx(1 + off, abs=2 * clock.rate_uncertainty)
    assert clock.rate_uncertainty < 2e-3
    assert clock.host_time_s == pytest.approx(20.0, abs=5e-3)
    assert clock.utc_s == pytest.approx(UTC_S + 10.0, abs=5e-3)
    assert clock.wander_s < 5e-3


def test_a_clock_that_drifts_is_told_from_curve_to_curve():
    """It gains 2 % in the first minute, and 0.5 % more in each that follows."""
    clocks = clock_readings({}, records(lambda t: 1.02 * t + 0.005 / 120.0 * t**2, runs=4))
    rates = np.array([clock.rate for clock in clocks])
    assert rates == pytest.approx(1.02 + 0.005 * (np.arange(4) + 2.5 / 60.0), abs=1.5e-3)
    assert [c.host_time_s for c in clocks] == pytest.approx([20, 80, 140, 200], abs=5e-3)


def test_the_pace_of_a_simulation_is_no_clock_that_is_off():
    (clock,) = clock_readings({}, records(lambda t: 1.01 * t, pace=5.0))
    assert clock.rate == pytest.approx(1.01, abs=3 * clock.rate_uncertainty)


def test_a_clock_that_wanders_is_told():
    (clock,) = clock_readings({}, records(lambda t: t + 0.05 * np.sin(2 * np.pi * t / 5)))
    assert 0.01 < clock.wander_s < 0.05


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e308])
def test_times_that_cannot_be_give_no_clock_and_no_warning(bad):
    device_s = np.arange(100) * 0.05
    assert compare_clocks(device_s, np.full(100, bad)) is None
    assert compare_clocks(device_s[:3], device_s[:3]) is None
    assert compare_clocks(np.zeros(100), device_s) is None


def test_it_is_kept_in_the_session_and_said(tmp_path, capsys):
    path = tmp_path / "s.h5"
    write_session(path, session_from_records({}, records(lambda t: 0.98 * t, runs=2)))
    with h5py.File(path) as file:
        kept = [json.loads(file[f"curves/{k:04d}"].attrs["clock"]) for k in (1, 2)]
    assert [k["rate"] for k in kept] == pytest.approx([0.98, 0.98], abs=1e-3)
    assert run(["session", "info", str(path)]) == 0
    said = capsys.readouterr().out
    assert "the instrument's clock by this computer's: 2 % slow" in said
    assert "began 2023-11-14 22:13:30.0" in said
    assert run(["export", str(path), "--to", "json", str(tmp_path)]) == 0
    curves = json.loads((tmp_path / "session.json").read_text())["curves"]
    assert [curve["clock"] for curve in curves] == kept


@pytest.mark.parametrize(("rate", "warns"), [(0.2, True), (0.9, True), (0.99, False), (1.0, False)])
def test_a_clock_that_is_far_off_is_told_where_nobody_controls_it(rate, warns):
    said = clock_warning(session_from_records({}, records(lambda t: rate * t)))
    assert (said is not None and "are rate_hz and the unit" in said) == warns


def test_a_clock_that_was_changed_is_found(tmp_path):
    path = tmp_path / "s.h5"
    write_session(path, session_from_records({}, records(lambda t: t)))
    with h5py.File(path, "r+") as file:
        group = file["curves/0001"]
        group.attrs["clock"] = json.dumps(json.loads(group.attrs["clock"]) | {"rate": 1.1})
    assert "curve 1: clock is not what the recorded bytes say" in check(path)[1]
