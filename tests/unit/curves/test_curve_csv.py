from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest

from skinlab.curves.csv import read_curve, write_curve
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.errors import InputError

HEADER = "time_s,pressure_mbar,deflection_mm\n"
ROWS = "".join(f"{0.1 * i:.1f},{2 * i},{0.01 * i:.2f}\n" for i in range(6))


def test_reads_what_it_writes(tmp_path):
    rng = np.random.default_rng(0)
    curve = Curve("c", Setup(6, 1), np.arange(20) / 7, rng.random(20), rng.random(20))
    text = io.StringIO()
    write_curve(text, curve)
    path = tmp_path / "c.csv"
    path.write_text(text.getvalue())
    again = read_curve(path, Setup(6, 1))
    for name in ("time_s", "pressure_mbar", "deflection_mm"):
        np.testing.assert_allclose(getattr(again, name), getattr(curve, name), rtol=1e-8)


@pytest.mark.parametrize(
    ("step_s", "told"),
    [
        (50.0, "time_s has a sample every 50 s, and 250 s in all; is it in milliseconds?"),
        (5.0, "time_s has a sample every 5 s, and 25 s in all; is it in milliseconds?"),
        (1.0, None),
        (0.005, None),
    ],
)
def test_times_in_milliseconds_are_asked_about(tmp_path, capsys, step_s, told):
    """A search for what is missing in such curves had not ended in minutes."""
    path = tmp_path / "c.csv"
    path.write_text(HEADER + "".join(f"{step_s * i},{2 * i},{0.01 * i}\n" for i in range(6)))
    assert len(read_curve(path, Setup(6, 1))) == 6
    assert capsys.readouterr().err == (f"skinlab: {path}: {told}\n" if told else "")
    read_curve(path, Setup(6, 1, parse_program("ramp:10@20")))  # a campaign refuses it by that
    assert capsys.readouterr().err == ""


def test_other_columns_order_bom_and_blank_lines_are_fine(tmp_path):
    path = tmp_path / "c.csv"
    rows = "\n".join(f"{i},x,{0.1 * i},{0.01 * i}" for i in range(6))
    path.write_text("\ufeffpressure_mbar, note ,time_s,deflection_mm\n" + rows + "\n\n")
    assert read_curve(path, Setup(6, 1)).pressure_mbar.tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    ("column", "found"),
    [
        ([0, 0, 1, 1, 1, 2], [0, 0, 1, 1, 1, 2]),  # 2 is the end
        ([0, 0, 1, 1, 1, 3], None),
        ([0, 1, 0, 1, 1, 2], None),
        (["a", 0, 1, 1, 1, 2], None),
    ],
)
def test_segments_are_read_where_they_are_those_of_the_program(tmp_path, column, found):
    path = tmp_path / "c.csv"
    rows = "".join(f"{0.1 * i},{2 * i},{0.01 * i},{k}\n" for i, k in enumerate(column))
    path.write_text(HEADER.strip() + ",segment\n" + rows)
    program = parse_program("ramp:100@20,ramp:0@20")
    read = read_curve(path, Setup(6, 1, program))
    assert (None if read.segment is None else read.segment.tolist()) == found
    assert read_curve(path, Setup(6, 1)).segment is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "time_s,pressure_mbar,deflection_mm,pressure_mbar\n",
            "line 1: column pressure_mbar is there twice; expected the header time_s,",
        ),
        ("", "line 1: missing column time_s, pressure_mbar, deflection_mm"),
        ("time_s,pressure_mbar\n0,0\n", "line 1: missing column deflection_mm"),
        ("time_s;pressure_mbar;deflection_mm\n0;0;0\n", "separated by commas"),
        (HEADER + "0,0,nan\n" + ROWS, "line 2: deflection_mm is nan, expected a finite number"),
        (HEADER + "0,inf,0\n" + ROWS, "line 2: pressure_mbar is inf"),
        (HEADER + "0,0,abc\n" + ROWS, "line 2: deflection_mm is 'abc', expected a number"),
        (HEADER + "0,0,0,0,1,5\n", "line 2: 6 fields, expected 3; is the decimal sign a comma?"),
        (HEADER + '"0,1",0,0\n', "is the decimal sign a comma?"),
        (HEADER + "0,0\n", "line 2: 2 fields, expected 3"),
        (HEADER + ROWS + "0.5,1,1\n", "line 8: time_s 0.5 does not increase"),
        (HEADER + "0,0,0\n1,1,1\n", "2 samples; expected at least 5"),
    ],
)
def test_bad_input_names_the_line_and_what_was_expected(tmp_path, text, says):
    path = tmp_path / "c.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_curve(path, Setup(6, 1))
    assert says in str(caught.value)
    assert str(path) in str(caught.value)


def test_files_that_are_no_text(tmp_path):
    path = tmp_path / "c.csv"
    path.write_bytes(b"\xff\xfe\x00\x01" * 20)
    with pytest.raises(InputError, match="not UTF-8"):
        read_curve(path, Setup(6, 1))
    with pytest.raises(InputError, match="No such file"):
        read_curve(tmp_path / "absent.csv", Setup(6, 1))


def test_times_of_a_computers_clock_are_read_and_written_whole(tmp_path):
    """Of Unix times 9 digits tell no sample from the next."""
    time_s = 1.75e9 + 0.05 * np.arange(20)
    curve = Curve("c", Setup(6, 1), time_s, np.arange(20.0), 0.01 * np.arange(20))
    path = tmp_path / "c.csv"
    with path.open("w") as stream:
        write_curve(stream, curve)
    assert "\n1750000000.05,1,0.01\n" in path.read_text()
    assert read_curve(path, Setup(6, 1)).time_s == pytest.approx(time_s, rel=0, abs=1e-5)
    with path.open("w") as stream:
        write_curve(stream, replace(curve, time_s=0.1 * np.arange(20)))
    assert "\n0.3,3,0.03\n" in path.read_text()


def test_a_row_of_another_opening_is_refused(tmp_path):
    path = tmp_path / "c.csv"
    rows = [f"{row},{6.0 if i < 5 else 2.0}" for i, row in enumerate(ROWS.splitlines())]
    path.write_text("\n".join([HEADER.strip() + ",aperture_mm", *rows]))
    with pytest.raises(InputError, match=r"line 7: aperture_mm is 2.0, and the curve is stated"):
        read_curve(path, Setup(6, 1))
    path.write_text("\n".join([HEADER.strip() + ",aperture_mm", *rows[:5]]))
    assert len(read_curve(path, Setup(6, 1))) == 5
    with pytest.raises(InputError, match=r"line 2: aperture_mm is 6.0"):
        read_curve(path, Setup(8, 1))
