"""Curves that other software wrote: read to the same numbers, or refused in one sentence."""

from __future__ import annotations

import csv
import io
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import openpyxl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from skinlab.curves.curve import Setup
from skinlab.curves.pressure_glitches import pressure_glitches
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.exchange.importing.questions import Answers, Question
from skinlab.exchange.importing.reader import import_bytes, import_file
from skinlab.exchange.importing.remembered import Remembered

PLAIN = Setup(6.0, 1.0)
RAMP = Setup(6.0, 1.0, parse_program("ramp:100@20"))
PATH = Path("curve.txt")


def read(data, setup=PLAIN, ask=None, **stated):
    if isinstance(data, str):
        data = data.encode()
    answers = Answers({name.replace("_", "-"): value for name, value in stated.items()}, ask)
    return import_bytes(PATH, data, setup, answers)


def refusal(data, setup=PLAIN, **stated):
    with pytest.raises(InputError) as caught:
        read(data, setup, **stated)
    sentence = str(caught.value)
    assert sentence.startswith("curve.txt: ")
    assert "\n" not in sentence
    return sentence.removeprefix("curve.txt: ")


def rows(separator=";", decimal=".", n=101, pick=(0, 1, 2), scale=(1, 1, 1)):
    """Rows of a ramp: 20 mbar/s, 3 µm for each mbar."""
    lines = []
    for i in range(n):
        values = (0.05 * i, 1.0 * i, 0.003 * i)
        texts = [f"{values[k] * scale[k]:.4f}".replace(".", decimal) for k in pick]
        lines.append(separator.join(texts) + "\n")
    return "".join(lines)


def check_ramp(imported, rtol=1e-12):
    curve = imported.curve
    i = np.arange(101)
    np.testing.assert_allclose(curve.time_s, 0.05 * i, rtol=rtol, atol=1e-15)
    np.testing.assert_allclose(curve.pressure_mbar, i, rtol=rtol, atol=1e-15)
    np.testing.assert_allclose(curve.deflection_mm, 0.003 * i, rtol=rtol, atol=1e-15)


# ---- any combination of forms ---------------------------------------------------------------

TIMES = {"s": 1.0, "ms": 1e-3, "min": 60.0}
PRESSURES = {"mbar": 1.0, "hPa": 1.0, "kPa": 10.0, "Pa": 0.01, "mmHg": 1.33322387415}
LENGTHS = {"mm": 1.0, "µm": 1e-3, "um": 1e-3, "cm": 10.0}
NAMES = {
    "time": ["Time", "Zeit", "elapsed time", "TEMPS"],
    "pressure": ["Pressure", "Druck", "suction", "Unterdruck", "Vacuum level"],
    "deflection": ["Deflection", "Höhe", "skin elevation", "Auslenkung", "Verformung"],
}
STYLES = ["{} ({})", "{} [{}]", "{}/{}", "{}_{}", "{}, {}", "{} in {}", "{} {}"]
PREAMBLE = ["DermaLab Combo", "", "Datum: 12.03.2020 10:15", "Probe;6 mm", "Range;0;100"]
ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"]


@st.composite
def exports(draw):
    """A file's bytes, and the three channels in s, mbar and mm that it holds."""
    n = draw(st.integers(5, 30))
    steps = draw(st.lists(st.integers(1, 999), min_size=n, max_size=n))
    units = [draw(st.sampled_from(sorted(table))) for table in (TIMES, PRESSURES, LENGTHS)]
    counts = [
        np.cumsum(steps),
        np.sort(draw(st.lists(st.integers(0, 9999), min_size=n, max_size=n))) + 1,
        np.sort(draw(st.lists(st.integers(-1, 599), min_size=n, max_size=n))),  # it is a dome
    ]
    places = [draw(st.integers(2, 4)), 3, 3]
    factors = [TIMES[units[0]], PRESSURES[units[1]], LENGTHS[units[2]]]
    values = [c / 10.0**p * f for c, p, f in zip(counts, places, factors, strict=True)]
    separator = draw(st.sampled_from([",", ";", "\t"]))
    decimal = draw(st.sampled_from([".", ","]))
    style = draw(st.sampled_from([s for s in STYLES if separator != "," or s != "{}, {}"]))
    names = [draw(st.sampled_from(NAMES[role])) for role in NAMES]
    units_below = draw(st.booleans())
    headings = (
        names if units_below else [style.format(a, b) for a, b in zip(names, units, strict=True)]
    )
    texts = [
        [f"{c / 10.0**p:.{p}f}".replace(".", decimal) for c in column]
        for column, p in zip(counts, places, strict=True)
    ]
    order = draw(st.permutations(range(3)))
    words = [*(["Phase", ""] if units_below else ["Phase"]), *["load"] * n]
    below = [units] if units_below else []
    table = [headings, *below, *zip(*texts, strict=True)]
    table = [[row[k] for k in order] for row in table]
    if draw(st.booleans()):
        table = [[word, *row] for word, row in zip(words, table, strict=True)]
    text = io.StringIO()
    quoting = draw(st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL]))
    end = draw(st.sampled_from(["\n", "\r\n"]))
    trailing = draw(st.booleans())
    writer = csv.writer(text, delimiter=separator, quoting=quoting, lineterminator=end)
    for line in draw(st.lists(st.sampled_from(PREAMBLE), max_size=4)):
        text.write(line + end)
    writer.writerows([*row, *([""] if trailing else [])] for row in table)
    text.write(draw(st.sampled_from(["", end, f"{end}End of measurement{end}"])))
    return text.getvalue().encode(draw(st.sampled_from(ENCODINGS))), values


@given(exports())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_any_combination_of_forms_reads_back_to_the_same_numbers(export):
    data, (time_s, pressure_mbar, deflection_mm) = export
    curve = read(data).curve
    np.testing.assert_allclose(curve.time_s, time_s, rtol=1e-12)
    np.testing.assert_allclose(curve.pressure_mbar, pressure_mbar, rtol=1e-12)
    np.testing.assert_allclose(curve.deflection_mm, deflection_mm, rtol=1e-12)


