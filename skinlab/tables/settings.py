"""The numbers by which tables are made and read, each with its unit and where it is from.

What is not said otherwise moves the rows of `python benchmarks/database.py`. The errors of models
(`model_errors`) and of the crease (`forward`) are no settings: they were measured.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ReadingRules:
    """Which readings belong to the program of a table with memory."""

    off_mbar: float = 2.0
    """A reading may be so far from the program, ten deviations of a sensor, or"""
    off_share: float = 0.02
    """by this share of its highest pressure;"""
    stray: int = 3
    """so many in a row beyond that have left the program."""


@dataclass(frozen=True)
class NodeRules:
    """How many nodes a table has where its spec does not say, and at most."""

    ramp: int = 6
    """At least, of a piece of the program,"""
    hold: int = 12
    """and of one in which the pressure is held."""
    effect: int = 5
    """Along an effect's parameter, of which the spec says nothing,"""
    reach: float = 4.0
    """and so many standard deviations of its normal prior to either side."""
    history_program: str = "ramp:100@20,ramp:0@20"
    """Of a model in which the way back differs, where the spec names no program."""
    most: int = 1000
    """Along an axis,"""
    most_chebyshev: int = 16
    """or of this spacing: a polynomial of higher degree loses digits,"""
    most_entries: int = 1_000_000
    """and curves in all."""


@dataclass(frozen=True)
class CurveRules:
    """How the dimensionless table is read for one curve: more is closer to it, and slower."""

    scale: int = 24
    """Nodes along the logarithm of the scale, between the table's bounds."""
    most_samples: int = 110
    """A curve of more is tabulated"""
    pressures: int = 72
    """at so many pressures."""
    thickness_step: float = 0.07
    """Between nodes along log h/R, 7 or more,"""
    thickness_reach: float = 3.5
    """over so many standard deviations of the thickness, or as far as the table goes."""


@dataclass(frozen=True)
class InterpolationRules:
    """What is said between the nodes."""

    continued: float = 1.15
    """Times as far as it holds, a curve goes on: between the nodes it may hold further."""
    followed: float = 1.5
    """Times the last pressure, the paper's grid: so the limit of what lies between is known."""
    dropped_mm: float = 2e-6
    """A component is dropped that is smaller, in the mean over curves;"""
    kept_mm: float = 1e-6
    """of the paper's grid, whose part in all curves together is."""
    checks: int = 12
    """Points at which a custom table is compared with finite elements,"""
    checks_any: int = 24
    """and one of every opening, which has more axes to be coarse along,"""
    knots: int = 17
    """knots of other shapes of that error,"""
    reach: float = 0.25
    """and how far such a shape is alike, of the whole."""


@dataclass(frozen=True)
class VerifyRules:
    """When an entry that is computed again is the same; other processors round differently."""

    mm: float = 1e-6
    """Of a deflection: the numbers mean no more than this."""
    log: float = 1e-6
    """Of its logarithm, which the dimensionless table keeps."""
    holds: float = 5e-3
    """Share of the pressure to which it holds, of the dimensionless table."""


READINGS = ReadingRules()
NODES = NodeRules()
CURVE = CurveRules()
INTERPOLATION = InterpolationRules()
VERIFY = VerifyRules()
