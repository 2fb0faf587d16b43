"""The model as it is where its fit ends at the end of a range: no Gaussian about there tells it.

Towards ν = 0.5 curves depend on 1 / (1 − 2 ν): a Gaussian at 0.499 is a hundredth wide, where the
data may allow all of 0 to 0.499 with the other parameters fitted again. So its evidence was too low
by a decade, and an effect was named that there is not. Here it is integrated along the parameter.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.fit import Fit, Fitter

Array = NDArray[np.float64]

# Of the range, from the end at which the fit is: as narrow as a posterior is seen, then wider.
_FROM_THE_END = np.array([0.0, 0.002, 0.006, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0])
_NEAR_SD = 2.0  # standard deviations from an end
_HELD = 1e-6  # of the range: between what a parameter is held


def at_an_end(fit: Fit) -> int | None:
    """Return which of the law's parameters is at an end of its even prior; None: none is."""
    unknowns, deviations = fit.unknowns, fit.deviations
    low, high = unknowns.bounds
    told = {prior.index for prior in unknowns.base_priors}
    for i in range(len(unknowns.space.names)):
        off = min(fit.u[i] - low[i], high[i] - fit.u[i])
        if i not in told and off < _NEAR_SD * deviations[i]:
            return i
    return None


def held_along(fitter: Fitter, fit: Fit, index: int) -> Iterator[tuple[float, Fit]]:
    """Yield values of an unknown, from its end on, and the fit with it held there."""
    model = fitter.model(fit.unknowns)
    if not fitter.prepare(model, fit.u, slopes=True):
        return
    low, high = fit.unknowns.bounds
    width = high[index] - low[index]
    from_low = fit.u[index] - low[index] < 0.5 * width
    u = fit.u
    for share in _FROM_THE_END:
        at = low[index] + width * (share if from_low else 1.0 - share)
        first, last = low.copy(), high.copy()
        first[index] = max(low[index], at - _HELD * width)
        last[index] = min(high[index], at + _HELD * width)
        u = fitter.minimise(model, np.clip(u, first, last), first, last)
        if (found := fitter.at(model, u)) is None:
            return
        yield float(at), found


def log_integral(at: Array, log_density: Array) -> float:
    """Return the log of an integral over points (n,) in order, whose log is straight between."""
    a, b = log_density[:-1], log_density[1:]
    apart = np.maximum(np.abs(b - a), 1e-9)
    each = np.maximum(a, b) + np.log(-np.expm1(-apart) / apart) + np.log(np.abs(np.diff(at)))
    return float(np.logaddexp.reduce(each))
