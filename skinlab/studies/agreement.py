"""Agreement of two or more measurements of the same skins: Shrout and Fleiss, Bland and Altman."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as f_distribution
from scipy.stats import nct
from scipy.stats import t as t_distribution

from skinlab.studies.settings import COMPONENTS

Array = NDArray[np.float64]

LIMITS = 1.959963984540054  # of agreement: 95 % of differences, if they are normal


@dataclass(frozen=True)
class Icc:
    """One form of the intraclass correlation with its interval."""

    form: str  # as Shrout and Fleiss number them: ICC(2,1) …
    value: float
    low: float
    high: float


def shrout_fleiss(table: Array) -> tuple[Icc, ...]:
    """Return the six intraclass correlations of a table (targets, raters) without gaps.

    Shrout and Fleiss 1979, Psychol. Bull. 86:420; intervals as in McGraw and Wong 1996, Psychol.
    Methods 1:30.

    Raises:
        ValueError: fewer than two targets or raters, or no scatter.
    """
    n, k = table.shape
    if n < 2 or k < 2:
        raise ValueError("expected at least two targets and two raters")
    mean = table.mean()
    rows = k * float(np.square(table.mean(axis=1) - mean).sum())
    columns = n * float(np.square(table.mean(axis=0) - mean).sum())
    total = float(np.square(table - mean).sum())
    between = rows / (n - 1)
    within = (total - rows) / (n * (k - 1))
    raters = columns / (k - 1)
    error = max(total - rows - columns, 0.0) / ((n - 1) * (k - 1))
    if not (within > 0 and error > 0):
        raise ValueError("the raters do not differ at all")
    tail = 1 - (1 - COMPONENTS.published_level) / 2

    def quantile(first: float, second: float) -> float:
        return float(f_distribution.ppf(tail, first, second))

    def pair(ratio: float, freedom: float) -> tuple[float, float]:
        return ratio / quantile(n - 1, freedom), ratio * quantile(freedom, n - 1)

    def single(ratio: float) -> float:
        return float((ratio - 1) / (ratio + k - 1))

    def mean_of(one: float) -> float:
        return float(k * one / (1 + (k - 1) * one))

    one_low, one_high = pair(between / within, n * (k - 1))
    three_low, three_high = pair(between / error, (n - 1) * (k - 1))
    two = (between - error) / (between + (k - 1) * error + k * (raters - error) / n)
    a = k * two * raters / error
    b = n * (1 + (k - 1) * two) - k * two
    freedom = (k - 1) * (n - 1) * (a + b) ** 2 / ((n - 1) * a**2 + b**2)
    upper, lower = quantile(n - 1, freedom), quantile(freedom, n - 1)
    rest = k * raters + (k * n - k - n) * error
    two_low = n * (between - upper * error) / (upper * rest + n * between)
    two_high = n * (lower * between - error) / (rest + n * lower * between)
    return (
        Icc("ICC(1,1)", single(between / within), single(one_low), single(one_high)),
        Icc("ICC(2,1)", two, two_low, two_high),
        Icc("ICC(3,1)", single(between / error), single(three_low), single(three_high)),
        Icc("ICC(1,k)", 1 - within / between, 1 - 1 / one_low, 1 - 1 / one_high),
        Icc("ICC(2,k)", mean_of(two), mean_of(two_low), mean_of(two_high)),
        Icc("ICC(3,k)", 1 - error / between, 1 - 1 / three_low, 1 - 1 / three_high),
    )


@dataclass(frozen=True)
class BlandAltman:
    """Differences of pairs (second less first): their mean, and the limits of agreement."""

    count: int
    bias: float
    bias_low: float
    bias_high: float
    sd: float
    lower: float
    lower_low: float
    lower_high: float
    upper: float
    upper_low: float
    upper_high: float


def bland_altman(
    first: Array, second: Array, level: float = COMPONENTS.published_level
) -> BlandAltman:
    """Return the agreement of pairs (n,), (n,).

    Bland and Altman 1986, Lancet 327:307; the limits' intervals are exact (Carkeet 2015, Optom.
    Vis. Sci. 92:e71), from the noncentral t distribution.

    Raises:
        ValueError: fewer than three pairs, or no scatter.
    """
    d = second - first
    n = len(d)
    if n < 3 or not np.ptp(d) > 0:
        raise ValueError("expected at least three pairs that differ")
    bias, sd = float(d.mean()), float(d.std(ddof=1))
    tail = (1 - level) / 2
    root = math.sqrt(n)
    reach = float(t_distribution.ppf(1 - tail, n - 1)) * sd / root
    near, far = (float(nct.ppf(q, n - 1, LIMITS * root)) * sd / root for q in (tail, 1 - tail))
    return BlandAltman(
        n,
        bias,
        bias - reach,
        bias + reach,
        sd,
        bias - LIMITS * sd,
        bias - far,
        bias - near,
        bias + LIMITS * sd,
        bias + near,
        bias + far,
    )
