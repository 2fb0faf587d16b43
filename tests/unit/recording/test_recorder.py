"""Journal, session, replay and recovery on a measurement at sim://."""

from __future__ import annotations

import dataclasses
import stat
from pathlib import Path

import h5py
import numpy as np
import pytest

from drivers.events import (
    PROGRAM_END,
    Gap,
    HostVented,
    InstrumentState,
    LinkLost,
    Sample,
    State,
    TimedEvent,
)
from drivers.probe import Probe
from skinlab.acquisition.measure import measure
from skinlab.acquisition.measurement_messages import Plan
from skinlab.acquisition.pipeline import Pipeline
from skinlab.acquisition.replay import differences, identifier_of, replay
from skinlab.acquisition.sources import LiveSource
from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.inference.problem import Options
from skinlab.recording.assembler import CurveAssembler
from skinlab.recording.journal import Journal, read_journal
from skinlab.recording.recorder import Recording, identification_settings, recover
from skinlab.recording.records import Kind
from skinlab.recording.session import read_session, session_from_records, write_session
from skinlab.recording.stream import CurveCompleted, CurveStarted, Identified
from skinlab.report.text import describe

SETUP = Setup(6.0, 1.0, parse_program("ramp:100@20"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, grid) -> tuple[Path, list]:
    """A session of two curves, and the messages of its live run."""
    path = tmp_path_factory.mktemp("session") / "s.h5"
    identifier = Identifier(grid)
    recording = Recording(path, identifier, subject="P-7", site="forearm", url="sim://")
    messages: list = []
    with Probe("sim://?seed=1&speed=50", on_bytes=recording.journal.raw) as probe:
        probe.open()
        source = LiveSource(probe, recording.journal)
        pipeline = Pipeline(identifier, [recording, messages.append])
        measure(source, Plan(SETUP, repeats=2, rest_s=0.05), pipeline)
    recording.finish()
    return path, messages


def test_the_session_holds_what_was_measured(recorded):
    path, messages = recorded
    session = read_session(path)
    live = [m.curve for m in messages if isinstance(m, CurveCompleted)]
    assert len(session.curves) == len(live) == 2
    for stored, curve in zip(session.curves, live, strict=True):
        for name in ("time_s", "pressure_mbar", "deflection_mm", "segment"):
            np.testing.assert_array_equal(getattr(stored, name), getattr(curve, name))
        assert stored.setup == curve.setup
        assert 50 <= len(stored) <= 101
        assert not stored.partial
    assert [c.setup.cycle for c in session.curves] == [1, 2]
    assert [c.setup.repeat for c in session.curves] == [1, 2]
    assert session.meta["subject"] == "P-7"
    assert session.meta["instrument"]["simulated"] is True
    assert {r.kind for r in session.records} == set(Kind) - {Kind.MARK}
    assert all(abs(r.utc_s - session.records[0].utc_s) < 600 for r in session.records)


def test_no_journal_is_left_and_the_file_is_its_owners(recorded):
    path, _ = recorded
    assert [p.name for p in path.parent.iterdir()] == [path.name]
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_a_replay_gives_the_same_bits(recorded):
    path, messages = recorded
    session = read_session(path)
    identifier, warning = identifier_of(session)
    assert warning is None
    again: list = []
    curves = replay(session, identifier, [again.append])
    results = [m.result for m in again if isinstance(m, Identified)]
    assert differences(session, curves, results) == []
    live = [m.result for m in messages if isinstance(m, Identified)]
    for before, now in zip(live, results, strict=True):
        assert before.to_json() | {"seconds": 0} == now.to_json() | {"seconds": 0}


def test_a_session_knows_the_options_of_its_method(grid, tmp_path):
    for method, own in [
        ("sto", {"sampling": "lhs"}),
        ("hka", {"slowdown": 0.7}),
        ("rls", {"covariance": 3.0, "forgetting": 0.8, "passes": 7}),
    ]:
        options = Options(samples=77).having(**own)
        identifier = Identifier(grid, method=method, options=options)
        settings = identification_settings(identifier)
        assert settings["options"] == own
        session = session_from_records({"identification": settings}, [])
        assert identifier_of(session)[0].options == options


def test_a_session_whose_method_is_not_installed_here_says_so(grid):
    settings = identification_settings(Identifier(grid, method="rls")) | {"method": "mine"}
    session = session_from_records({"identification": settings}, [])
    with pytest.raises(InputError, match="method 'mine' is not known; expected one of: auto"):
        identifier_of(session)


LEAKS = """
[model]
name = "leaks"
[effects.seal_leak.leak_mbar]
value = 3.0
"""
ADOPTED = '[provenance.versions]\n"plugin sealed" = "0.1.0 27ab12cd34ef"\n'


@pytest.mark.parametrize("model", [LEAKS, LEAKS + ADOPTED], ids=["written", "adopted"])
def test_a_session_names_a_plugin_that_it_lacks_once(grid, model):
    """The model, if it was adopted, and the session both know of it."""
    settings = identification_settings(Identifier(grid)) | {"model": model}
    versions = {"plugin sealed": "0.1.0 27ab12cd34ef"}
    session = session_from_records({"identification": settings, "versions": versions}, [])
    with pytest.raises(InputError) as told:
        identifier_of(session)
    said = str(told.value)
    assert "effects.seal_leak is not known" in said
    assert said.count("the plugin sealed 0.1.0, which is not installed here") == 1


def test_a_session_that_records_the_options_of_all_methods_is_still_read(grid):
    settings = identification_settings(Identifier(grid, method="rls"))
    del settings["options"]
    settings |= {"sampling": "uniform", "slowdown": 0.4}
    settings |= {"forgetting": 0.8, "covariance": 1.0, "passes": 100}
    session = session_from_records({"identification": settings}, [])
    own = {"forgetting": 0.8, "covariance": 1.0, "passes": 100}
    assert identifier_of(session)[0].options == Options().having(**own)


def test_a_session_from_before_single_options_replays_as_then(grid):
    """Those did not record them; rls then ran 500 passes at most."""
    settings = identification_settings(Identifier(grid, method="rls"))
    del settings["options"]
    session = session_from_records({"identification": settings}, [])
    assert identifier_of(session)[0].options == Options().having(passes=500)


def test_differences_are_told_in_words(recorded):
    session = read_session(recorded[0])
    curve = session.curves[0]
    changed = dataclasses.replace(curve, deflection_mm=curve.deflection_mm + 1e-12)
    other = dataclasses.replace(session, curves=(changed, session.curves[1]))
    identifier, _ = identifier_of(session)
    again: list = []
    curves = replay(session, identifier, [again.append])
    results = [m.result for m in again if isinstance(m, Identified)]
    assert differences(other, curves, results) == ["curve 1: deflection_mm differs"]
    worse = [dataclasses.replace(results[0], error_um=9.0), results[1]]
    assert differences(session, curves, worse)[0].startswith("curve 1: error_um was")
    assert differences(session, curves[:1], results[:1])[0].startswith("stored curves: 2")


def test_a_changed_session_is_told(recorded, tmp_path):
    session = read_session(recorded[0])
    path = tmp_path / "copy.h5"
    write_session(path, session)
    with h5py.File(path, "r+") as file:
        file["curves/0001/deflection_mm"][3] += 1e-9
    with pytest.raises(InputError, match="was changed"):
        read_session(path)
    whole = path.read_bytes()
    for size in (0, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:size])
        with pytest.raises(InputError):
            read_session(path)


