from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.events import Alarm, Hello, HostVented, InstrumentState, Sample, State
from skinlab.acquisition.measurement_messages import Phase
from skinlab.acquisition.measurement_request import DEFAULTS, complaint, read_order, with_opening
from skinlab.acquisition.messages import Connected, Disconnected, Failed, Heard, Saved, Went
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.growing import GrowingCurve
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.inference.error_judgement import ErrorModelSummary
from skinlab.inference.result import Identification, Value
from skinlab.quality.gates.base import Finding
from skinlab.recording.recorder import new_session_path
from skinlab.recording.stream import (
    CurveCompleted,
    CurveStarted,
    Flagged,
    Happened,
    Identified,
    Sampled,
)
from skinlab.report.rounding import interval_words
from skinlab.studies.reference import Range
from skinlab.tui.card_text import (
    VerdictText,
    card_text,
    result_lines,
    row_texts,
    verdict_text,
)
from skinlab.tui.plot_data import (
    Trace,
    box_around,
    fitted,
    measured,
    nice_ticks,
    round_up,
    spaced,
    thin,
)
from skinlab.tui.shown import Entry
from skinlab.tui.text import state_text, suction_text
from skinlab.tui.ui_state import Board, Level
from skinlab.tui.value_text import digits, flag_words, interval_text

HELLO = Hello("reference", 1, "rig", "1.0", "7", 6.0, 500.0, 60.0, 1.0, 1000.0, simulated=False)
SETUP = Setup(6.0, 1.0, parse_program("ramp:100@20"))


def curve(n=20):
    t = np.arange(n) * 0.05
    return Curve("curve 1", SETUP, t, 5.0 * np.arange(n), 0.01 * np.arange(n))


def result(n=20, **changes):
    fields = {
        "points": n,
        "parameters": {
            "X1_MPa": Value(0.025, 0.021, 0.03),
            "X2_MPa": Value(2.9),
            "nu": Value(0.28, 0.21, 0.46),
        },
        "derived": {"nu_consistent": 0.324, "kappa_MPa": 0.135},
        "error_um": 0.42,
        "rms_um": 3.0,
        "flags": ("not_identifiable:nu", "frozen_sensor"),
        "fitted": np.ones(n, dtype=bool),
        "model_mm": np.linspace(0, 0.2, n),
    }
    return Identification("curve 1", SETUP, None, **{**fields, **changes})


# ---- orders ---------------------------------------------------------------------------------


def test_the_defaults_make_an_order():
    order = read_order({**DEFAULTS, "port": " sim:// "})
    assert order.port == "sim://"
    assert order.setup == SETUP
    assert order.visit == ("", "")


def test_a_decimal_comma_is_understood():
    assert read_order({**DEFAULTS, "port": "p", "thickness_mm": "1,2"}).setup.thickness_mm == 1.2


def test_another_head_of_a_simulated_probe_is_another_url():
    assert with_opening("sim://", 2.0) == "sim://?aperture_mm=2"
    assert with_opening("sim://?aperture_mm=6&seed=1", 8.0) == "sim://?seed=1&aperture_mm=8"
    assert with_opening("sim://?skin=/a/b.toml", 2.0) == "sim://?skin=/a/b.toml&aperture_mm=2"
    assert with_opening("/dev/ttyUSB0", 2.0) == "/dev/ttyUSB0"


@given(st.text(max_size=30))
@settings(max_examples=40)
def test_what_has_no_complaint_makes_an_order_and_the_other_way_round(text):
    for field in ("aperture_mm", "thickness_mm", "cycle", "program"):
        texts = {**DEFAULTS, "port": "p", field: text}
        if complaint(field, text) is None:
            assert read_order(texts)
        else:
            with pytest.raises(InputError):
                read_order(texts)


# ---- words ----------------------------------------------------------------------------------


def test_a_result_in_words():
    lines = result_lines(result())
    assert lines[:2] == ["X1 stiffness at small stretch", " 0.021–0.030 MPa  (0.025)"]
    assert lines[2].split()[0] == "0.01"  # the scale is labelled at both ends
    assert "├─●─┤" in lines[2]
    assert lines[5] == " 2.90 MPa, no interval"
    assert lines[7] == " 0.21–0.46, not fixed"  # no number stands over what no data fix
    assert lines[9] == " ν of linear elasticity 0.32"
    assert "rms 3.00 µm" in lines
    assert not any(line.startswith("errors") for line in lines)
    told = result(error_model=ErrorModelSummary("white+ou+quantised", {}, "steps are seen"))
    assert "errors: noise, lasting, steps" in result_lines(told)
    assert all(len(line) <= 34 for line in lines)  # the panel at 80 columns
    wide = result_lines(result(), 60)
    assert " 0.21–0.46, not fixed by this curve" in wide