@pytest.mark.parametrize(
    "heading", ["p/bar", "P_bar", "Sog [bar]", "Vac bar", "p (bar)", "Pres, bar"]
)
def test_a_pressure_that_is_there_goes_before_the_program(heading):
    """The pump reached four fifths of what it was to: the program's own made stiffer skin of it."""
    text = f"t/s;{heading};w/mm\n" + rows(scale=(1, 0.8e-3, 1))
    curve = read(text, RAMP).curve
    np.testing.assert_allclose(curve.pressure_mbar, 0.8 * np.arange(101), atol=0.06)
    said = refusal(text.replace(heading, "p"), RAMP)
    assert "the unit of the pressure (column 'p') is not known" in said


def test_a_pressure_by_its_name_goes_before_a_symbol():
    imported = read("t/s;P;Druck/mbar;w/mm\n" + rows(pick=(0, 2, 1, 2), scale=(1, 1, 1, 1)))
    check_ramp(imported)
    assert "columns not used: 'P'" in imported.understood


@pytest.mark.parametrize("person", ["17", "P17"])
def test_a_column_that_never_moves_is_no_pressure(person):
    text = "P;t/s;w/mm\n" + "".join(f"{person};{row}\n" for row in rows(pick=(0, 2)).split())
    check_ramp(read(text, RAMP), rtol=1e-9)


def test_what_is_no_channel_is_named():
    text = "t/s;P (W);w/mm\n" + rows()
    imported = read(text, RAMP)
    assert "columns not used: 'P (W)'" in imported.understood
    assert not any("not used" in said for said in read(WHOLE).understood)


WHOLE = ("Time (s);Pressure (mbar);Deflection (mm)\n" + rows(n=12)).encode()


def rubbish_or_curve(data):
    try:
        imported = read(data, RAMP)
    except InputError:
        return
    assert np.isfinite(imported.curve.deflection_mm).all()


@given(st.one_of(st.binary(max_size=300), st.text(max_size=300).map(lambda t: t.encode("utf-16"))))
@settings(max_examples=150, deadline=None)
def test_rubbish_gives_an_input_error_and_nothing_else(data):
    rubbish_or_curve(data)


@given(st.integers(0, len(WHOLE) - 1), st.integers(0, 40), st.binary(max_size=8))
@settings(max_examples=150, deadline=None)
def test_a_damaged_file_gives_a_curve_or_an_input_error(at, cut, put):
    rubbish_or_curve(WHOLE[:at] + put + WHOLE[at + cut :])


@given(st.text(alphabet="0123456789.,;\t \n-+eE\"'()sm", max_size=200))
@settings(max_examples=150, deadline=None)
def test_nearly_tables_give_a_curve_or_an_input_error(text):
    rubbish_or_curve(text.encode())


# ---- what is understood ------------------------------------------------------------------------


def test_what_was_understood_is_said():
    text = "DermaLab\nZeit [ms];Druck [kPa];Höhe [µm]\n" + rows(";", ",", scale=(1e3, -0.1, 1e3))
    imported = read(text.encode("latin-1"))
    check_ramp(imported)
    said = "; ".join(imported.understood)
    for words in (
        "Latin-1, separator semicolon, decimal comma",
        "time: column 'Zeit [ms]' in ms",
        "pressure: column 'Druck [kPa]' in kPa",
        "deflection: column 'Höhe [µm]' in µm",
        "101 samples, lines 3-103",
        "other lines not used: 1 before, 0 after",
        "the pressure was negated",
    ):
        assert words in said


def test_columns_cut_at_spaces():
    text = "Time (s)  Skin elevation (mm)\n" + rows("   ", ".", pick=(0, 2))
    check_ramp(read(text, RAMP))
    text = "t (s) elevation (mm)\n" + rows(" ", ",", pick=(0, 2))
    check_ramp(read(text, RAMP))


def test_a_long_file_whose_decimals_come_late():
    rest = "".join(f"{i / 10:.1f};0;0\n".replace(".0;", ";") for i in range(0, 25000, 10))
    pull = "".join(f"{2500 + i / 10:.1f};{i};0.00{i}\n" for i in range(1, 10))
    for sign in ".,":
        text = "t (s);p (mbar);w (mm)\n" + (rest + pull).replace(".", sign)
        curve = read(text).curve
        assert len(curve) == 2509
        assert curve.deflection_mm[-1] == 0.009


@pytest.mark.parametrize("heading", ["Einheit", "unit", "Unité", "Units 2"])
def test_units_in_columns_of_their_own(heading):
    """They were asked for, beside the columns that have them."""
    head = f"Zeit;{heading};Druck;{heading};Weg;{heading}\n"
    lines = [line.split(";") for line in rows(scale=(1e3, 0.1, 1e3)).splitlines()]
    text = "".join(f"{t};ms;{p};kPa;{w};µm\n" for t, p, w in lines)
    check_ramp(read(head + text))
    # A number of the device is none, and one row in another unit is not guessed at
    numbered = "".join(f"{line.replace(';', ';7;', 1)}\n" for line in rows().splitlines())
    check_ramp(read(f"t (s);{heading};p (mbar);w (mm)\n{numbered}"))
    assert "the unit of the pressure" in refusal(head + text.replace("kPa", "hPa", 1))


def test_a_header_that_is_marked_as_a_remark():
    for separator in (" ", ",", "\t"):
        check_ramp(read(separator.join(["# time_s", "pressure_mbar", "deflection_mm"]) + "\n"
            + rows(separator)))  # fmt: skip


def test_without_a_column_of_the_pressure_the_program_gives_it():
    text = "time (s);deflection (mm)\n" + rows(pick=(0, 2))
    imported = read(text, RAMP)
    check_ramp(imported)
    assert imported.curve.phase.tolist() == ["load"] * 101
    assert not imported.curve.partial
    assert "computed from the program, which started at 0 s" in imported.understood[-1]


def test_samples_behind_the_program_are_left_out_and_a_short_curve_is_partial():
    imported = read("time (s);deflection (mm)\n" + rows(n=150, pick=(0, 2)), RAMP)
    check_ramp(imported)
    assert "49 samples after the program's end left out" in imported.understood
    imported = read("time (s);deflection (mm)\n" + rows(n=50, pick=(0, 2)), RAMP)
    assert imported.curve.partial
    assert len(imported.curve) == 50