def test_a_session_is_never_overwritten(recorded, grid):
    before = recorded[0].read_bytes()
    with pytest.raises(InputError, match="never overwritten"):
        Recording(recorded[0], Identifier(grid))
    assert recorded[0].read_bytes() == before


def test_an_empty_session_can_be_written_and_read(tmp_path):
    path = tmp_path / "empty.h5"
    write_session(path, session_from_records({"a": 1}, []))
    assert read_session(path).curves == ()


def test_what_a_crash_leaves_is_recovered(tmp_path, recorded):
    """Half of the records: the first curve whole, the second cut and marked."""
    session = read_session(recorded[0])
    plans = [i for i, r in enumerate(session.records) if r.kind is Kind.PLAN]
    half = session.records[: (plans[1] + len(session.records)) // 2]
    journal = Journal(tmp_path / "s.h5.journal", {"subject": "P-7"})
    for record in half:
        journal.put(record.kind, record.host_time_s, record.data, record.utc_s)
    journal.close()
    assert read_journal(journal.path).records == list(half)
    assert len(recover(journal.path, tmp_path / "s.h5")[0].curves) == 2
    again = read_session(tmp_path / "s.h5")
    assert [c.partial for c in again.curves] == [False, True]
    assert again.results[0] == session.results[0]
    assert again.results[1] is None
    n = len(again.curves[1])
    np.testing.assert_array_equal(
        again.curves[1].deflection_mm, session.curves[1].deflection_mm[:n]
    )


def test_a_journal_that_cannot_be_written_says_so(tmp_path):
    journal = Journal(tmp_path / "j", {})
    with pytest.raises(InputError, match="exists already"):
        Journal(tmp_path / "j", {})
    journal.close()
    (tmp_path / "no").write_text("not a journal")
    with pytest.raises(InputError, match="not a journal"):
        read_journal(tmp_path / "no")
    with pytest.raises(InputError, match="no such file"):
        read_journal(tmp_path / "absent")
    with pytest.raises(InputError, match="cannot be written"):
        Journal(tmp_path / "no" / "j", {})


def test_the_wrong_probe_is_refused_before_anything_moves(grid):
    with Probe("sim://?seed=1&speed=50&aperture_mm=2") as probe:
        probe.open()
        with pytest.raises(InputError, match="the probe has 2 mm"):
            measure(LiveSource(probe), Plan(SETUP), Pipeline(Identifier(grid)))
        assert probe.state is InstrumentState.IDLE


def test_what_is_beyond_the_instruments_limits_is_bad_input(grid):
    setup = dataclasses.replace(SETUP, program=parse_program("ramp:100@20"))
    with Probe("sim://?seed=1&speed=50") as probe:
        probe.open()
        with pytest.raises(InputError, match="Hz"):
            measure(LiveSource(probe), Plan(setup, rate_hz=5000), Pipeline(Identifier(grid)))


class TestAssembler:
    """Which samples make a curve, and when it is cut."""

    setup = Setup(6.0, 1.0, parse_program("ramp:100@20,ramp:0@20"))

    def run(self, *events):
        assembler = CurveAssembler()
        assembler.plan(self.setup)
        messages = []
        for event in events:
            messages += assembler.feed(event)
        messages += assembler.end("the stream ended")
        return messages

    def samples(self, first, last, segment):
        return [Sample(i, i / 20, 1.0, 0.1, segment) for i in range(first, last)]

    running = State(InstrumentState.RUNNING, "start", 0.0)
    ended = State(InstrumentState.VENTING, PROGRAM_END, 0.0)

    def curve(self, messages):
        (message,) = [m for m in messages if isinstance(m, CurveCompleted)]
        return message

    def test_the_final_vent_is_not_part_of_it(self):
        found = self.curve(
            self.run(
                self.running,
                *self.samples(0, 10, 0),
                *self.samples(10, 20, 1),
                self.ended,
                *self.samples(20, 25, 2),
            )
        )
        assert len(found.curve) == 20
        assert not found.curve.partial
        assert found.cut is None

    def test_a_lost_state_frame_changes_nothing(self):
        found = self.curve(
            self.run(
                self.running,
                *self.samples(0, 10, 0),
                *self.samples(10, 20, 1),
                *self.samples(20, 25, 2),
            )
        )
        assert len(found.curve) == 20
        assert not found.curve.partial

    @pytest.mark.parametrize(
        "end",
        [
            State(InstrumentState.VENTING, "operator", 5.0),
            State(InstrumentState.FAULT, "overpressure", 5.0),
            LinkLost("unplugged"),
        ],
    )
    def test_a_cut_run_is_partial_and_says_why(self, end):
        found = self.curve(self.run(self.running, *self.samples(0, 10, 0), end))
        assert found.curve.partial
        assert found.cut in ("operator", "overpressure", "unplugged")

    def test_what_the_driver_adds_does_not_decide(self):
        events = (
            self.running,
            *self.samples(0, 10, 0),
            HostVented("x"),
            *self.samples(10, 20, 1),
            self.ended,
        )
        assert not self.curve(self.run(*events)).curve.partial

    def test_lost_samples_are_counted(self):
        events = (self.running, *self.samples(0, 10, 0), Gap(10, 13), *self.samples(13, 20, 1))
        found = self.curve(self.run(*events, self.ended))
        assert found.lost_samples == 3

    def test_too_few_samples_are_no_curve(self):
        messages = self.run(self.running, *self.samples(0, 3, 0), self.ended)
        assert [m for m in messages if isinstance(m, CurveCompleted)] == []
        assert len([m for m in messages if isinstance(m, CurveStarted)]) == 1

    def test_a_run_without_a_plan_is_not_collected(self):
        assembler = CurveAssembler()
        assert not any(isinstance(m, CurveStarted) for m in assembler.feed(self.running))


def test_a_curve_without_samples_to_fit_is_kept_and_says_why(grid):
    """A step is over before its second sample: there is no loading to fit."""
    setup = dataclasses.replace(SETUP, program=parse_program("mode1:100,1,1"))
    messages: list = []
    with Probe("sim://?seed=1&speed=20") as probe:
        probe.open()
        measure(LiveSource(probe), Plan(setup), Pipeline(Identifier(grid), [messages.append]))
    (result,) = [m.result for m in messages if isinstance(m, Identified)]
    assert result.points > 30
    assert "1 sample to fit in phases load" in result.error
    assert "not identified: " in describe(result)


def test_a_pipeline_without_identifier_only_assembles():
    messages: list = []
    pipeline = Pipeline(None, [messages.append])
    pipeline.handle(TimedEvent(0.0, State(InstrumentState.IDLE, "", 0.0)))
    pipeline.end()
    assert len(messages) == 1
