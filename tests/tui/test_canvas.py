from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drivers.events import Sample
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.growing import GrowingCurve
from skinlab.curves.program import parse_program
from skinlab.inference.result import Identification
from skinlab.tui.canvas import braille, dots, interval_bar, runs, share
from skinlab.tui.curve_drawing import Layers, curve_rows
from skinlab.tui.plot_data import against_time, box_around, left_out, measured, residual
from skinlab.tui.shown import Entry, Live

SETUP = Setup(6.0, 1.0, parse_program("ramp:100@20"))
ANY = st.floats(-2, 2) | st.just(float("nan"))


def test_the_corners():
    assert braille(dots([0, 1, 0, 1], [0, 0, 1, 1], 1, 1)) == ["⣉"]
    assert braille(dots([0, 1], [1, 0], 2, 2)) == ["⠁ ", " ⢀"]
    assert braille(dots([0.5], [0.5], 0, 3)) == ["", "", ""]


@given(st.lists(st.tuples(ANY, ANY), max_size=30), st.integers(0, 9), st.integers(0, 9))
def test_every_point_inside_is_a_dot_and_no_other(points, columns, rows):
    x, y = np.array(points).reshape(-1, 2).T
    bits = dots(x, y, columns, rows)
    assert bits.shape == (rows, columns)
    inside = [(a, b) for a, b in points if 0 <= a <= 1 and 0 <= b <= 1]
    one_by_one = np.zeros_like(bits)
    for a, b in inside:
        one_by_one |= dots([a], [b], columns, rows)
    assert (bits == one_by_one).all()
    lit = int(np.unpackbits(bits).sum())
    assert (lit > 0) == bool(inside and columns and rows)
    assert lit <= len(inside)


def test_shares_of_a_range():
    assert share([0, 5, 10], 0, 10).tolist() == [0, 0.5, 1]
    assert share([1.0], 2.0, 2.0).tolist() == [-1.0]


def test_cells_of_one_colour_come_together_and_the_first_layer_is_on_top():
    left = dots([0.1, 0.3], [0.5, 0.5], 4, 1)
    whole = dots((np.arange(8) + 0.5) / 8, np.full(8, 0.5), 4, 1)
    (row,) = runs((left, whole))
    assert [(len(text), layer) for text, layer in row] == [(2, 0), (2, 1)]
    assert "".join(text for text, _ in row) == braille(left | whole)[0]
    nothing = dots([], [], 0, 2)
    assert runs((nothing, nothing)) == [[], []]


def test_bars():
    assert interval_bar(0.25, 0.5, 0.75, 9) == "··├─●─┤··"
    assert interval_bar(-1, 0.5, 2, 9) == "◄───●───►"
    assert interval_bar(0.5, 0.5, 0.5, 9) == "····●····"
    assert interval_bar(0, 0.25, 0.5, 9, (0.5, 1)) == "├─●─┤░░░░"
    assert interval_bar(0, 0, 1, 0) == ""


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3), st.integers(1, 60))
def test_a_bar_has_its_width_and_one_value(a, b, c, columns):
    low, best, high = sorted((a, b, c))
    bar = interval_bar(low, best, high, columns)
    assert len(bar) == columns
    assert bar.count("●") == 1


def entry(noise_um=3.0):
    n = 50
    p = np.linspace(0, 100, n)
    w = p / 200
    model = w - 0.002
    model[40:] = np.nan
    result = Identification(
        "c", SETUP, None, points=n, noise_um=noise_um, rms_um=2.0, model_mm=model
    )
    return Entry(1, Curve("c", SETUP, p / 20, p, w), None, 0, result)


def test_the_residual_lies_where_it_belongs():
    drawing = residual(entry(), 40, 5)
    rows = braille(drawing.main)
    assert (drawing.top, drawing.bottom) == ("+8", "-8")
    # 2 of 8 µm above the middle, where the model is; nothing to the right of it
    assert [bool(row.strip()) for row in rows] == [False, True, False, False, False]
    assert rows[1].rstrip() == rows[1][: len(rows[1].rstrip())]
    assert len(rows[1].rstrip()) < 32
    assert [bool(row.strip()) for row in braille(drawing.band)] == [True, False, False, False, True]
    assert "rms 2" in drawing.caption
    assert "±6" in drawing.caption
    assert not residual(entry(noise_um=None), 40, 5).band.any()


def test_glitches_are_marked_as_such_each_and_are_no_measured_points():
    shown = entry()
    assert left_out(shown) is None
    w = shown.curve.deflection_mm.copy()
    w[[10, 30]] += 0.2
    out = np.isin(np.arange(50), [10, 30])
    shown.curve = replace(shown.curve, deflection_mm=w)
    shown.result = replace(shown.result, outliers=out)
    layers = Layers(points=measured(shown), left_out=left_out(shown), fitted=measured(entry()))
    assert len(layers.points) == 48
    assert layers.left_out.deflection_mm.tolist() == w[out].tolist()
    rows = curve_rows(layers, box_around(100.0, layers.all), 60, 15)
    legend, *plot = ["".join(text for text, _ in row) for row in rows]
    assert "× left out" in legend
    assert sum(row.count("×") for row in plot) == 2
    none = replace(layers, left_out=None)
    assert "×" not in str(curve_rows(none, box_around(100.0, none.all), 60, 15))


def test_no_residual_without_a_model():
    bare = entry()
    bare.result = None
    assert residual(bare, 40, 5) is None


def test_both_channels_rise_with_time():
    live = Live(1, GrowingCurve(SETUP))
    assert not against_time(live, 20, 4).main.any()
    for k in range(51):
        live.curve.append(Sample(k, 0.05 * k, 1.0 * k, 0.01 * k, 0))
    drawing = against_time(live, 20, 4)
    for layer in (drawing.main, drawing.second):
        columns = np.flatnonzero(layer.any(axis=0))
        assert columns[0] == 0
        assert columns[-1] in (9, 10)  # half of the program
        assert layer[-1, 0]
    assert live.rate_hz == 20.0 or abs(live.rate_hz - 20.0) < 1e-9