def test_when_the_program_started_must_be_known():
    text = "time (s);deflection (mm)\n" + "".join(
        f"{3 + 0.05 * i:.2f};{0.003 * i:.3f}\n" for i in range(101)
    )
    assert "--program-start-s 0 or 3.0" in refusal(text, RAMP)
    curve = read(text, RAMP, program_start_s="3").curve
    np.testing.assert_allclose(curve.pressure_mbar, np.arange(101.0), atol=1e-9)
    assert curve.time_s[0] == 3.0


def test_the_files_own_pressure_wins_over_the_program():
    imported = read("t (s);p (mbar);w (mm)\n" + rows(), RAMP)
    check_ramp(imported)
    assert "the pressure is the file's, not the program's" in imported.understood


def rested(rest_s, rate_mbar_per_s=20.0, top_mbar=100.0):
    """A file that begins so long before its ramp, and holds 2 s."""
    time = np.arange(0.0, rest_s + top_mbar / rate_mbar_per_s + 2.0, 0.05)
    pressure = np.clip(rate_mbar_per_s * (time - rest_s), 0.0, top_mbar)
    rows = (f"{t:.2f};{p:.3f};{0.003 * p:.5f}\n" for t, p in zip(time, pressure, strict=True))
    return "t (s);p (mbar);w (mm)\n" + "".join(rows)


@pytest.mark.parametrize("stated", [{}, {"program_start_s": "7"}])
def test_the_rest_before_the_program_is_none_of_its_loading(stated):
    """It had been fitted in the place of the loading, which came later by the clock."""
    hold = Setup(6.0, 1.0, parse_program("ramp:100@20,hold:2"))
    imported = read(rested(7.0), hold, **stated)
    curve = imported.curve
    assert curve.time_s[0] == pytest.approx(7.0, abs=0.051)
    loaded = curve.pressure_mbar[[phase == "load" for phase in curve.phase]]
    assert loaded[0] == pytest.approx(0.0, abs=1.1)
    assert loaded[-1] == pytest.approx(100.0, abs=1.1)
    assert 100 <= len(loaded) <= 102
    shown = "" if stated else ", as the pressure shows"
    assert imported.understood[-1].startswith("the program started at ")
    assert f"s{shown}: 14" in imported.understood[-1]


@pytest.mark.parametrize("stated", [{}, {"program_start_s": "7"}])
def test_when_a_rise_until_a_height_ended_is_not_told_by_the_clock(stated):
    rise = Setup(6.0, 1.0, parse_program("until:0.3mm@20,hold:2"))
    phases = read(rested(7.0), rise, **stated).curve.phase.tolist()
    assert phases.count("hold") == pytest.approx(40, abs=2)


def test_a_rest_of_the_program_that_the_file_lacks_is_not_taken_for_its_loading():
    rest = Setup(6.0, 1.0, parse_program("rest:3,ramp:100@20,hold:2"))
    imported = read(rested(0.0), rest)
    assert imported.understood[-1].startswith("the program started at -3")
    phases = imported.curve.phase.tolist()
    assert (phases.count("load"), phases.count("hold"), len(phases)) == (100, 40, 140)


def test_first_samples_may_be_lost_where_the_start_is_stated():
    lost = "t (s);p (mbar);w (mm)\n" + "".join(
        f"{3 + 0.05 * i:.2f};{i};{0.003 * i:.3f}\n" for i in range(60, 101)
    )
    curve = read(lost, Setup(6.0, 1.0, parse_program("ramp:80@20,hold:1")), program_start_s="3")
    assert curve.curve.phase.tolist() == ["load"] * 21 + ["hold"] * 20


@pytest.mark.parametrize("program", ["ramp:400@10", "ramp:20@2", "ramp:100@20,ramp:0@20,rest:20"])
def test_a_pressure_that_is_another_programs_is_refused(program):
    told = refusal(rested(0.0, 40.0, 160.0), Setup(6.0, 1.0, parse_program(program)))
    assert told.startswith(f"the pressure does not follow its program {program}: ")


def test_remarks_behind_the_table_are_counted_and_not_read():
    imported = read("t (s);p (mbar);w (mm)\n" + rows() + "\nR0;0.31\nend of file;;\n")
    assert "other lines not used: 0 before, 2 after" in imported.understood


@pytest.mark.parametrize(
    "remark",
    ["2 curves excluded", "2 curves excluded;;", "101 samples", "3 of 40 lost; see the log",
     "12.5.2026", "-- end --"],
)  # fmt: skip
def test_a_remark_may_begin_with_a_number(remark):
    """It was refused as a damaged row."""
    imported = read("t (s);p (mbar);w (mm)\n" + rows() + f"{remark}\n")
    check_ramp(imported)
    assert "other lines not used: 0 before, 1 after" in imported.understood


def test_a_remark_of_words_between_spaces_is_no_row():
    check_ramp(read("Time(s) p(mbar) w(mm)\n" + rows(" ") + "2 curves excluded\n"))


@pytest.mark.parametrize(
    ("row", "why"),
    [
        ("5.05;ERR;ERR", "p (mbar) is 'ERR', expected a number (decimal sign: a point)"),
        ("5.05;NaN;NaN", "p (mbar) is 'NaN', expected a number (decimal sign: a point)"),
        ("5.05;lost", "p (mbar) is 'lost', expected a number (decimal sign: a point)"),
        ("5.05;101", "2 fields, expected 3: w (mm) is missing"),
        ("5.0", "1 field, expected 3: p (mbar) is missing"),
        ("5.05;101;0.3x", "w (mm) is '0.3x', expected a number (decimal sign: a point)"),
    ],
)
def test_a_last_row_that_is_damaged_is_no_remark(row, why):
    head = "t (s);p (mbar);w (mm)\n"
    assert refusal(head + rows() + f"{row}\n") == f"line 103: {why}"
    if row.count(";") == 2:  # behind a label it was left aside in silence
        labelled = "".join(f"A;{line}\n" for line in rows().splitlines())
        assert refusal(f"Label;{head}{labelled}A;{row}\n") == f"line 103: {why}"


def workbook(*sheets, shift=0):
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, table in sheets:
        sheet = book.create_sheet(name)
        for r, row in enumerate(table, start=1 + shift):
            for c, value in enumerate(row, start=1 + shift):
                sheet.cell(r, c, value)
    data = io.BytesIO()
    book.save(data)
    return data.getvalue()