def test_the_usual_range_stands_behind_the_bar():
    usual = Range(
        quantity="X1_MPa", site="arm", aperture_mm=6.0, program="ramp:100@20",
        percentiles={"5": 0.04, "95": 0.08}, n=40,
    )  # fmt: skip
    (bar,) = [b for b in result_lines(result(), 40, {"X1_MPa": usual}) if "░" in b]
    assert bar.index("┤") < bar.index("░")  # below what is usual


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [(1.034, 3.317, "1.0–3.3"), (0.02213, 0.02664, "0.0221–0.0266"), (0.2, 0.378, "0.20–0.38"),
     (123.4, 987.0, "100–1000"), (1.0, 1.0, "1.00–1.00")],
)  # fmt: skip
def test_a_number_has_the_digits_that_its_interval_carries(low, high, text):
    assert interval_words(Value((low + high) / 2, low, high)) == text


def test_no_result_says_why():
    lines = result_lines(Identification("c", SETUP, "too few samples"))
    assert "too few samples" in " ".join(lines)


def test_rows_of_the_list():
    entry = Entry(1, curve(), None, 0)
    empty = ("1", "no subject", "", "", "6", "1", "", "", "", "ramp:100@20", "", "")
    assert row_texts(entry) == empty
    entry.visit, entry.at = ("P07", "forearm"), datetime(2026, 1, 2, 14, 32)
    assert row_texts(entry)[1:3] == ("P07, forearm", "14:32")
    entry.result = result()
    assert row_texts(entry)[6:9] == ("0.021–0.030", "2.90", "0.21–0.46?")
    assert row_texts(entry)[3] == "good"


def test_unknown_flags_are_readable():
    assert flag_words("at_bound:X1_MPa") == "X1 at the edge of its range"
    assert flag_words("some_gate") == "some gate"
    assert flag_words("thinned:2") == "one in 2 samples fitted"  # no "2th"
    assert flag_words("outliers:1") == "samples left out: 1"
    assert digits(100.0, 3) == "100"
    assert interval_text(Value(1.0)) == ""


# ---- traces ---------------------------------------------------------------------------------


@given(st.floats(1e-9, 1e9))
def test_round_numbers_are_above_and_near(value):
    assert value * (1 - 1e-9) <= round_up(value, least=1e-12) <= 2.01 * value


@given(st.integers(0, 5000), st.integers(2, 300))
def test_thinning_keeps_the_ends_and_the_order(n, most):
    x = np.arange(n, dtype=float)
    got = thin(Trace(x, x), most)
    assert len(got) <= most + 1
    if n:
        assert got.pressure_mbar[0] == 0
        assert got.pressure_mbar[-1] == n - 1
    assert (np.diff(got.pressure_mbar) > 0).all()


def test_the_box_holds_everything_and_marks_lie_apart():
    entry = Entry(1, curve(), None, 0, result())
    points, fit = measured(entry), fitted(entry)
    box = box_around(100.0, [points, fit])
    assert len(box.inside(points)) == len(points)
    assert (box.left_mbar, box.right_mbar, box.bottom_mm) == (0.0, 105.0, 0.0)
    assert 1 < len(spaced(points, box, 0.2)) < len(points)
    empty = Trace(np.array([]), np.array([]))
    assert box_around(None, [empty]).top_mm == pytest.approx(0.1)
    assert len(spaced(empty, box)) == 0
    assert box_around(None, [Trace(np.array([1.0]), np.array([-0.5]))]).bottom_mm <= -0.5


@given(st.floats(-5.0, 5.0), st.floats(1e-3, 100.0), st.integers(0, 20))
def test_ticks_are_round_even_and_not_too_many(low, span, most):
    ticks = nice_ticks(low, low + span, most)
    assert 1 <= len(ticks) <= max(most, 2)
    assert all(low - 1e-6 * span <= tick <= low + (1 + 1e-6) * span for tick in ticks)
    steps = np.diff(ticks)
    assert np.allclose(steps, steps[:1])
    assert nice_ticks(0.0, 0.8, 4) == pytest.approx([0.0, 0.5])


def test_no_model_no_line():
    entry = Entry(1, curve(), None, 0)
    assert fitted(entry) is None
    entry.result = result(model_mm=np.full(20, np.nan))
    assert fitted(entry) is None


# ---- the board ------------------------------------------------------------------------------


def running_board():
    board = Board("p")
    board.begin("connecting", "")
    board.see(Connected("p", HELLO))
    growing = GrowingCurve(SETUP)
    board.see(Heard((CurveStarted(1, growing), Happened(State(InstrumentState.RUNNING, "")))))
    return board


