"""The smooth course of a noisy pressure, and why the model is evaluated on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.inference.identify import Identifier
from skinlab.inference.pressure_course import smooth_course

FE_REFERENCE = Path(__file__).parents[2] / "data" / "fe_reference"
NOISE_MBAR = 0.3


def noisy(true, seed):
    return true + NOISE_MBAR * np.random.default_rng(seed).standard_normal(len(true))


@pytest.mark.parametrize("rate_hz", [100.0, 200.0])
def test_of_a_ramp_an_eighth_of_the_noise_is_left(rate_hz):
    time = np.arange(0.0, 5.0, 1.0 / rate_hz)
    true = 20.0 * time
    left = smooth_course(time, noisy(true, 1), NOISE_MBAR) - true
    assert np.sqrt(np.mean(left**2)) < NOISE_MBAR / 5.0


def test_steps_and_corners_stay():
    time = np.arange(0.0, 10.0, 0.01)
    true = np.where(time < 5.0, 0.0, 60.0) + np.clip(20.0 * (time - 7.0), 0.0, 40.0)
    left = smooth_course(time, noisy(true, 2), NOISE_MBAR) - true
    assert np.abs(left).max() < 4.0 * NOISE_MBAR
    assert np.sqrt(np.mean(left**2)) < NOISE_MBAR / 4.0


def test_uneven_and_lost_samples_are_on_the_same_line():
    rng = np.random.default_rng(3)
    time = np.sort(rng.choice(np.arange(0.0, 5.0, 0.005), 600, replace=False))
    left = smooth_course(time, noisy(20.0 * time, 3), NOISE_MBAR) - 20.0 * time
    assert np.sqrt(np.mean(left**2)) < NOISE_MBAR / 5.0


def test_what_has_no_noise_is_left_alone():
    time, pressure = np.arange(5.0), np.array([0.0, 1.0, 7.0, 2.0, 2.0])
    assert (smooth_course(time, pressure, 0.0) == pressure).all()
    assert (smooth_course(time[:2], pressure[:2], 0.3) == pressure[:2]).all()


SKINS = {  # of another program: X1, X2 in MPa, ν
    "fe_X1-0.0574_X2-1.542_nu-0.3248_paper_h1.00_R3.00.csv": (0.0574, 1.542, 0.3248),
    "fe_X1-0.0745_X2-1.038_nu-0.3178_paper_h1.00_R3.00.csv": (0.0745, 1.038, 0.3178),
    "fe_X1-0.0524_X2-3.485_nu-0.3202_paper_h1.00_R3.00.csv": (0.0524, 3.485, 0.3202),
    "fe_X1-0.0930_X2-2.696_nu-0.4002_paper_h1.00_R3.00.csv": (0.0930, 2.696, 0.4002),
    "fe_X1-0.0206_X2-4.483_nu-0.2357_paper_h1.00_R3.00.csv": (0.0206, 4.483, 0.2357),
    "fe_X1-0.0220_X2-2.065_nu-0.3342_paper_h1.00_R3.00.csv": (0.0220, 2.065, 0.3342),
}


def in_life(name, seed):
    """At 200 Hz: white 2 µm, 2 µm that last for 0.3 s, breathing 3 µm, a pulse of 2 µm."""
    rng = np.random.default_rng(seed)
    time = np.arange(1001) / 200.0
    true = 20.0 * time
    pressure, deflection = np.loadtxt(FE_REFERENCE / name, delimiter=",", skiprows=1).T
    decay = np.exp(-1.0 / (200.0 * 0.3))
    steps = np.sqrt(1.0 - decay**2) * rng.standard_normal(1001)
    errors = 2.0 * rng.standard_normal(1001) + 2.0 * lfilter([1.0], [1.0, -decay], steps)
    for size, hz in ((3.0, rng.uniform(0.2, 0.4)), (2.0, rng.uniform(1.0, 1.5))):
        errors += size * np.sin(2.0 * np.pi * (hz * time + rng.random()))
    w = CubicSpline(pressure, deflection)(true) + 1e-3 * errors
    setup = Setup(6.0, 1.0, parse_program("ramp:100@20"))
    return Curve(name, setup, time, noisy(true, [seed, 1]), w)


@pytest.mark.parametrize(
    ("skins", "again"), [(2, [0]), pytest.param(len(SKINS), [0, 100, 200], marks=pytest.mark.long)]
)
def test_a_skin_is_no_stiffer_because_its_pressure_is_noisy(table, skins, again):
    """Without smoothing, errors that last were found far too large, and taken for a misfit."""
    held, sizes = [], []
    drawn = [
        (s + more, *skin) for s, skin in enumerate(list(SKINS.items())[:skins]) for more in again
    ]
    for seed, name, truth in drawn:
        result = Identifier(table)(in_life(name, seed))
        values = zip(result.parameters.values(), truth, strict=True)
        held.append([v.low <= t <= v.high for v, t in values])
        sizes.append(result.error_model.parameters.get("ou_um", 0.0))
        assert "misfit_above_noise" not in result.flags
    assert max(sizes) < 8.0
    assert np.mean(held) >= 0.8