CELLS = [[0.05 * i, 1.0 * i, 3.0 * i] for i in range(101)]
TABLE = [["Subject", "P-1"], [], ["Time [s]", "Pressure [mbar]", "Deflection [µm]"], *CELLS]


def test_a_cell_at_the_end_of_a_sheet_is_none_of_the_table():
    """A million empty rows lay between, and each took its time."""
    book = openpyxl.load_workbook(io.BytesIO(workbook(("Curve 1", TABLE))))
    book["Curve 1"].cell(1_048_576, 16_384, 1.0)
    data = io.BytesIO()
    book.save(data)
    check_ramp(read(data.getvalue()))


MEANS = [["Mean", 50.0, 150.0], ["SD", 29.2, 87.5], ["Écart-type", 29.2, 87.5]]
SUMS = [["Sum", 252.5, 5050.0, 15150.0], ["Anzahl:", 101, 101, 101]]


@pytest.mark.parametrize(
    ("column", "behind"), [([], MEANS), ([None], SUMS), ([None], [[], ["Summary"], *SUMS])]
)
def test_sums_and_means_behind_the_table_are_no_samples(column, behind):
    """Means were a damaged row; a sum beside a column of labels was a sample of 5050 mbar."""
    head = [*(["Label"] if column else []), *TABLE[2]]
    table = [head, *([*column, *row] for row in CELLS), *behind]
    imported = read(workbook(("Curve 1", table)))
    check_ramp(imported)
    lines = sum(bool(row) for row in behind)
    assert f"other lines not used: 0 before, {lines} after" in imported.understood
    text = "\n".join(";".join("" if c is None else str(c) for c in row) for row in table)
    check_ramp(read(text))


@pytest.mark.parametrize("name", ["Sum", "Ø", "Σ", "MW", "Stabw."])
def test_a_sum_is_known_by_its_label_in_any_column(name):
    """Behind the numbers it was a sample at 252.5 s; of a mean the time did not increase."""
    head = "t (s);p (mbar);w (mm);Note\n"
    noted = "".join(f"{line};\n" for line in rows().splitlines())
    for end in ("252.5;5050;15.15", "2.5;50;0.15", "5;100;0.3"):
        check_ramp(read(f"{head}{noted}{end};{name}\n"))
        unlabelled = "".join(f"A;{line}\n" for line in rows().splitlines())
        check_ramp(read(f"Label;{head[:-6]}\n{unlabelled}{name};{end}\n"))


def test_a_last_sample_that_is_marked_as_the_highest_is_one():
    noted = "".join(f"{line};\n" for line in rows().splitlines())
    imported = read(f"t (s);p (mbar);w (mm);Note\n{noted}5.05;101;0.303;max\n")
    assert (len(imported.curve), imported.curve.time_s[-1]) == (102, 5.05)


def test_a_sum_that_nothing_names_is_asked_about():
    imported = read("t (s);p (mbar);w (mm)\n" + rows() + "252.5;5050;15.15\n")
    asked = (
        "line 103: 247.5 s behind the sample before it, and all before are of 5 s: is it a sum, "
        "and no sample?"
    )
    assert asked in imported.understood
    assert not any("sum" in said for said in read("t (s);p (mbar);w (mm)\n" + rows()).understood)


def test_rows_that_are_means_themselves_are_samples():
    head = ["Statistic", *TABLE[2]]
    check_ramp(read(workbook(("Curve 1", [head, *(["mean", *row] for row in CELLS)]))))


@pytest.mark.parametrize("shift", [0, 2])
def test_a_workbook(shift):
    imported = read(workbook(("notes", [["hello"]]), ("Curve 1", TABLE), shift=shift))
    check_ramp(imported)
    assert imported.understood[0] == "sheet 'Curve 1'"


