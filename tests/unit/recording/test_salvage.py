"""`skinlab recover` of a session whose bytes were damaged: nothing in it is taken for a reading."""

from __future__ import annotations

import random
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from skinlab.cli.main import run
from skinlab.errors import InputError
from skinlab.recording import apart
from skinlab.recording.audit import entries
from skinlab.recording.journal import Journal
from skinlab.recording.records import Kind
from skinlab.recording.salvage import is_session, salvage
from skinlab.recording.session import example_session, read_session, write_session
from skinlab.recording.session_check import check, complaints_about_changed

WHOLE = read_session(example_session())
BYTES = example_session().read_bytes()


def place_of(name: str) -> int:
    """Where an array begins in the file; of one that is compressed, its first part."""
    with h5py.File(example_session()) as file:
        data = file[name]
        if data.chunks is None:
            place = data.id.get_offset()
            assert BYTES[place:].startswith(data[()].tobytes())
            return place
        _, content = data.id.read_direct_chunk((0,))
        return BYTES.index(content)


def damaged(path: Path, *places: int) -> Path:
    """The example with a bit flipped at each of these places."""
    content = bytearray(BYTES)
    for place in places:
        content[place] ^= 0x10
    path.write_bytes(content)
    return path


def same(made, curves=WHOLE.curves) -> bool:
    return len(made.curves) == len(curves) and all(
        np.array_equal(getattr(a, name), getattr(b, name))
        for a, b in zip(made.curves, curves, strict=True)
        for name in ("time_s", "pressure_mbar", "deflection_mm", "segment")
    )


def test_where_the_recorded_bytes_are_whole_all_is_made_from_them_again(tmp_path, capsys):
    places = place_of("curves/0001/pressure_mbar") + 83, place_of("samples/deflection_mm") + 9
    path = damaged(tmp_path / "visit.h5", *places)
    assert run(["identify", str(path)]) == 3
    assert f"`skinlab recover {path}`" in capsys.readouterr().err
    assert run(["recover", str(path)]) == 0
    out = tmp_path / "visit.recovered.h5"
    said = capsys.readouterr()
    assert said.out == f"{out}: 2 curves recovered; nothing is lost; {path} can be deleted\n"
    assert said.err == ""
    assert run(["session", "verify", str(out)]) == 0
    made = read_session(out)
    assert same(made)
    assert made.results == WHOLE.results
    assert made.records[:-1] == WHOLE.records
    last = entries(made.records)[-1]
    assert (last.what, last.detail) == ("recovered", {"damaged": "visit.h5"})
    assert path.read_bytes() != BYTES  # it stays as it is


def test_where_recorded_bytes_are_damaged_the_curves_stay_as_they_stand_in_the_file(tmp_path):
    path, out = damaged(tmp_path / "visit.h5", place_of("raw/data") + 700), tmp_path / "out.h5"
    made, lost = salvage(path, out, who="nurse")
    assert same(made)
    assert made.results == WHOLE.results
    assert 0 < len(made.records) < len(WHOLE.records)
    assert any("cannot be read: left out" in said for said in lost)
    assert set(made.records[:-1]) < set(WHOLE.records)
    found = check(out)[1]  # it does not hide it
    assert any("does not follow the entry before it" in said for said in found)
    (entry,) = entries(made.records)[-1:]
    assert (entry.who, entry.detail["skipped"]) == ("nurse", lost)


@pytest.mark.parametrize(
    ("name", "byte", "said"),
    [
        ("raw/end", 8 * 40 + 6, "record 41: its end is damaged; its bytes count to the next"),
        ("raw/kind", 40, "record 41: its kind is 17: left out"),
        ("raw/utc_s", 8 * 40 + 7, "record 41: its utc_s is"),
        ("raw/host_time_s", 8 * 40 + 2, "does not agree with what is recorded before it"),
    ],
)
def test_a_damaged_record_costs_no_curve(tmp_path, name, byte, said):
    path = damaged(tmp_path / "visit.h5", place_of(name) + byte)
    made, lost = salvage(path, tmp_path / "out.h5")
    assert any(said in sentence for sentence in lost)
    assert same(made)
    assert len(made.records) >= len(WHOLE.records)  # one less, and the entry


