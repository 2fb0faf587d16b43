"""`skinlab session verify`: what was changed is found, and where is said."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import h5py
import pytest

from drivers.probe import Probe
from skinlab.acquisition.measure import measure
from skinlab.acquisition.measurement_messages import Plan
from skinlab.acquisition.pipeline import Pipeline
from skinlab.acquisition.sources import LiveSource
from skinlab.cli.main import run
from skinlab.curves.curve import Setup
from skinlab.curves.placement import placements_of
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.recording.audit import Chain, entries, note
from skinlab.recording.load_inputs import read_input
from skinlab.recording.recorder import Recording
from skinlab.recording.records import Kind, Record
from skinlab.recording.seal import SEAL_BYTES, Seal, read_seal
from skinlab.recording.session import Session, content_hash, read_session, write_session
from skinlab.recording.session_check import audit_head, check
from skinlab.recording.stream import setup_from_json, setup_to_json


@pytest.fixture(scope="module")
def session(tmp_path_factory, grid) -> Session:
    path = tmp_path_factory.mktemp("session") / "s.h5"
    recording = Recording(path, Identifier(grid), subject="P-7", url="sim://", who="nurse")
    setup = Setup(6.0, 1.0, parse_program("ramp:100@50"))
    with Probe("sim://?seed=1&speed=50", on_bytes=recording.journal.raw) as probe:
        probe.open()
        pipeline = Pipeline(Identifier(grid), [recording])
        measure(LiveSource(probe, recording.journal), Plan(setup, 2, 0.05), pipeline)
    recording.finish()
    return read_session(path)


def found_in(session: Session, path: Path) -> list[str]:
    """What is found where somebody changes a session and makes its plain hash fit again."""
    write_session(path, session)
    return check(path)[1]


def test_who_did_what_when_is_in_it(session):
    trail = entries(session.records)
    assert [e.what for e in trail] == [
        "session opened",
        *["run started", "run ended", "identified"] * 2,
        "session closed",
    ]
    assert {e.who for e in trail} == {"nurse"}
    assert [e.utc for e in trail] == sorted(e.utc for e in trail)
    assert trail[0].detail["subject"] == "P-7"
    assert trail[2].detail["samples"] == len(session.curves[0])


def test_a_session_as_it_was_written_holds(session, tmp_path):
    assert found_in(session, tmp_path / "s.h5") == []
    assert audit_head(session) == audit_head(read_session(tmp_path / "s.h5"))
    assert run(["session", "verify", str(tmp_path / "s.h5")]) == 0
    assert run(["session", "info", str(tmp_path / "s.h5")]) == 0


def numbers(session: Session, kind: Kind) -> list[int]:
    return [i for i, r in enumerate(session.records) if r.kind is kind]


def change(session: Session, index: int, record: Record | None) -> Session:
    records = list(session.records)
    records[index : index + 1] = [] if record is None else [record]
    return dataclasses.replace(session, records=tuple(records))


@pytest.mark.parametrize("entry", range(1, 9))
def test_a_changed_entry_is_named(session, tmp_path, entry):
    """The entry behind it no longer follows; the last one is bound by its head, noted elsewhere."""
    index = numbers(session, Kind.AUDIT)[entry - 1]
    record = session.records[index]
    said = json.loads(record.data) | {"who": "somebody else"}
    other = change(session, index, dataclasses.replace(record, data=json.dumps(said).encode()))
    if entry == 8:
        assert audit_head(other) != audit_head(session)
        return
    assert any(
        text.startswith(f"audit entry {entry + 1} ") and "does not follow" in text
        for text in found_in(other, tmp_path / "s.h5")
    )


@pytest.mark.parametrize("entry", range(1, 9))
def test_a_removed_entry_is_named(session, tmp_path, entry):
    other = change(session, numbers(session, Kind.AUDIT)[entry - 1], None)
    found = found_in(other, tmp_path / "s.h5")
    if entry == 8:
        assert found == ["the records go on behind the last audit entry, number 7"]
    else:
        assert f"audit entry {entry} " in found[0]


def test_an_entry_put_in_is_named(session, tmp_path):
    index = numbers(session, Kind.AUDIT)[4]
    before = session.records[:index]
    forged = Chain(before).add(note(1.0, 1.0, "x", "vent ordered", {}))
    records = (*before, forged, *session.records[index:])
    found = found_in(dataclasses.replace(session, records=records), tmp_path / "s.h5")
    assert found[0].startswith("audit entry 6 ")


@pytest.mark.parametrize("what", ["data", "host_time_s", "utc_s"])
def test_a_changed_record_is_placed_between_two_entries(session, tmp_path, what):
    audits = numbers(session, Kind.AUDIT)
    index = next(
        i for i in numbers(session, Kind.RECEIVED) if audits[1] < i < audits[2]
    )  # a sample of the first run
    record = session.records[index]
    value = record.data[:-1] + b"?" if what == "data" else getattr(record, what) + 1e-6
    other = change(session, index, dataclasses.replace(record, **{what: value}))
    found = found_in(other, tmp_path / "s.h5")
    assert found[0].startswith("audit entry 3 ")
    assert "does not agree with what is recorded before it" in found[0]


def test_a_curve_or_result_or_fact_that_is_not_the_recorded_one_is_named(session, tmp_path):
    curve = session.curves[1]
    better = dataclasses.replace(curve, deflection_mm=curve.deflection_mm * 1.1)
    result = session.results[0] | {"error_um": 0.0}
    other = dataclasses.replace(
        session,
        curves=(session.curves[0], better),
        results=(result, session.results[1]),
        meta=session.meta | {"subject": "P-8"},
    )
    assert found_in(other, tmp_path / "s.h5") == [
        "meta: subject is not what audit entry 1 (session opened) says",
        "curve 1: its result is not the recorded one",
        "curve 2: deflection_mm is not what the recorded bytes say",
    ]


def test_a_change_by_other_software_is_told_with_status_1(session, tmp_path, capsys):
    path = tmp_path / "s.h5"
    write_session(path, session)
    with h5py.File(path, "r+") as file:
        file["samples/pressure_mbar"][3] += 1.0
        file["curves/0001/deflection_mm"][3] += 1e-9
    assert run(["session", "verify", str(path)]) == 1
    told = capsys.readouterr().err
    assert "curve 1: deflection_mm is not what the recorded bytes say" in told
    assert "samples: pressure_mbar is not what the recorded bytes say" in told
    assert "the content does not agree with its hash" in told


def test_software_of_another_version_may_cut_curves_otherwise(session, tmp_path):
    versions = session.meta["versions"] | {"code": "0"}
    other = dataclasses.replace(
        session, curves=session.curves[:1], results=session.results[:1],
        meta={k: v for k, v in session.meta.items() if k != "versions"} | {"versions": versions},
    )  # fmt: skip
    assert "made by other software: skinlab" in found_in(other, tmp_path / "s.h5")[-1]


def test_every_flipped_byte_is_seen_before_hdf5_reads_it(session, tmp_path):
    path = tmp_path / "s.h5"
    write_session(path, session)
    whole = path.read_bytes()
    assert read_seal(path) is Seal.HOLDS
    for place in [*range(0, SEAL_BYTES, 13), *range(SEAL_BYTES, len(whole), 499), len(whole) - 1]:
        path.write_bytes(
            whole[:place] + bytes([whole[place] ^ 1 << place % 8]) + whole[place + 1 :]
        )
        assert read_seal(path) is not Seal.HOLDS
        with pytest.raises(InputError, match="it was changed"):
            read_session(path)
    path.write_bytes(whole + b"\0")
    assert read_seal(path) is Seal.BROKEN
    assert run(["session", "verify", str(path)]) == 1


def test_damage_over_which_the_library_crashes_is_one_sentence(
    session, tmp_path, capsys, monkeypatch
):
    path = tmp_path / "s.h5"
    write_session(path, session)
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    crashes = tmp_path / "crashes"
    crashes.write_text("#!/bin/sh\nkill -SEGV $$\n")
    crashes.chmod(0o700)
    monkeypatch.setattr("sys.executable", str(crashes))
    assert run(["session", "verify", str(path)]) == 3
    told = capsys.readouterr().err
    assert (
        told == f"skinlab: {path}: was changed since it was written, and cannot be read any more\n"
    )


def test_rubbish_is_bad_input(session, tmp_path):
    path = tmp_path / "s.h5"
    write_session(path, session)
    for place, value in (
        ("schema", "x"),
        ("meta", "{"),
        ("meta", "[]"),
    ):
        with h5py.File(path, "r+") as file:
            kept = file.attrs[place]
            file.attrs[place] = value
        with pytest.raises(InputError, match=str(path)):
            check(path)
        with h5py.File(path, "r+") as file:
            file.attrs[place] = kept
    with h5py.File(path, "r+") as file:
        file["raw/kind"][0] = 77
    assert run(["session", "verify", str(path)]) == 3
    with h5py.File(path, "r+") as file:
        del file["raw/utc_s"]
    assert run(["session", "verify", str(path)]) == 3


def test_a_session_is_not_put_over_another_file(session, tmp_path):
    path = tmp_path / "s.h5"
    path.write_text("mine")
    with pytest.raises(InputError, match="never overwritten"):
        write_session(path, session)
    assert path.read_text() == "mine"
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]


def test_the_hash_is_over_all_that_a_session_says(session):
    first = session.curves[0]
    for other in (
        dataclasses.replace(session, meta=session.meta | {"site": "x"}),
        dataclasses.replace(session, records=session.records[:-1]),
        dataclasses.replace(
            session, curves=(dataclasses.replace(first, segment=None), session.curves[1])
        ),
        dataclasses.replace(session, results=(None, session.results[1])),
    ):
        assert content_hash(other) != content_hash(session)


def test_a_placement_is_kept_where_it_is_stated_and_older_sessions_are_as_they_were(
    session, tmp_path
):
    first, second = session.curves
    assert "placement" not in setup_to_json(first.setup)
    setup = dataclasses.replace(first.setup, placement="left arm")
    stated = dataclasses.replace(session, curves=(dataclasses.replace(first, setup=setup), second))
    assert content_hash(stated) != content_hash(session)
    path = tmp_path / "s.h5"
    write_session(path, stated)
    assert [c.setup.placement for c in read_session(path).curves] == ["left arm", None]
    other = tmp_path / "other.h5"
    write_session(other, stated)  # its "left arm" is another putting-on
    labelled = [read_input(one, None).curves[0] for one in (path, path, other)]
    assert placements_of(labelled) == [0, 0, 1]
    in_python = [read_session(one).curves[0] for one in (path, path, other)]
    assert placements_of(in_python) == [0, 0, 1]
    with pytest.raises(InputError, match="placement is 3, expected a text"):
        setup_from_json(setup_to_json(setup) | {"placement": 3})