def test_a_workbook_of_two_curves_says_which_number_is_another_one():
    table = [[*row, 1 + k // 60] for k, row in enumerate(CELLS)]
    told = refusal(workbook(("a", [[*TABLE[2], "Curve"], *table])))
    assert told.startswith("line 62: column 'Curve' is '2', and '1' before it: another curve")


def test_a_workbook_whose_numbers_are_texts():
    texts = [[f"{value:.4f}".replace(".", ",") for value in row] for row in CELLS]
    check_ramp(read(workbook(("a", [TABLE[2], *texts]))))


def test_of_several_sheets_one_must_be_named():
    data = workbook(("a", TABLE), ("b c", TABLE))
    assert "several sheets hold a table; say with --sheet a or 'b c'" in refusal(data)
    check_ramp(read(data, sheet="b c"))
    assert "--sheet 'd': expected one of a, b c" in refusal(data, sheet="d")


def test_a_damaged_workbook_is_refused():
    data = workbook(("a", TABLE))
    rng = np.random.default_rng(0)
    for size in (4, 100, len(data) // 2, len(data) - 10):
        assert "not a workbook" in refusal(data[:size])
    for _ in range(40):
        changed = bytearray(data)
        for at in rng.integers(4, len(data), 20):
            changed[at] = rng.integers(256)
        rubbish_or_curve(bytes(changed))


# ---- what stays open -----------------------------------------------------------------------------

OPEN = [
    ("time;pressure;deflection\n" + rows(), "time-unit"),
    ("t (s);pressure;w (mm)\n" + rows(), "pressure-unit"),
    ("t (s);pressure (psi);w (mm)\n" + rows(), "pressure-unit"),
    ("t (s);Druck (mm);w (mm)\n" + rows(), "pressure-unit"),
    (rows(), "time-column"),
    ("t (s);set (mbar);actual (mbar);w (mm)\n" + rows(pick=(0, 1, 1, 2)), "pressure-column"),
    ("t (s);a;w (mm)\n" + rows(), "pressure-column"),
    ("t (s),p (mbar),w (mm)\n" + rows(",", ","), "decimal"),
    ("t (s);p (mbar);w (mm)\n" + rows(scale=(1, 1, -1)), "deflection-sign"),
]


@pytest.mark.parametrize(("text", "option"), OPEN)
def test_what_stays_open_is_refused_with_the_option_that_says_it(text, option):
    assert f"; say with --{option} " in refusal(text)


@pytest.mark.parametrize(("text", "option"), OPEN)
def test_what_stays_open_can_be_answered(text, option):
    asked: list[Question] = []
    wanted = {
        "time-unit": "s", "pressure-unit": "mbar", "deflection-unit": "mm", "decimal": "comma",
        "deflection-sign": "-", "time-column": "1", "deflection-column": "3",
    }  # fmt: skip

    def answer(question):
        asked.append(question)
        if question.option in wanted:
            return wanted[question.option]
        if question.choices == ("2", "3"):
            return "2"
        return question.choices[-1]

    check_ramp(read(text, ask=answer))
    assert option in {question.option for question in asked}
    assert all(wanted.get(q.option, q.choices[0]) in q.choices for q in asked)


def test_an_answer_serves_all_files():
    asked: list[Question] = []
    answers = Answers({}, lambda question: asked.append(question) or "mbar")
    text = "t (s);pressure;w (mm)\n" + rows()
    for _ in range(3):
        check_ramp(import_bytes(PATH, text.encode(), PLAIN, answers))
    assert len(asked) == 1


def test_options_answer_without_a_question():
    imported = read(
        rows(), time_column="1", pressure_column="2", deflection_column="3", time_unit="s",
        pressure_unit="mbar", deflection_unit="mm",
    )  # fmt: skip
    check_ramp(imported)
    imported = read(
        "A;B;C\n" + rows(), time_column="a", pressure_column="B", deflection_column="C",
        time_unit="s", pressure_unit="mbar", deflection_unit="mm",
    )  # fmt: skip
    check_ramp(imported)
    check_ramp(read("t (s),p (mbar),w (mm)\n" + rows(",", ","), decimal="comma"))


# ---- what is refused -----------------------------------------------------------------------------


def damaged(row, replacement):
    lines = rows().split("\n")
    lines[row] = replacement
    return "t (s);p (mbar);w (mm)\n" + "\n".join(lines)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ("", "empty; expected a table"),
        (b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "it is not text"),
        (b"\xd0\xcf\x11\xe0" + bytes(600), "an old Excel file (.xls); expected .xlsx or text"),
        ("hello\nworld\n", "no table found; expected rows of at least two numbers"),
        (damaged(50, "bad;50;0.15"), "line 52: t (s) is 'bad', expected a number"),
        (damaged(50, "Mean;50;0.15"), "line 52: t (s) is 'Mean', expected a number"),
        (damaged(100, "#N/A;100;0.3"), "line 102: t (s) is '#N/A', expected a number"),
        (damaged(100, "n/a;100;0.3"), "line 102: t (s) is 'n/a', expected a number"),
        (damaged(100, ";100;0.3"), "line 102: t (s) is '', expected a number"),
        (damaged(50, "2.5;;0.15"), "line 52: p (mbar) is '', expected a number"),
        (damaged(50, "2.5;nan;0.15"), "line 52: p (mbar) is 'nan', expected a number"),
        (damaged(50, "2.5;5,0;0.15"), "(decimal sign: a point)"),
        (damaged(50, "2.5;50"), "line 52: 2 fields, expected 3"),
        (damaged(50, "2.5;50;"), "line 52: 2 fields, expected 3: w (mm) is missing"),
        (damaged(50, "2.5;1,050.0;0.1"), "without separators of thousands"),
        (damaged(50, "2.5;1'050;0.1"), "without separators of thousands"),
        (damaged(50, "2.5;50;0.1;7"), "line 52: 4 fields, expected 3"),
        (damaged(100, "5.0;10"), "line 102: 2 fields, expected 3"),
        (damaged(100, "5.0;nan;nan"), "line 102: p (mbar) is 'nan', expected a number"),
        (damaged(50, "2.45;50;0.15"), "line 52: time 2.45 s does not increase"),
        ("t (s);p (mbar);w (mm)\n" + rows(n=4), "4 samples; expected at least 5"),
        ("t (s);w (mm)\n" + rows(pick=(0, 2)), "or give the pressure program with --program"),
        ("t;p (mbar);w (mm)\n" + "soon;1;1\n" * 9, "line 1: no column of the time"),
        ("time;p (mbar);w (mm)\n" + "soon;1;1\n" * 9, "line 2: the time (column 'time') is no"),
        ("p (mbar);w (mm)\n" + rows(pick=(1, 2)), "line 1: no column of the time"),
        ("t (s);p (bar);w (mm)\n" + rows(), "line 3: a pressure of 1000 mbar; expected a suction"),
        ("t (s);p (mbar);w (cm)\n" + rows(scale=(1, 1, 9)), "expected less (is its unit right?)"),
        (f"t (s);p (mbar);w (mm)\n{rows()}\nt (s);p (mbar);w (mm)\n{rows()}", "a second table"),
        ("t (s);p (mbar);w (mm)\n" + rows(scale=(1, 0, 1)), "expected a suction"),
    ],
)
def test_refusals_name_the_line_and_what_was_expected(data, says):
    assert says in refusal(data)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match=r"absent\.txt: No such file"):
        import_file(tmp_path / "absent.txt", PLAIN, Answers())
    with pytest.raises(InputError, match="Is a directory"):
        import_file(tmp_path, PLAIN, Answers())
    with pytest.raises(InputError, match=r"byte 1 is not UTF-8 text"):
        read(b"\xb5", encoding="UTF-8")
    huge = tmp_path / "huge.csv"
    with huge.open("wb") as file:
        file.truncate(65 << 20)
    with pytest.raises(InputError, match="larger than 64 MB"):
        import_file(huge, PLAIN, Answers())


@pytest.mark.parametrize(
    ("stated", "says"),
    [
        ({"time_column": "9"}, "no such column; expected one of t (s), p (mbar), w (mm)"),
        ({"time_column": "p (mbar)"}, "one column cannot be two channels"),
        ({"time_unit": "mm"}, "'mm' is not a unit of time"),
        ({"decimal": "comma"}, "no table found"),
    ],
)
def test_options_that_do_not_fit(stated, says):
    text = "t (s);p (mbar);w (mm)\n" + rows()
    if "pressure" not in says and stated.get("time_column") == "p (mbar)":
        stated = {**stated, "pressure_column": "2"}
    assert says in refusal(text, **stated)


