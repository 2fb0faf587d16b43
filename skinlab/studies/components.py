"""Components of variance: what share of the scatter is people, sites, visits, operators, probes.

The model is y = X b + sum over effects of Z u + e with independent normal u and e. Values are of
restricted maximum likelihood (Patterson and Thompson 1971), as statsmodels and lme4 give them.

Intervals: each effect has a mean square, adjusted for all effects that are not nested in it, whose
expectation is a known mixture of the components. For single components, shares and ICC the mean
squares are drawn from their chi-squares and the mixture is solved, many times: generalised
confidence intervals (Weerahandi 1993; Burdick, Borror and Montgomery 2005). Two probes that agree
by luck would be given "0 to 0", as if they could not differ; so the upper end is taken among the
draws above zero (the CLs bound: Read 2002, J. Phys. G 28:2693), which is the usual end wherever a
component is seen. For sums of components, of which SEM and MDC are the root, these are too high
where one part is poorly known; there it is the modified large-sample interval (Ting, Burdick,
Graybill, Jeyaratnam and Lu 1990). Both hold with two operators as well, where the profile of the
likelihood and a bootstrap do not.

skinlab/studies/design.py has the sums of squares and the likelihood.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from skinlab.studies.design import WITHIN, Design, Effect
from skinlab.studies.settings import COMPONENTS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Component:
    """A variance with its interval, and its share of the total."""

    name: str
    variance: float
    low: float
    high: float
    share: float
    share_low: float
    share_high: float
    levels: int
    freedom: int  # degrees of freedom that tell it


@dataclass(frozen=True, eq=False)
class Components:
    """What was found.

    `draws` (m, effects) are of all variances, in the order of `parts`; some are below zero, which
    only sums may make good.
    """

    parts: tuple[Component, ...]
    mean: float
    count: int
    draws: Array
    notes: tuple[str, ...]  # which effects cannot be told apart, and why
    squares: Array  # (effects,) mean squares, in the order of `parts`
    mixture: Array  # (effects, effects): solves these for the components

    def sum_interval(self, weights: Mapping[str, float]) -> tuple[float, float]:
        """Return the interval of a sum of weighted components; those not there count as zero."""
        w = np.array([weights.get(p.name, 0.0) for p in self.parts])
        freedom = np.array([p.freedom for p in self.parts], dtype=float)
        return _large_sample(w @ self.mixture, self.squares, freedom)

    def variance(self, names: Sequence[str]) -> float:
        """Return the sum of these components; those that are not there count as zero."""
        return float(sum(p.variance for p in self.parts if p.name in names))

    def drawn(self, names: Sequence[str]) -> Array:
        """Return the draws (m,) of that sum."""
        chosen = [k for k, p in enumerate(self.parts) if p.name in names]
        return np.asarray(np.maximum(self.draws[:, chosen].sum(axis=1), 0.0))

    def has(self, name: str) -> bool:
        """Return whether the component could be estimated."""
        return any(p.name == name for p in self.parts)


def components(
    values: Array,
    effects: Sequence[Effect],
    fixed: Array | None = None,
    *,
    seed: int = 0,
) -> Components:
    """Return the components of variance of values (n,).

    `fixed` (n, p) are columns of fixed effects besides the mean. The first effect should be the one
    inside of which the others mostly repeat: people.

    Raises:
        ValueError: fewer than three values, all the same, a block too large, or no effect that can
            be told from the scatter within.
    """
    n = len(values)
    if n < 3 or not np.ptp(values) > 0:
        raise ValueError("fewer than three values, or all the same")
    X = np.column_stack([np.ones(n), *([] if fixed is None else [fixed])])
    design = Design.of(X, effects)
    while True:
        lost = design.lost()
        if lost is None:
            break
        design = design.without(*lost)
    if not design.effects:
        raise ValueError("; ".join(design.notes) or "the curves differ in nothing that is stated")
    if design.freedom(WITHIN) < 1:
        raise ValueError("there are not enough repeats to estimate any scatter")
    # In units of its own spread, so that no step of the search depends on the unit.
    scale = float(np.std(values))
    y = (values - values.mean()) / scale
    found, b = design.reml(y)
    draws = design.draws(y, np.random.default_rng(seed))
    names = [*(e.name for e in design.effects), WITHIN]
    positive = np.maximum(draws, 0.0)
    total, totals = found.sum(), positive.sum(axis=1)
    parts = []
    for k, name in enumerate(names):
        low, high = interval(positive[:, k], float(found[k]))
        share = float(found[k] / total)
        share_low, share_high = interval(positive[:, k] / totals, share)
        parts.append(
            Component(
                name,
                float(found[k]) * scale**2,
                low * scale**2,
                high * scale**2,
                share,
                share_low,
                share_high,
                n if name == WITHIN else design.effects[k].levels,
                design.freedom(name),
            )
        )
    mean = float(values.mean() + scale * b[0])
    squares, mixture = design.mean_squares(y)
    return Components(
        tuple(parts), mean, n, draws * scale**2, design.notes, squares * scale**2, mixture
    )


def _large_sample(q: Array, squares: Array, freedom: Array) -> tuple[float, float]:
    """Return the interval of the sum of q times mean squares (k,); zero is its least end.

    Ting et al. 1990, J. Stat. Comput. Simul. 35:135, equations as in Burdick and Graybill 1992.
    """
    tail = (1 - COMPONENTS.level) / 2
    value = float(q @ squares)
    size = np.abs(q) * squares
    up, down = q > 0, q < 0
    low = high = 0.0
    G = 1.0 - freedom / chi2.ppf(1 - tail, freedom)
    H = freedom / chi2.ppf(tail, freedom) - 1.0
    low += float(np.square(G[up] * size[up]).sum() + np.square(H[down] * size[down]).sum())
    high += float(np.square(H[up] * size[up]).sum() + np.square(G[down] * size[down]).sum())
    for i in np.flatnonzero(up):
        for j in np.flatnonzero(down):
            F = float(f_distribution.ppf(1 - tail, freedom[i], freedom[j]))
            low += float(((F - 1) ** 2 - (G[i] * F) ** 2 - H[j] ** 2) / F * size[i] * size[j])
            F = float(f_distribution.ppf(tail, freedom[i], freedom[j]))
            high += float(((1 - F) ** 2 - (H[i] * F) ** 2 - G[j] ** 2) / F * size[i] * size[j])
    return (
        max(value - float(np.sqrt(max(low, 0.0))), 0.0),
        max(value + float(np.sqrt(max(high, 0.0))), 0.0),
    )


def interval(draws: Array, value: float) -> tuple[float, float]:
    """Return the interval of draws (m,) that are zero or more, widened to hold the value.

    Its upper end is that of the draws above zero: never "0 to 0".
    """
    tail = (1 - COMPONENTS.level) / 2
    above = draws[draws > 0]
    high = float(np.quantile(above, 1 - tail)) if above.size else 0.0
    return min(float(np.quantile(draws, tail)), value), max(high, value)
