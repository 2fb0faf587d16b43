"""Other ways to the same end, on the same campaigns: what anybody would try first.

`stepwise`: effects are added one at a time while Akaike's (AIC) or the Bayesian (BIC) criterion
falls, two at most; noise is white, placements do not differ. `gaussian_process`: a discrepancy term
(Kennedy and O'Hagan 2001), which tells that something is missing and not what: a smooth function of
the suction, loading and unloading of each opening apart, whose size and length are integrated out.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.campaign import Campaign
from skinlab.discrepancy.fit import Fit, Fitter
from skinlab.discrepancy.misfit import errors_of
from skinlab.discrepancy.records import by_geometry, coarsened, records_of
from skinlab.discrepancy.screen import signature
from skinlab.discrepancy.search import Search
from skinlab.discrepancy.search_workers import fit_one
from skinlab.discrepancy.settings import ERRORS
from skinlab.discrepancy.table_domes import TableDomes
from skinlab.mechanics.effects import get_effect, library_names
from skinlab.tables.base import Database

Array = NDArray[np.float64]

_TRIED = 3  # effects that are fitted at each step: those of which a score test expects most
_MOST = 2
_DECIDED = math.log(20.0)
_SAMPLES = 400  # that the Gaussian process sees
_SIZES_MM = (1e-3, 3e-3, 1e-2, 3e-2)
_LENGTHS = (0.1, 0.3, 1.0)  # of the highest suction


@dataclass(frozen=True)
class Said:
    """What peers say of a campaign: effects that they name, and whether something is missing."""

    aic: tuple[str, ...]
    bic: tuple[str, ...]
    gaussian_process: bool
    cpu_seconds: dict[str, float]

    def line(self) -> dict[str, Any]:
        """Return it for a results file."""
        return {
            "aic": list(self.aic), "bic": list(self.bic), "gp": self.gaussian_process,
            "cpu_seconds": self.cpu_seconds,
        }  # fmt: skip


def ask(campaign: Campaign, database: Database) -> Said:
    """Return what they say."""
    records = [coarsened(r, ERRORS.coarse_hz) for r in records_of(campaign)]
    fitter = Fitter(records, errors_of(records), TableDomes(database))
    begin = time.process_time()
    base = Search(fitter).base()
    path = _stepwise(fitter, base)
    middle = time.process_time()
    found = _gaussian_process(fitter, base)
    seconds = {"stepwise": middle - begin, "gp": time.process_time() - middle}
    n = fitter.errors.count
    return Said(_least(path, 2.0), _least(path, math.log(n)), found, seconds)


def _stepwise(fitter: Fitter, base: Fit) -> list[Fit]:
    path = [base]
    for _ in range(_MOST):
        fit = path[-1]
        names = [n for n in library_names() if n not in fit.effects and not get_effect(n).same_as]
        seen = [s for n in names if (s := signature(fitter, fit, n)) is not None]
        best = sorted(seen, key=lambda s: -s.gain)[:_TRIED]
        fits = [f for s in best if (f := fit_one(fitter, (fit, s, math.inf))) is not None]
        if not fits:
            break
        path.append(min(fits, key=lambda f: f.chi2))
    return path


def _least(path: list[Fit], price: float) -> tuple[str, ...]:
    """Return the effects where a criterion, χ² and a price for each unknown, stops falling."""
    chosen = path[0]
    for fit in path[1:]:
        if fit.chi2 + price * len(fit.u) >= chosen.chi2 + price * len(chosen.u):
            break
        chosen = fit
    return tuple(sorted(chosen.effects))


def _gaussian_process(fitter: Fitter, base: Fit) -> bool:
    """Return whether a discrepancy term is 20 times as probable as none."""
    records, errors = fitter.records, fitter.errors
    counts = [len(r.curve) for r in records]
    group = np.zeros(sum(counts), dtype=int)
    place, at = np.empty(len(group)), np.cumsum([0, *counts])
    for number, members in enumerate(by_geometry(records)):
        top = max(float(records[i].pressure_mbar.max()) for i in members)
        for i in members:
            here = slice(at[i], at[i + 1])
            place[here] = records[i].pressure_mbar / top
            group[here] = 2 * number + (records[i].curve.phase != "load")
    kept = np.linspace(0, len(group) - 1, min(_SAMPLES, len(group))).astype(int)
    residual = (fitter.measured - np.concatenate(base.deflections_mm))[kept]
    slopes = errors.colour(base.jacobian)[kept]
    noise = np.diag(errors.variance_mm2[kept]) + errors.columns_mm[kept] @ errors.columns_mm[kept].T
    wide = slopes @ np.linalg.pinv(base.information) @ slopes.T * 1e4  # all but free
    same = group[kept, None] == group[kept]
    apart = place[kept, None] - place[kept]

    def log_evidence(covariance: Array) -> float:
        root = np.linalg.cholesky(covariance)
        z = np.linalg.solve(root, residual)
        return float(-0.5 * z @ z - np.log(np.diag(root)).sum())

    least = log_evidence(noise + wide)
    each = [
        log_evidence(noise + wide + size**2 * same * np.exp(-0.5 * (apart / length) ** 2))
        for size in _SIZES_MM
        for length in _LENGTHS
    ]
    return float(np.logaddexp.reduce(each)) - math.log(len(each)) - least >= _DECIDED