def test_an_answer_is_kept_for_files_with_the_same_headings(tmp_path):
    asked: list[str] = []

    def ask(question):
        asked.append(question.option)
        return "kPa"

    kept = tmp_path / "settings" / "imports.toml"
    rows = "".join(f"{0.1 * i:.1f};{i};{0.006 * i:.3f}\n" for i in range(51))
    paths = [tmp_path / f"{name}.txt" for name in ("monday", "tuesday", "other")]
    for path, heading in zip(paths, ("pressure", "pressure", "Pressure 2"), strict=True):
        path.write_text(f"t (s);{heading};w (mm)\n{rows}")
    import_file(paths[0], PLAIN, Answers({}, ask, Remembered(kept)))
    found = import_file(paths[1], PLAIN, Answers({}, None, Remembered(kept)))
    assert found.curve.pressure_mbar[-1] == 500.0
    assert "--pressure-unit kPa, as answered before" in found.understood
    with pytest.raises(InputError, match="unit of the pressure"):
        import_file(paths[2], PLAIN, Answers({}, None, Remembered(kept)))
    stated = import_file(
        paths[1], PLAIN, Answers({"pressure-unit": "mbar"}, None, Remembered(kept))
    )
    assert stated.curve.pressure_mbar[-1] == 50.0  # an option is more than what was said before
    kept.write_text(kept.read_text().replace("kPa", "mbar"))  # changed by hand
    changed = import_file(paths[1], PLAIN, Answers({}, None, Remembered(kept)))
    assert changed.curve.pressure_mbar[-1] == 50.0
    import_file(paths[1], PLAIN, Answers({}, ask, Remembered(kept, ask_again=True)))
    assert asked == ["pressure-unit", "pressure-unit"]
    kept.write_text("[[layout]]\nheading = []")
    with pytest.raises(InputError, match="did you mean headings"):
        Remembered(kept)


@pytest.mark.parametrize("glitch_mm", [-0.9, 60.0])
def test_a_glitch_of_the_deflection_turns_no_dome_and_is_no_other_unit(glitch_mm):
    """A study refused a curve for one reading that is left out of its fit."""
    lines = rows().splitlines(keepends=True)
    for at in (20, 70):
        lines[at] = ";".join([*lines[at].split(";")[:2], f"{glitch_mm}\n"])
    curve = read("t (s);p (mbar);w (mm)\n" + "".join(lines)).curve
    assert curve.deflection_mm[20] == glitch_mm
    assert curve.deflection_mm[-1] == pytest.approx(0.3)


def off(at, mbar, sign=1):
    """Return a file of a ramp to 100 mbar, some of whose readings are `mbar`."""
    pressures = [mbar if i in at else sign * i for i in range(101)]
    lines = (f"{0.05 * i:.2f};{p};{0.003 * i:.4f}\n" for i, p in enumerate(pressures))
    return "t (s);p (mbar);w (mm)\n" + "".join(lines)


@pytest.mark.parametrize("mbar", [700, 5000, -5000])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("at", [(20,), (20, 70), (40, 41)])
def test_a_glitch_of_the_pressure_is_told_and_is_no_other_unit(at, sign, mbar):
    """One reading of hundreds had refused the file."""
    imported = read(off(at, mbar, sign))
    told = [note for note in imported.understood if "a glitch, which no fit uses" in note]
    assert [note.partition(":")[0] for note in told] == [f"line {i + 2}" for i in at]
    curve = imported.curve
    assert curve.pressure_mbar[-1] == 100
    assert curve.pressure_mbar[at[0]] == sign * mbar
    assert set(curve.phase) == {"load"}
    assert np.flatnonzero(pressure_glitches(curve, 0.0)).tolist() == list(at)
    with_program = read(off(at, mbar, sign), RAMP).curve
    assert np.flatnonzero(pressure_glitches(with_program, 0.0)).tolist() == list(at)


@pytest.mark.parametrize("program", [PLAIN, RAMP])
@pytest.mark.parametrize("mbar", [700, 5000, -5000, -60])
@pytest.mark.parametrize("at", [(0,), (0, 1), (100,), (99, 100), (0, 100)], ids=str)
def test_a_glitch_may_be_the_first_or_the_last_reading(at, mbar, program):
    """It had refused the whole file."""
    imported = read(off(at, mbar), program)
    told = [note for note in imported.understood if "a glitch, which no fit uses" in note]
    assert [note.partition(":")[0] for note in told] == [f"line {i + 2}" for i in at]
    curve = imported.curve
    assert len(curve) == 101
    assert set(curve.phase) == {"load"}
    assert np.flatnonzero(pressure_glitches(curve, 0.0)).tolist() == list(at)


def test_a_reading_far_below_zero_may_be_a_glitch():
    """One of -60 mbar had refused a file whose other readings go from 0 to 100."""
    imported = read(off((40,), -60))
    assert "line 42: a pressure of -60 mbar stands alone" in "; ".join(imported.understood)
    imported = read(off((40,), 60, sign=-1))
    assert imported.curve.pressure_mbar[-1] == 100
    assert "line 42: a pressure of -60 mbar stands alone" in "; ".join(imported.understood)


@pytest.mark.parametrize(
    "at",
    [range(40, 45), range(98, 101), range(3), range(5, 95, 9)],
    ids=["a row", "the top", "the start", "many"],
)
def test_a_pressure_that_was_too_high_for_long_is_refused(at):
    assert f"line {at[0] + 2}: a pressure of 700 mbar; expected" in refusal(off(at, 700))


def test_a_peak_that_a_ramp_goes_to_is_no_glitch():
    peak = enumerate((*range(0, 651, 50), *range(600, -1, -50)))
    lines = (f"{0.1 * i:.1f};{p};{0.001 * p:.4f}\n" for i, p in peak)
    said = refusal("t (s);p (mbar);w (mm)\n" + "".join(lines))
    assert said.startswith("line 15: a pressure of 650 mbar; expected a suction")


