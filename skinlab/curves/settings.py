"""The numbers by which curves are read, each with its unit and where it is from; all in one place.

Limits of the grammar of programs stand in `program`: they say what is refused, and nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta


@dataclass(frozen=True)
class SampleRules:
    """Whether there is a curve at all, and how long a simulated one may be."""

    fewest: int = 5
    """Samples: of fewer nothing is fitted."""
    slow_s: float = 4.0
    """Between two samples: probes read 10 to 200 times a second, which in ms is 5 to 100."""
    most_simulated: int = 300_000
    """Samples: they take 900 MB. A hundred cycles of a minute on and one off at 20 Hz are fewer."""


@dataclass(frozen=True)
class SuctionRules:
    """What no curve of suction says; `pytest tests/unit/curves/test_suction.py`."""

    about_zero_mbar: float = 2.0
    """Readings this close to zero say nothing: the model is evaluated there, too."""
    fewest_below: int = 5
    """Readings below that; fewer may be glitches."""
    nearly_all: float = 0.9
    """Of those that are not about zero."""
    beyond: float = 1.2
    """Times the highest pressure of any program: no reading that is a little off."""
    high: float = 0.9
    """So many of the deflections have to be below the opening's diameter; others are glitches."""
    little: float = 0.25
    """Of the highest suction: below, and above its complement, a dome is low, and high."""
    inward_mm: float = 0.05
    """By so much a dome that is read goes inwards: what drifts (1 µm/s) goes less far."""


@dataclass(frozen=True)
class AsStatedRules:
    """When a pressure is not its program's; `pytest tests/unit/curves/test_program_check.py`."""

    off: float = 0.25
    """Of the highest suction that the curve could show: rms over the samples with suction."""
    least_seen: float = 0.5
    """Of the program's highest suction: of a curve that is cut short earlier, so much counts."""
    lags_s: tuple[float, ...] = (0.0, 0.1, 0.2, 0.4, 0.7, 1.0, 1.4, 2.0)
    """How late a rig may be, to the first order: a tube and a regulator take 0.1 to 0.3 s."""
    late_s: tuple[float, ...] = (0.0, 0.25, -0.25, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0)
    """By how much it may begin late or early."""
    suction: float = 0.1
    """Of the highest: where neither program nor reading is above it, there is no suction."""
    glitches: float = 0.05
    """So many of the samples, those that are furthest off, do not count."""
    other_top: float = 0.15
    """Of the highest: so far off, the sentence names the highest reading."""
    most_samples: int = 400
    """Of a longer curve evenly some: 144 courses take some milliseconds."""


@dataclass(frozen=True)
class StepRules:
    """How the step of a Cutometer's mode 1 is found in a curve.

    `pytest tests/unit/curves/test_cutometer.py` moves with all of them.
    """

    leaves: float = 0.02
    """Of the step, or"""
    leaves_deviations: float = 4.0
    """standard deviations of the pressure's noise: no longer at rest."""
    slowest_s: float = 0.5
    """From rest to the step; slower is no step."""
    uneven: float = 0.10
    """Of the step: while it is held the pressure stays this close."""
    bend_within_s: float = 0.5
    """Of the start: where the bend is looked for,"""
    fewest_aside: int = 2
    """with so many samples on either side of it."""
    rate_for_bend_hz: float = 20.0
    """Below, a bend between 0.1 and 0.2 s cannot be told."""


@dataclass(frozen=True)
class HeightRules:
    """What becomes of a rise until a height; `pytest tests/unit/curves/test_heights.py`."""

    near: int = 8
    """Samples before its end, which the curve passes nearly straight."""
    at_most_mbar: float = 1.0
    """Below the most that was allowed: it ended there, and not at the height."""


@dataclass(frozen=True)
class ProbeRules:
    """How long what a probe file says counts; `pytest tests/unit/inference/test_calibration.py`."""

    visit: timedelta = timedelta(hours=12)
    """So long a check counts, as the dose of a visit does."""
    soon: timedelta = timedelta(days=14)
    """Before its calibration ends, that is said."""
    smooth: int = 5
    """Samples over which dp/dt is read: a lag moves readings by it."""


@dataclass(frozen=True)
class PressureGlitchRules:
    """What is no suction; `pytest tests/unit/curves/test_pressure_glitches.py` moves with them."""

    least_mbar: float = 15.0
    """Off its neighbours: less does little to a fit, and a regulator may overshoot by it,"""
    of_top: float = 0.1
    """or by this share of the highest suction,"""
    top: float = 0.95
    """which so many of the readings are below;"""
    deviations: float = 10.0
    """standard deviations of the channel's noise."""
    fewest: int = 5
    """Samples of a curve in which that can be told."""


SAMPLES = SampleRules()
SUCTION = SuctionRules()
AS_STATED = AsStatedRules()
STEP = StepRules()
HEIGHTS = HeightRules()
PROBE = ProbeRules()
GLITCHES = PressureGlitchRules()
