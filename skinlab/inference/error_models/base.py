"""What an error model is: a part of the covariance of the errors, with parameters of its own.

A model looks at the samples and at what a first fit leaves, and gives a `Part` where it has
something to say. The parts of several models add up to one covariance. Parameters are positive and
searched in their logarithms; their priors are lognormal and weak, of the sizes that
docs/intervals.md lists.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.covariance import Covariance, OrnsteinUhlenbeck
from skinlab.inference.samples import Samples
from skinlab.inference.settings import KINDS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Hyperparameter:
    """One positive number of an error model, whose name carries its unit: white_um.

    Before the data its logarithm is Gaussian about that of `median`; with `log_sd_above` of another
    width above it, where sizes are bounded by what is published. With `outlying`, a share of the
    prior, it is that of `outlying_sd` instead: a statement that may be wrong. `start` is where to
    look first, if the data say; else the median. Beyond `reach`, in the logarithm from the median,
    it is all but impossible. `absent` is the share of the prior with which there is hardly any of
    it: a fiftieth of the median, about. `scale` is over how much of a logarithm the data's density
    changes, as far as known beforehand: a frequency is fixed far better than a size.
    """

    name: str
    median: float
    log_sd: float
    outlying: float = 0.0
    outlying_sd: float = 1.5
    start: float | None = None
    reach: float = math.inf
    log_sd_above: float | None = None
    absent: float = 0.0
    scale: float = 1.0

    def log_prior(self, log_value: Array) -> Array:
        """Return the log density of logarithms, of any shape."""
        off = log_value - math.log(self.median)
        found = _log_normal(off, self.log_sd)
        if self.log_sd_above is not None:  # two halves that meet
            whole = 0.5 * (self.log_sd + self.log_sd_above)
            halves = (
                math.log(sd / whole) + _log_normal(off, sd)
                for sd in (self.log_sd, self.log_sd_above)
            )
            found = np.where(off < 0, *halves)
        if math.isfinite(self.reach):
            beyond = np.maximum(np.abs(off) - self.reach, 0.0)
            found = found - 0.5 * (beyond / KINDS.edge) ** 2
        if self.outlying:
            found = _mixed(found, self.outlying, _log_normal(off, self.outlying_sd))
        if self.absent:
            hardly = _log_normal(off + math.log(KINDS.hardly), KINDS.hardly_sd)
            found = _mixed(found, self.absent, hardly)
        return np.asarray(found)


def _mixed(log_density: Array, share: float, other: Array) -> Array:
    """Return the log density of a mixture, `share` of it the other."""
    return np.asarray(np.logaddexp(math.log1p(-share) + log_density, math.log(share) + other))


def _log_normal(off: Array, sd: float) -> Array:
    return np.asarray(-0.5 * (off / sd) ** 2 - math.log(sd * math.sqrt(2.0 * math.pi)))


@dataclass(frozen=True, eq=False)
class Terms:
    """What a part adds to the covariance of the samples (u,)."""

    variance_mm2: Array | float = 0.0  # (u,) independent
    ou: OrnsteinUhlenbeck | None = None
    columns_mm: Array | None = None  # (u, m), each as large as its standard deviation,
    sizes: Array | None = None  # (m,), or by these factors larger, where only they change
    stretch: Array | None = None  # (u,) by which the independent parts' variance is multiplied

    @property
    def deviations_mm(self) -> Array | None:
        """The columns (u, m), each as large as its standard deviation."""
        if self.columns_mm is None or self.sizes is None:
            return self.columns_mm
        return self.columns_mm * self.sizes


@dataclass(frozen=True, eq=False)
class Part:
    """An error model for these samples: `terms` of the values of its parameters, in order.

    `variances`, if given, is quicker: the same of values (..., d) at once, variances (..., u), of a
    model that has nothing else. So is `size_um`, the root mean square of the errors over samples.
    """

    name: str
    parameters: tuple[Hyperparameter, ...]
    terms: Callable[[Sequence[float]], Terms]
    log_odds: float = 0.0  # before the data, of its being there; 0 of one that always is
    always: bool = False
    stated: dict[str, float] = field(default_factory=dict)  # values that were found, not fitted
    lasting: bool = False  # correlated in time: a size above 8 µm is a misfit
    why: str = ""  # the name of a parameter in braces stands for the value that is reported
    bound: Array | float = 0.0  # (u,) what `stretch` adds to the log evidence (scale mixtures)
    spread: float = 1.0  # by which `stretch` is to be multiplied for the information to be right
    tails: float = 1.0  # variance of a scale mixture, by that of its scale
    again: Callable[[Array], Part] | None = None  # a scale mixture, given other `white_square`
    variances: Callable[[Array], Array] | None = None
    size_um: Callable[[Sequence[float]], float] | None = None

    @property
    def is_process(self) -> bool:
        """Whether it is a process in time: a combination can have one of these at most."""
        return self.terms([p.median for p in self.parameters]).ou is not None


@dataclass(frozen=True, eq=False)
class Look:
    """What an error model is shown: the samples, and the best that is known of their errors."""

    samples: Samples
    deflection_mm: Array  # (u,) of the fitted model
    slope_mm_per_mbar: Array  # (u,) dw/dp there
    residual_mm: Array  # (u,) measured − model
    slopes: Array  # (u, k) of the model by unknowns, which absorb a part of any error
    noise_um: float | None  # as stated
    pressure_sd_mbar: Array  # (u,) of the readings
    pressure_error_mm: Array  # (u,) root mean square of what these do to the deflections
    placement_scatter: float | None = 0.0
    """Standard deviation of log stiffness between placements; None: to be learned, 0: none."""
    softer_mm: Array | None = None
    """(u,) deflection per logarithm of a softer place; None: p dw/dp."""
    thickness_error_mm: Array | None = None
    """(u,) deflection that one standard deviation of a placement's own thickness makes."""
    covariance: Covariance | None = None
    """That of the best errors so far, for kinds that are looked for below the others; None at
    first."""
    white_square: Array | None = None
    """(u,) expected squares of the white parts of the errors, in their own variances, by the best
    combination so far: what models of heavy tails look at."""


class ErrorModel(Protocol):
    """One kind of error; a module of this folder declares one as ERROR_MODEL."""

    @property
    def name(self) -> str:
        """Name, as in the names of combinations: white+ou."""
        ...

    @property
    def meaning(self) -> str:
        """What these errors are, in a few words, for docs."""
        ...

    @property
    def prior(self) -> str:
        """What is taken for likely before the data, in a few words, for docs."""
        ...

    def part(self, look: Look) -> Part | None:
        """Return its part for these samples, None where it has nothing to say."""
        ...