# ---- odd forms -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("separator", "sign", "word"), [(";", ".", "point"), (";", ",", "comma"), ("\t", ".", "point")]
)
@pytest.mark.parametrize("which", [1, 2])
def test_what_may_separate_thousands_is_refused(separator, sign, word, which):
    """1.005 µm had come behind 990 µm, and 0.1 mbar behind 99."""
    lines = []
    for i in range(101):
        cells = [str(i), str(100 * i) if which == 1 else str(i), str(15 * i)]
        cells[which] = f"{int(cells[which]):,}".replace(",", sign)
        lines.append(separator.join(cells) + "\n")
    text = separator.join(["t (s)", "p (Pa)" if which == 1 else "p (mbar)", "w (µm)"]) + "\n"
    line = 12 if which == 1 else 69
    told = refusal(text + "".join(lines))
    assert told.startswith(f"line {line}: the {('pressure', 'deflection')[which - 1]} (column ")
    assert told.endswith(f"without such separators, or --decimal {word} if it is the decimal sign")
    if which == 2:  # read so, it is no dome
        assert "falls" in refusal(text + "".join(lines), decimal=word)


def test_whole_numbers_beside_decimals_are_no_thousands():
    text = "t (s);p (mbar);w (mm)\n"
    text += "".join(f"{0.125 * i:g};{1.5 * i:g};{0.003 * i:g}\n" for i in range(41))
    np.testing.assert_allclose(read(text).curve.deflection_mm, 0.003 * np.arange(41))


@pytest.mark.parametrize("setup", [PLAIN, RAMP])
def test_a_height_that_falls_under_suction_is_refused(setup):
    """A distance to the skin was imported as it is, and only identify said no."""
    lines = (f"{0.05 * i:.2f};{i};{5 - 0.003 * i:.4f}\n" for i in range(101))
    told = refusal("t (s);p (mbar);distance (mm)\n" + "".join(lines), setup)
    assert told.startswith("deflection_mm falls by 0.2")


def test_empty_lines_among_the_rows_are_told():
    lines = rows().splitlines(keepends=True)
    imported = read("t (s);p (mbar);w (mm)\n" + "".join([*lines[:50], "\n", "\n", *lines[50:]]))
    check_ramp(imported)
    assert "empty lines among them, the first behind line 51" in imported.understood


def test_a_time_that_seems_to_be_of_another_unit_is_asked_about():
    told = read("t (s);p (mbar);w (mm)\n" + rows(scale=(1000, 1, 1))).understood
    assert "a sample every 50 s, and 5000 s in all: is the time in milliseconds?" in told
    days = [[time_s / 86_400, p, w] for time_s, p, w in CELLS]
    told = read(workbook(("Curve 1", [*TABLE[:3], *days]))).understood
    assert "5.8e-05 s in all: is the time in minutes, or in days as of a spreadsheet?" in told


@pytest.mark.parametrize("separator", [";", ","])
def test_headings_over_several_lines_and_blanks_before_quotes(separator):
    head = separator.join(['"Time\n(s)"', '"Pressure\n(mbar)"', ' "Skin\nheight\n(mm)"'])
    lines = rows(f'"{separator} "', ".").splitlines()
    check_ramp(read(f"{head}\n" + "".join(f'"{line}"\n' for line in lines)))
    check_ramp(read('Probe 1/4", new\nt (s);p (mbar);w (mm)\n' + rows()))


def test_a_line_of_units_that_contradicts_the_headings_leaves_them_open():
    """Those of the line had counted, in silence: ten times the pressure."""
    text = "Time;Pressure (mbar);Height\ns;{};mm\n" + rows(scale=(1, 0.5, 1))
    assert "the unit of the pressure" in refusal(text.format("kPa"))
    assert read(text.format("hPa")).curve.pressure_mbar[-1] == 50.0


# ---- several curves in one table -----------------------------------------------------------------


def labelled(heading, *labels):
    """A file of a ramp with a column more, whose labels share the rows."""
    lines = rows().splitlines()
    each = len(lines) // len(labels) + 1
    table = "".join(f"{row};{labels[i // each]}\n" for i, row in enumerate(lines))
    return f"t (s);p (mbar);w (mm);{heading}\n{table}"


@pytest.mark.parametrize("stated", [{}, {"deflection_column": "w (mm)"}])
@pytest.mark.parametrize(
    ("heading", "labels", "says"),
    [
        ("aperture_mm", (6, 2), "line 53: column 'aperture_mm' is 2, and the curve is stated to"),
        ("Öffnung [mm]", (2,), "line 2: column 'Öffnung [mm]' is 2, and the curve is stated to be"),
        ("probe opening", ("6 mm", "2 mm"), "line 53: column 'probe opening' is '2 mm', and"),
        ("Curve", (1, 2), "line 53: column 'Curve' is '2', and '1' before it: another curve"),
        ("Messung Nr.", ("a", "b", "c"), "line 36: column 'Messung Nr.' is 'b', and 'a' before"),
        ("Site", ("left", "right"), "line 53: column 'Site' is 'right', and 'left' before it"),
    ],
)
def test_a_column_that_tells_of_several_curves_refuses_them(heading, labels, says, stated):
    """Both had been one curve, once somebody had said which of the lengths is the deflection."""
    told = refusal(labelled(heading, *labels), **stated)
    assert told.startswith(says)
    assert "expected one curve" in told


@pytest.mark.parametrize(
    ("heading", "labels"),
    [
        ("aperture (mm)", (6,)),
        ("aperture (µm)", (6000,)),
        ("opening radius", (3,)),
        ("valve opening (%)", (0, 50)),
        ("opening", (0, 1)),
        ("skin thickness (mm)", (1.2,)),
        ("curve", ("", 1)),
        ("curve", range(101)),
        ("phase", ("load", "unload")),
        ("cycle", (1, 2)),
    ],
)
def test_a_column_beside_a_curve_is_no_other_curve_and_no_deflection(heading, labels):
    check_ramp(read(labelled(heading, *labels)))


# ---- times of a clock ----------------------------------------------------------------------------