def test_while_the_link_is_lost_v_is_no_text_and_no_vent_is_promised():
    """The top said "SUCTION? v vents", and v was text for the field that had the focus."""
    board = running_board()
    sample = Sample(0, 0.0, 1.0, 0.1, 0)
    board.see(Heard((Sampled(1, sample), CurveCompleted(1, curve(), "cut", 0))))
    assert state_text(board).endswith("link ok")
    board.see(Went(Phase.SEARCHING, None, None))
    assert board.suction
    assert board.moving
    assert state_text(board).startswith("LINK LOST")
    assert suction_text(board) == "SUCTION? no link"
    board.see(Heard((Happened(Alarm("lift it")),)))
    assert verdict_text(board).following == "F9 acknowledges"
    board.see(Disconnected("p"))
    assert suction_text(board) == "SUCTION? no link"


def test_under_an_alarm_and_a_fault_the_next_step_is_theirs():
    """It was "Good curve; next: F8 measures again" while the valve was stuck."""
    board = running_board()
    board.see(Heard((CurveCompleted(1, curve(), None, 0), Identified(1, curve(), result()))))
    board.see(Heard((Happened(State(InstrumentState.FAULT, "")), Happened(Alarm("lift it")))))
    assert verdict_text(board).words == "Alarm: lift the probe"
    board.acknowledge()
    assert verdict_text(board) == VerdictText("The instrument has a fault", "F8 clears it")


def test_behind_a_stuck_valve_readings_are_of_now_for_as_long_as_they_come():
    """ "last:" stood before them, which means that nothing is read."""
    board = running_board()
    board.tick(10.0)
    board.see(Heard((Happened(State(InstrumentState.FAULT, "")),)))
    board.see(Heard((Sampled(1, Sample(0, 0.0, 47.6, 0.1, 0)),)))
    assert board.streaming
    seen = board.version
    board.tick(12.0)
    assert not board.streaming
    assert board.version > seen  # drawn, though nothing came


def test_how_to_end_it_comes_before_the_advice():
    """At 80 columns it was cut off behind the advice on a sensor."""
    board = running_board()
    finding = Finding("frozen", "it stands still", "switch the probe off and on " * 4)
    board.see(Heard((Flagged(1, finding),)))
    assert verdict_text(board).following.startswith("v vents; switch")


def test_the_card_names_no_key_that_means_nothing_now():
    board = Board("p")
    assert "F8" in card_text(board, 40).lines[0]
    board.begin("connecting", "")
    assert "F8" not in "".join(card_text(board, 40).lines)


def test_the_board_follows_a_run():
    board = running_board()
    assert board.phase == "RUNNING"
    assert board.moving
    sample = Sample(0, 0.0, 1.0, 0.1, 0)
    board.live.curve.append(sample)
    board.see(Heard((Sampled(1, sample),)))
    board.see(Heard((Sampled(1, Sample(1, 5.0, 9.0, 0.2, 1)),)))  # of the vent: not the curve's
    assert board.live.curve.pressure_mbar.tolist() == [1.0]
    assert board.latest.pressure_mbar == 9.0
    done = curve()
    board.see(Heard((CurveCompleted(1, done, None, 0), Identified(1, done, result()))))
    board.see(Heard((Happened(State(InstrumentState.LOADED, "")),)))
    assert board.entry.result is not None
    assert board.can_arm
    board.see(Disconnected("p"))
    assert board.phase == "NO PROBE"
    assert board.entry is not None  # still to be read


def test_a_run_without_a_curve_says_so():
    board = running_board()
    board.see(Heard((Happened(State(InstrumentState.VENTING, "host")),)))
    assert board.live is None
    assert "too few samples" in board.note


def test_what_is_worse_is_not_covered_by_what_is_not():
    board = running_board()
    board.see(Heard((Happened(HostVented("stale link")),)))
    assert board.level is Level.ERROR
    board.say(Level.INFO, "saved")
    assert "stale link" in board.note
    board.see(Failed("arming", "no"))
    assert board.note == "no"


def test_session_names_are_new(tmp_path):
    now = datetime(2026, 1, 2, 3, 4, 5)
    first = new_session_path(tmp_path, now)
    assert first.name == "session-20260102-030405.h5"
    first.touch()
    second = new_session_path(tmp_path, now)
    second.with_name(second.name + ".journal").touch()
    assert len({first, second, new_session_path(tmp_path, now)}) == 3


def test_a_question_is_not_covered_by_what_is_no_worse():
    board = Board("sim://")
    board.ask("why is curve 1 left out?")
    board.see(Saved(Path("visit.h5")))
    assert board.note == "why is curve 1 left out?"
    assert "saved: visit.h5" in [text for text, _ in board.told]  # w shows it
    board.see(Heard((Happened(HostVented("operator")),)))
    assert board.note == "vented"