def test_a_curve_that_nothing_tells_any_more_is_left_out_and_said(tmp_path):
    """A time that goes back is no reading, and the bytes that it was made from are gone as well."""
    times = place_of("curves/0001/time_s") + 8 * 40 + 7
    path = damaged(tmp_path / "visit.h5", place_of("raw/data") + 700, times)
    made, lost = salvage(path, tmp_path / "out.h5")
    assert same(made, WHOLE.curves[1:])
    assert any(said.startswith("curves/0001 cannot be read") for said in lost)


@pytest.mark.parametrize("kept", ["imported", "without a trail"])
def test_where_nothing_binds_the_records_a_changed_number_is_never_passed_over(tmp_path, kept):
    """An imported session has no bytes of an instrument; older ones have no audit trail."""
    records = [r for r in WHOLE.records if r.kind is not Kind.AUDIT] if kept != "imported" else []
    path, other = tmp_path / "visit.h5", tmp_path / "other.h5"
    write_session(path, replace(WHOLE, records=tuple(records)))
    with h5py.File(path) as file:
        reading = file["curves/0001/deflection_mm"].id.get_offset() + 8 * 70 + 5
        schema = path.read_bytes().index(b"skinlab.session/1")
    content = path.read_bytes()

    def flipped(place):
        changed = bytearray(content)
        changed[place] ^= 1
        other.write_bytes(changed)
        return salvage(other, tmp_path / f"{place}.h5")

    made, lost = flipped(reading)
    assert not same(made)
    assert lost == [
        "its curves are those that stand in the file: nothing tells whether a number was changed"
    ]
    made, lost = flipped(schema)  # the hash of the content says that the rest is as it was
    assert same(made)
    assert lost == []


def test_what_is_whole_or_no_session_or_there_already_is_refused(tmp_path):
    whole = tmp_path / "visit.h5"
    shutil.copy(example_session(), whole)
    with pytest.raises(InputError, match=r"visit\.h5: is whole; there is nothing to recover"):
        salvage(whole, tmp_path / "out.h5")
    path = damaged(tmp_path / "damaged.h5", place_of("samples/utc_s"))
    with pytest.raises(InputError, match=r"visit\.h5: exists already"):
        salvage(path, whole)
    cut = tmp_path / "cut.h5"
    cut.write_bytes(BYTES[: len(BYTES) // 2])
    with pytest.raises(InputError, match=r"cut\.h5: truncated"):
        salvage(cut, tmp_path / "out.h5")
    assert not (tmp_path / "out.h5").exists()
    Journal(tmp_path / "j.h5.journal", {}).close()
    assert [is_session(p) for p in (whole, path, cut, tmp_path / "j.h5.journal", tmp_path)] == [
        *[True] * 3,
        *[False] * 2,
    ]


def test_a_reader_that_goes_round_in_a_circle_is_ended(tmp_path, monkeypatch):
    """HDF5's library does, over a table of texts of which 512 bytes were zero."""
    path = damaged(tmp_path / "visit.h5", place_of("samples/utc_s"))
    monkeypatch.setattr(apart, "_LONGEST_S", 0.0)
    monkeypatch.setattr(apart, "_LONGEST_S_PER_BYTE", 0.0)
    for ask in (complaints_about_changed, lambda path: salvage(path, tmp_path / "out.h5")):
        with pytest.raises(InputError, match=r"visit\.h5: was changed .* cannot be read any more"):
            ask(path)


@pytest.mark.parametrize("seed", [0, pytest.param(range(1, 30), marks=pytest.mark.long)])
def test_no_flipped_bit_gives_another_number(tmp_path, seed):
    """Where nothing can be read any more, as of HDF5's root, a sentence says so."""
    told = []
    for one in [seed] if isinstance(seed, int) else seed:
        rng = random.Random(one)
        path = damaged(tmp_path / f"{one}.h5", *[rng.randrange(len(BYTES))])
        try:
            made, _ = salvage(path, tmp_path / f"{one}.out.h5")
        except InputError as error:
            told.append(str(error).startswith(f"{path}: "))
        else:
            told.append(same(made))
    assert all(told)