def clock(seconds, *, hours=True, decimal="."):
    """Return hh:mm:ss.fff or mm:ss.fff; hours and minutes begin again."""
    ms = round(1000 * seconds)
    minutes, rest = divmod(ms // 1000, 60)
    hour = f"{minutes // 60 % 24:02d}:" if hours else ""
    return f"{hour}{minutes % 60:02d}:{rest:02d}{decimal}{ms % 1000:03d}"


def clocked(texts, head="Time;p (mbar);w (mm)"):
    lines = (f"{text};{i};{0.003 * i:.4f}\n" for i, text in enumerate(texts))
    return f"{head}\n{''.join(lines)}"


@pytest.mark.parametrize(
    "begin_s", [0.0, 37_233.05, 86_398.0], ids=["elapsed", "of the day", "past midnight"]
)
@pytest.mark.parametrize(("hours", "decimal"), [(True, "."), (True, ","), (False, ".")])
def test_a_clock_tells_the_time(begin_s, hours, decimal):
    texts = [clock(begin_s + 0.05 * i, hours=hours, decimal=decimal) for i in range(101)]
    imported = read(clocked(texts))
    np.testing.assert_allclose(
        imported.curve.time_s, begin_s % (86_400 if hours else 3600) + 0.05 * np.arange(101)
    )
    assert "time: column 'Time' in hh:mm:ss" in imported.understood
    assert read(clocked(texts, "t;p (mbar);w (mm)")).curve.time_s.tolist() == (
        imported.curve.time_s.tolist()
    )


def test_beside_a_clock_a_comma_is_a_decimal_sign_all_the_same():
    """Pressures in whole mbar were numbers by a point, too, and with a clock enough for a table."""
    texts = [clock(0.05 * i, decimal=",") for i in range(101)]
    imported = read(clocked(texts).replace(".", ","))
    assert "decimal comma" in imported.understood[0]
    np.testing.assert_allclose(imported.curve.deflection_mm, 0.003 * np.arange(101), atol=1e-4)


def test_a_clock_is_enough_beside_one_channel():
    texts = [clock(0.05 * i) for i in range(101)]
    lines = "".join(f"{text};{0.003 * i:.4f}\n" for i, text in enumerate(texts))
    check_ramp(read("time;deflection (mm)\n" + lines, RAMP))


def test_seconds_are_taken_before_a_clock():
    data = "Time;Elapsed time (s);p (mbar);w (mm)\n"
    data += "".join(f"10:20:33;{row}\n" for row in rows().splitlines())
    check_ramp(read(data))
    assert "does not increase" in refusal(data, time_column="1")


@pytest.mark.parametrize(
    ("texts", "says"),
    [
        (["10:20", "10:21"] * 5, "line 2: the time '10:20' may be hours and minutes, or minutes"),
        (["10:59:59", "11:00"] * 5, "line 3: the time '11:00' may be hours and minutes"),
        (["10:59:59", "11:00:61"] * 5, "line 3: the time is '11:00:61'; expected hh:mm:ss, or"),
        (["10:59:59", "10:59:58"] * 5, "line 3: time 39598 s does not increase"),
        ([f"{h}:00:00" for h in (1, 23, 0, 23, 0, 1)], "does not increase"),
        (["10:20:33 xm", "10:20:34 xm"] * 5, "is not a number in most rows; expected numbers, or"),
        (
            ["1:20 PM", "1:21 PM"] * 5,
            "line 2: the time '1:20 PM' has no seconds; expected hh:mm:ss",
        ),
        (["13:20:33 PM"] * 9, "line 2: the time is '13:20:33 PM'; expected hh:mm:ss"),
        (["1:20:33 PM", "1:20:34"] * 5, "line 3: the time '1:20:34' is of another form than that"),
        (["29.11.2026 10:03"] * 9, "line 2: the time '29.11.2026 10:03' has no seconds"),
        (["31.11.2026 10:03:05"] * 9, "line 2: there is no date '31.11.2026'; expected one as"),
    ],
)
def test_a_clock_that_may_be_read_in_two_ways_is_refused(texts, says):
    assert says in refusal(clocked(texts))


@pytest.mark.parametrize("separator", [";", ",", "\t", " "])
@pytest.mark.parametrize("half", ["{} {}", "{}{}", "{} {}."])
def test_a_clock_may_have_am_and_pm(separator, half):
    """Noon and midnight are 12, and were not read at all."""
    if separator == " " and half.endswith("."):
        half = "{} {}"
    for begin_s in (37_233.05, 43_198.0, 46_798.0, 86_398.0):
        texts = []
        for i in range(101):
            text = clock(begin_s + 0.05 * i)
            hour = int(text[:2])
            text = f"{hour % 12 or 12}{text[2:]}"
            texts.append(half.format(text, ("AM", "PM")[hour >= 12]))
        imported = read(clocked(texts).replace(";", separator))
        np.testing.assert_allclose(imported.curve.time_s, begin_s + 0.05 * np.arange(101))


DATES = [
    "%Y-%m-%d %H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S.%fZ", "%Y-%m-%dT%H:%M:%S.%f+01:00",
    "%d.%m.%Y %H:%M:%S,%f", "%d.%m.%y, %H:%M:%S.%f", "%d/%m/%Y %H:%M:%S.%f",
    "%m/%d/%Y %I:%M:%S.%f %p", "%Y/%m/%d %H:%M:%S.%f", "%d-%b-%Y %H:%M:%S.%f",
]  # fmt: skip


@pytest.mark.parametrize("form", DATES)
@pytest.mark.parametrize(
    "begin",
    [(2026, 11, 29, 10, 3), (2026, 5, 6, 23, 59), (2026, 12, 31, 23, 59), (2026, 5, 31, 23, 59)],
)
def test_a_clock_may_have_the_date_before_it(form, begin):
    first = datetime(*begin, 58)
    texts = [(first + timedelta(milliseconds=50 * i)).strftime(form) for i in range(101)]
    curve = read(clocked(texts)).curve
    np.testing.assert_allclose(curve.time_s - curve.time_s[0], 0.05 * np.arange(101), atol=1e-9)


@pytest.mark.parametrize("dated", [False, True])
def test_a_workbook_may_have_times_of_the_day(dated):
    book = openpyxl.Workbook()
    book.active.append(["Time", "p (mbar)", "w (mm)"])
    for i in range(101):
        at = datetime(2026, 3, 1, 10) + timedelta(milliseconds=50 * i)
        book.active.append([at if dated else at.time(), float(i), 0.003 * i])
    stream = io.BytesIO()
    book.save(stream)
    time_s = read(stream.getvalue()).curve.time_s
    np.testing.assert_allclose(time_s, 36_000 + 0.05 * np.arange(101), atol=1e-3)
