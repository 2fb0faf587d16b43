"""How sure an explanation's parameters are: draws from its posterior, not a Gaussian at its best.

Population Monte Carlo (Cappé et al. 2004, J. Comput. Graph. Stat. 13:907): candidates are drawn
from a Student distribution as wide as the curvature at the optimum, weighted by their posterior,
and drawn again around the heavy ones, each with its own curvature, until enough of them count. All
rounds count as draws from one mixture (Owen and Zhou 2000, J. Am. Stat. Assoc. 95:135). The model
stays anchored at the fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

from skinlab.discrepancy.fit import Fit, Fitter
from skinlab.discrepancy.mapped_model import MappedModel
from skinlab.discrepancy.unknowns import BASE_NAMES, Unknowns
from skinlab.identify.intervals import correlation, interval

Array = NDArray[np.float64]

_DRAWS = 400  # a round
_GAUSSIAN_DRAWS = 2000
_CENTRES = 20  # of the later rounds
_ENOUGH = 400.0  # effective draws: 5 % to within 1 %
_MOST_ROUNDS = 5
_FREEDOM = 5.0  # of the Student distributions
_WIDER = 1.2


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weighted draws of an explanation's unknowns; `weight` (n,) sums up to 1."""

    unknowns: Unknowns
    best: Array  # (k,) the optimum
    u: Array  # (n, k)
    weight: Array

    @property
    def effective(self) -> float:
        """Number of independent draws that these are worth (Kish)."""
        return float(1.0 / np.square(self.weight).sum())

    @property
    def parameters(self) -> dict[str, dict[str, float]]:
        """Values at the optimum with the shortest 90 % intervals, by name."""
        best = self.unknowns.named(self.best)
        drawn = self._named()
        low, high = (self.unknowns.named(u) for u in self.unknowns.bounds)
        found = {}
        for name, value in best.items():
            bounds = (low[name], high[name])
            ends = interval(
                drawn[name], self.weight, value, bounds, logarithmic=name in BASE_NAMES[:2]
            )
            found[name] = {"value": value, "low": ends[0], "high": ends[1]}
        return found

    @property
    def deviations(self) -> Array:
        """Standard deviations (k,) of the unknowns."""
        off = self.u - self.weight @ self.u
        return np.asarray(np.sqrt(self.weight @ np.square(off)))

    @property
    def correlation(self) -> tuple[tuple[float, ...], ...]:
        """Correlation matrix of the parameters, in the order of `parameters`."""
        return correlation(np.column_stack(list(self._named().values())), self.weight)

    def _named(self) -> dict[str, Array]:
        rows = [self.unknowns.named(u) for u in self.u]
        return {name: np.array([row[name] for row in rows]) for name in self.unknowns.names}


def sample(fitter: Fitter, fit: Fit, rng: np.random.Generator) -> Posterior:
    """Return draws from the posterior about a fit."""
    unknowns = fit.unknowns
    model = fitter.model(unknowns)
    if not fitter.prepare(model, fit.u, slopes=True):
        model = fitter.model(unknowns)
    mixtures = [_Mixture(fit.u[None], _WIDER * _root(fit.information)[None])]
    low, high = unknowns.bounds
    found: Posterior | None = None
    us, costs = [fit.u[None]], [np.array([fit.cost])]
    for _ in range(_MOST_ROUNDS):
        drawn = mixtures[-1].draw(_DRAWS, rng)
        drawn = drawn[((drawn >= low) & (drawn <= high)).all(axis=1)]
        us.append(drawn)
        costs.append(np.array([fitter.cost(model, u) for u in drawn]))
        u, cost = np.concatenate(us), np.concatenate(costs)
        log_drawn = logsumexp(np.array([m.log_density(u) for m in mixtures]), axis=0)
        log_weight = -0.5 * cost - log_drawn
        weight = np.exp(log_weight - log_weight.max())
        found = Posterior(unknowns, fit.u, u, weight / weight.sum())
        if found.effective >= _ENOUGH:
            break
        mixtures.append(_around(fitter, model, found, rng))
    assert found is not None
    return found


def gaussian(fit: Fit) -> Posterior:
    """Return draws from the Gaussian at a fit's optimum, cut off at the bounds: quick and rough."""
    low, high = fit.unknowns.bounds
    drawn = np.random.default_rng(0).standard_normal((_GAUSSIAN_DRAWS, len(fit.u)))
    u = fit.u + drawn @ _root(fit.information).T
    inside = u[((u >= low) & (u <= high)).all(axis=1)]
    u = inside if len(inside) else fit.u[None]
    return Posterior(fit.unknowns, fit.u, u, np.full(len(u), 1.0 / len(u)))


def _around(
    fitter: Fitter, model: MappedModel, found: Posterior, rng: np.random.Generator
) -> _Mixture:
    """Return a mixture about draws that count, more of them where there were too few."""
    share = np.cumsum(np.sqrt(found.weight))
    at = (np.arange(_CENTRES) + rng.random(_CENTRES)) / _CENTRES * share[-1]
    centres = found.u[np.unique(np.minimum(np.searchsorted(share, at), len(share) - 1))]
    near = np.diag(1.0 / np.maximum(np.square(found.deviations), 1e-18))
    roots = [
        _WIDER * _root(near + found.unknowns.information(fitter.jacobian(model, u)))
        for u in centres
    ]
    return _Mixture(centres, np.array(roots))


def _root(information: Array) -> Array:
    """Return the lower triangular root of its inverse."""
    return np.asarray(np.linalg.cholesky(np.linalg.inv(information)))


@dataclass(frozen=True, eq=False)
class _Mixture:
    """Equally likely Student distributions: means (m, k), roots (m, k, k) of their scales."""

    mean: Array
    root: Array

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """Return draws (n, k)."""
        which = np.arange(n) % len(self.mean)
        normal = rng.standard_normal((n, self.mean.shape[1]))
        stretch = np.sqrt(_FREEDOM / rng.chisquare(_FREEDOM, n))
        along = np.einsum("nij,nj->ni", self.root[which], normal)
        return np.asarray(self.mean[which] + along * stretch[:, None])

    def log_density(self, at: Array) -> Array:
        """Return the log of the density (n,) at points (n, k)."""
        k = self.mean.shape[1]
        z = np.einsum("mij,nmj->nmi", np.linalg.inv(self.root), at[:, None] - self.mean)
        log_det = np.log(np.einsum("mii->mi", self.root)).sum(axis=1)
        constant = gammaln(0.5 * (_FREEDOM + k)) - gammaln(0.5 * _FREEDOM)
        constant -= 0.5 * k * math.log(_FREEDOM * math.pi) + math.log(len(self.mean))
        square = np.einsum("nmi,nmi->nm", z, z)
        each = constant - log_det - 0.5 * (_FREEDOM + k) * np.log1p(square / _FREEDOM)
        return np.asarray(logsumexp(each, axis=1))
