"""Samples left out at the same moments of all repeats are told apart from glitches."""

from types import SimpleNamespace

import numpy as np

from skinlab.curves.campaign import Campaign
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.discrepancy.records import coarsened, records_of, without
from skinlab.discrepancy.shared_glitches import SharedGlitches, shared_glitches
from skinlab.discrepancy.text import left_out_words

PROGRAM = parse_program("ramp:100@20,hold:3,ramp:0@20")
CORNERS_S = [5.0, 8.0]


def repeats(rate_hz, click_mm, spikes, seed, count=3):
    """Return records with clicks at the corners and spikes anywhere, and what to keep."""
    rng = np.random.default_rng(seed)
    curves, times = [], []
    for i in range(count):
        t = np.arange(int(PROGRAM.duration_s * rate_hz) + 1) / rate_hz
        p = PressurePath.of_program(PROGRAM)(t)
        off = np.zeros(len(t))
        off[rng.integers(0, len(t), spikes)] = 0.1
        off[[round(rate_hz * s) + int(rng.integers(0, 2)) for s in CORNERS_S]] += click_mm
        w = 0.05 * p**0.5 + off + rng.normal(0, 1e-3, len(t))
        curves.append(Curve(f"c{i}", Setup(6.0, 1.1, PROGRAM, 1, i + 1), t, p, w))
        times.append(off == 0)
    return records_of(Campaign("made", None, 0.0, tuple(curves))), times


def test_clicks_that_all_repeats_have_are_told_apart_from_their_spikes():
    records, kept = repeats(50, 0.05, spikes=8, seed=1)
    (found,) = shared_glitches(without(records, kept))
    assert found.files == ("c0", "c1", "c2")
    assert np.allclose(found.time_s, CORNERS_S, atol=0.03)


def test_so_are_those_that_are_left_out_of_means():
    """At 200 Hz glitches go before samples are averaged."""
    records, _ = repeats(200, 0.08, spikes=12, seed=2)
    coarse = [coarsened(r, 20.0) for r in records]
    assert all(r.coarse > 1 and r.glitches == len(r.left_out_s) > 10 for r in coarse)
    (found,) = shared_glitches(coarse)
    assert np.allclose(found.time_s, CORNERS_S, atol=0.01)


def test_spikes_by_chance_and_lone_curves_share_no_moments():
    alarms = 0
    for seed in range(200):
        records, kept = repeats(50, 0.0, spikes=7, seed=seed)
        alarms += len(shared_glitches(without(records, kept)))
    assert alarms <= 2  # a thousandth is expected
    records, kept = repeats(50, 0.05, spikes=0, seed=1, count=1)
    assert shared_glitches(without(records, kept)) == []


def test_they_are_told_in_a_sentence():
    found = SimpleNamespace(left_out={"a.csv": 3, "b.csv": 2})
    moments = [SharedGlitches(("a.csv", "b.csv"), tuple(np.arange(8.0)))]
    first, second = left_out_words(SimpleNamespace(found=found, shared_glitches=moments))
    assert first.endswith("3 samples of a.csv, 2 samples of b.csv.")
    assert "both repeats of a.csv have some at the same moments (0, 1, 2, 3, 4, 5, … s)" in second
