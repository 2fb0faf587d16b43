"""The numbers by which gates decide, each with its unit and why; all in one place.

`pytest tests/unit/quality/test_gates.py` moves with all of them: how early a gate says what is
wrong, and no false alarm in 200 clean curves.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PressureRules:
    """How a pressure may differ from what was asked for."""

    off_mbar: float = 3.0
    """15 standard deviations of a pressure sensor (0.2 mbar), or"""
    off_part: float = 0.03
    """such a share of it; tighter than what makes the driver vent (10 mbar or 5 %)."""
    shortest_s: float = 0.3
    """A shorter deviation is a hiccup,"""
    fewest: int = 3
    """and fewer samples are noise."""
    least_asked_mbar: float = 10.0
    """Below, a leak cannot be told from the pump's start."""
    some_suction: float = 0.2
    """Of what is asked: with less the probe is in the air, with more it leaks."""
    slower: float = 0.95
    """Of the rise that is asked for: a pump that is only late rises as steeply."""
    lag_s: float = 0.25
    """A pump may be this late. The simulated one takes 20 ms; the driver allows 500 ms down."""
    lag_of_steps_s: float = 0.5
    """For what is asked for "at once"."""
    step_mbar_per_s: float = 200.0
    """Faster ramps are steps: 100 mbar within the lag of one."""
    vent_s: float = 1.0
    """A pressure that falls through a valve may take so long (limits of the driver)."""
    slope: float = 0.1
    """Share of the rate that is asked for: the loading rate matters to a skin that creeps;"""
    slope_sigmas: float = 4.0
    """and of the slope's own error, so that noise over a short ramp is no finding."""
    slope_rise_mbar: float = 10.0
    """A ramp's, at least, with"""
    slope_fewest: int = 6
    """samples."""


@dataclass(frozen=True)
class SkinRules:
    """What even the stiffest skin does."""

    stiffest_X1_MPa: float = 0.3
    """Three times the stiffest skin of the paper's database: what it moves, any skin does."""
    small: float = 0.1
    """w/R; higher domes rise more slowly."""
    telling_mm: float = 0.02
    """What the stiffest skin has to move before it can be missed: 7 times a noise of 3 µm."""
    still: float = 0.25
    """Of what the stiffest skin moves: less is no contact,"""
    few: int = 5
    """by the median of so many samples."""


@dataclass(frozen=True)
class StandstillRules:
    """When a reading that does not move is a finding."""

    longest_s: float = 0.5
    """The driver vents after this long (docs/safety.md),"""
    slack: float = 0.9
    """so that what is left of such a curve may hold a little less of it."""
    steps: float = 3.0
    """Resolutions by which even the stiffest skin would have moved,"""
    resolution_mm: float = 1e-3
    """those of a sensor; coarser where its readings show it."""
    fewest: int = 5
    """Samples, and parts of a run."""
    least_mbar: float = 2.0
    """Ten times a pressure sensor's noise, as the driver has it."""


@dataclass(frozen=True)
class RepeatRules:
    """When a repeat differs.

    Stiffness goes about as the inverse of the deflection: a tenth of that is more than the scatter
    of one operator's repeats is hoped to be, and less than the interval of one curve.
    """

    part: float = 0.1
    """Of the deflection,"""
    sigmas: float = 4.0
    """and of the two curves' noise."""
    fewest: int = 10
    """Samples that are compared,"""
    least_part: float = 0.2
    """of the program's highest pressure on: below, a dome is mostly noise and contact."""


@dataclass(frozen=True)
class TimeRules:
    """When samples are missing."""

    longest_gap: float = 2.5
    """Intervals: one lost frame makes 2, and is told by its own gate; a clock that counts in ms
    rounds an interval at 1 kHz by up to itself."""
    fewest: int = 20
    """Samples of a first loading. The paper's curves have 51; with noise that is independent from
    sample to sample, 20 of them leave intervals that are 1.6 times as wide."""
    tail_s: float = 3.0
    """Of a growing curve, that gates look at: long enough for every one that looks at what is
    new."""


ASKED = PressureRules()
SKIN = SkinRules()
STILL = StandstillRules()
REPEATS = RepeatRules()
TIMES = TimeRules()
