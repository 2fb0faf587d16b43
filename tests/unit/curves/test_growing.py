from __future__ import annotations

import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.events import Sample
from skinlab.curves.curve import Setup
from skinlab.curves.growing import GrowingCurve
from skinlab.curves.program import parse_program
from skinlab.errors import InputError

SETUP = Setup(6.0, 1.0, parse_program("ramp:100@20,ramp:0@20"))


def sample(number, time_s=None, segment=0):
    at = number / 20 if time_s is None else time_s
    return Sample(number, at, float(number), 0.001 * number, segment)


def test_what_was_appended_is_there_whatever_its_length():
    growing = GrowingCurve(SETUP)
    for number in range(5000):
        assert growing.append(sample(number, segment=int(number >= 3000)))
    assert len(growing) == 5000
    assert np.array_equal(growing.time_s, np.arange(5000) / 20)
    assert np.array_equal(growing.pressure_mbar, np.arange(5000.0))
    assert np.array_equal(growing.deflection_mm, 0.001 * np.arange(5000))
    assert np.array_equal(growing.segment, np.arange(5000) >= 3000)
    assert growing.began_s == ((0, 0.0), (1, 150.0))


@given(st.lists(st.floats(0, 10), max_size=60))
def test_time_only_goes_on(times):
    """One rule for everybody: what is not later is no point, and is counted."""
    growing = GrowingCurve(SETUP)
    kept = [growing.append(sample(i, time_s)) for i, time_s in enumerate(times)]
    assert (np.diff(growing.time_s) > 0).all()
    assert len(growing) == sum(kept)
    assert growing.steps_back == len(times) - sum(kept)
    if times:
        assert growing.time_s[-1] == max(times)


def test_columns_are_of_one_moment_and_read_only():
    growing = GrowingCurve(SETUP)
    for number in range(10):
        growing.append(sample(number))
    columns = growing.columns
    for number in range(10, 3000):
        growing.append(sample(number))
    assert {len(column) for column in columns} == {10}
    assert np.array_equal(columns[1], np.arange(10.0))
    with pytest.raises(ValueError, match="read-only"):
        columns[1][0] = 7.0


def test_another_thread_may_read():
    growing = GrowingCurve(SETUP)
    over = threading.Event()
    wrong = []

    def read():
        while not over.is_set():
            time_s, pressure_mbar, _, _ = growing.columns
            if len(time_s) != len(pressure_mbar) or (np.diff(pressure_mbar) != 1).any():
                wrong.append(pressure_mbar)

    thread = threading.Thread(target=read)
    thread.start()
    for number in range(20000):
        growing.append(sample(number))
    over.set()
    thread.join()
    assert not wrong


def test_a_curve_of_what_there_is():
    growing = GrowingCurve(SETUP)
    for number in range(30):
        growing.append(sample(number))
    curve = growing.curve("curve 1", partial=True)
    growing.append(sample(30))
    assert len(curve) == 30
    assert curve.partial
    assert curve.setup is SETUP
    growing.append(Sample(31, 9.0, float("nan"), 0.0, 0))
    with pytest.raises(InputError, match="not finite"):
        growing.curve("curve 1")
