"""The numbers that decide in a study, each with its unit and where it is from; all in one place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

NORMAL_90 = 1.6448536269514722  # half a 90 % interval of a normal distribution, in its deviations


@dataclass(frozen=True)
class ComponentRules:
    """Components of variance, reliability and agreement.

    `python benchmarks/study.py components` and `simulated` have how many intervals hold.
    """

    level: float = 0.9
    """Of the intervals of components, as of those of curves."""
    published_level: float = 0.95
    """Of ICC and of limits of agreement, as publications have it."""
    draws: int = 20_000
    """For generalised confidence intervals."""
    seen: float = 0.01
    """Of the draws of a component are above zero, at least: no interval is "0 to 0"."""
    most_ratio: float = 1e3
    """Of an effect's standard deviation to that within."""
    largest_block: int = 4000
    """Rows of one block; a dense matrix of it still fits."""
    fewest: int = 6
    """Curves of one condition."""
    most_pairs: int = 45
    """Of operators, probes, visits or placements that are held against each other: ten of them."""
    most_repeats: int = 1000
    """That are told as what a reliability would need."""
    repeats: tuple[int, ...] = (1, 2, 3, 5, 10)
    """For which a reliability is told."""


@dataclass(frozen=True)
class PriorRules:
    """How a population is learned, as a prior for the next curve.

    `shared` was found on cohorts of seeds 1000 to 1005 (docs/decisions/0025-studies.md); `python
    benchmarks/study.py prior` has what intervals hold on others, and moves with all of them.
    """

    fewest_people: int = 8
    """Of fewer no covariance of three parameters is learned."""
    most_curves: int = 4_000
    """More of them say hardly more; memory stays flat."""
    draws: int = 256
    """Of each curve's posterior, equally weighted;"""
    thinned: int = 4
    """every so manieth of them tells how much fits to other people scatter,"""
    bootstraps: int = 24
    """of which there are so many."""
    iterations: int = 200
    """At most, until"""
    still: float = 1e-3
    """of a deviation the estimate stays."""
    shared: float = 0.35
    """Of a single curve's own error (a deviation), that all curves have in common: mesh, law,
    calibration. Without it intervals held X2 in 78 of 100."""
    people_before: float = 2.0
    """What the first guess of the covariance counts for, in people:"""
    first_sd: Mapping[str, float] = field(default_factory=lambda: {"log": 0.3, "linear": 0.04})
    """of logarithms, and of what has no unit."""
    least_sd: Mapping[str, float] = field(default_factory=lambda: {"log": 0.05, "linear": 0.01})
    """The same, at least."""


@dataclass(frozen=True)
class ChangeRules:
    """When a patient has changed: `skinlab compare`, no benchmark."""

    level: float = 0.95
    """As publications have it."""
    relevant_percent: float = 30.0
    """A change that matters, unless it is stated;"""
    relevant_linear: float = 0.1
    """that of a parameter without a unit, such as ν."""
    prior_sd: float = 0.08
    """Of placing the probe anew, logarithms: published are 6.4 % to 12.4 % (Diridollou 2000);"""
    prior_sd_linear: float = 0.03
    """of what has no unit;"""
    prior_freedom: float = 6.0
    """worth so many degrees of freedom beside the sessions' own repeats."""
    least_freedom: float = 4.0
    """Of a study's scatter, where it tells of fewer."""


@dataclass(frozen=True)
class ReferenceRules:
    """Reference ranges of a study."""

    percentiles: tuple[int, ...] = (5, 25, 50, 75, 95)
    """Of people, each by the mean of their curves."""
    fewest_people: int = 20
    """A 5th percentile of fewer is the least of them."""
    age_bands: tuple[tuple[float, float], ...] = (
        (0.0, 20.0), (20.0, 40.0), (40.0, 60.0), (60.0, 80.0), (80.0, 120.0),
    )  # fmt: skip
    """Years: from, to (not included)."""


@dataclass(frozen=True)
class PoolRules:
    """Which missing effects hold over a study (docs/study.md)."""

    false_discoveries: float = 0.05
    """Share of what is said to be there (Benjamini and Hochberg)."""
    fewest: int = 3
    """Campaigns that share an effect."""
    most_taken: int = 3
    """Effects that a group may share."""
    curvature: float = 0.1
    """Of what the first explains: its own curvature, which looks like others."""
    invisible: float = 1e-3
    """Of a signature's square: less is not told from those taken already."""


COMPONENTS = ComponentRules()
PRIORS = PriorRules()
CHANGES = ChangeRules()
REFERENCES = ReferenceRules()
POOLS = PoolRules()
