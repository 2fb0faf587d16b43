"""Explanations whose fit ends at the end of a range: no Gaussian about there tells their evidence.

Towards ν = 0.5 curves depend on 1 / (1 − 2 ν): a Gaussian at 0.499 is a hundredth wide, where the
data may allow all of 0 to 0.499 with the other parameters fitted again. So the evidence of the
model as it is was too low by a decade, and an effect was named that there is not. Here it is
integrated along the parameter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.campaign_errors import Linearised
from skinlab.discrepancy.fit import Fit, Fitter

Array = NDArray[np.float64]

# Of the range, from the end at which the fit is: as narrow as a posterior is seen, then wider;
_FROM_THE_END = np.array([0.0, 0.002, 0.006, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0])
_ABOUT = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])  # and standard deviations, of the fit
_NEAR_SD = 4.0  # standard deviations from an end
_HELD = 1e-6  # of the range: between what a parameter is held


@dataclass(frozen=True, eq=False)
class Along:
    """Fits with one of the unknowns held, at values (n,) in order."""

    index: int
    log_width: float  # of its even prior
    at: Array
    fits: list[Fit]

    def held(self, one: Linearised) -> Linearised:
        """Return an explanation about one of the fits, of the other unknowns alone."""
        return one.without(self.index, self.log_width)

    def log_mean(self, log_densities: Array) -> float:
        """Return the log of the mean over the prior of what has these logs (n,) at the values."""
        return log_integral(self.at, log_densities) - self.log_width


def at_an_end(fit: Fit) -> int | None:
    """Return which of the law's parameters is near an end of its even prior; None: none is."""
    unknowns, deviations = fit.unknowns, fit.deviations
    low, high = unknowns.bounds
    n = unknowns.count
    off = np.minimum(fit.u - low, high - fit.u)[:n] / deviations[:n]
    off[[prior.index for prior in unknowns.base_priors]] = np.inf
    return int(off.argmin()) if off.min() < _NEAR_SD else None


def along_range(fitter: Fitter, fit: Fit) -> Along | None:
    """Return a fit along the parameter at whose end it is; None where it is at none.

    From the fit on to either side, as far as there is a model: what was measured was no crease.
    """
    model = fitter.model(fit.unknowns)
    if (index := at_an_end(fit)) is None or not fitter.prepare(model, fit.u, slopes=True):
        return None
    low, high = fit.unknowns.bounds
    width, here = high[index] - low[index], fit.u[index]
    shares = _FROM_THE_END if here - low[index] < 0.5 * width else 1.0 - _FROM_THE_END
    about = here + _ABOUT * fit.deviations[index]
    values = np.unique(np.clip([*(low[index] + width * shares), *about], low[index], high[index]))
    fits: dict[float, Fit] = {}
    for side in (values[values <= here][::-1], values[values > here]):
        u = fit.u
        for value in side.tolist():
            first, last = low.copy(), high.copy()
            first[index] = max(low[index], value - _HELD * width)
            last[index] = min(high[index], value + _HELD * width)
            u = fitter.minimise(model, np.clip(u, first, last), first, last)
            if (found := fitter.at(model, u)) is None:
                break
            fits[value] = found
    at = sorted(fits)
    return Along(index, float(np.log(width)), np.array(at), [fits[value] for value in at])


def log_integral(at: Array, log_density: Array) -> float:
    """Return the log of an integral over points (n,) in order, whose log is straight between."""
    a, b = log_density[:-1], log_density[1:]
    apart = np.maximum(np.abs(b - a), 1e-9)
    each = np.maximum(a, b) + np.log(-np.expm1(-apart) / apart) + np.log(np.abs(np.diff(at)))
    return float(np.logaddexp.reduce(each))
