"""How much likelier one explanation is than another, and what chance does, in round words."""

from __future__ import annotations

from collections.abc import Sequence

from skinlab.discrepancy.settings import NAMES


def odds_words(log10_ratio: float) -> str:
    """Return how many times likelier, rounded, at most "more than 10,000 times"."""
    if log10_ratio > NAMES.most_decades:
        return f"more than {10**NAMES.most_decades:,.0f} times"
    times = 10**log10_ratio
    if times < 10:
        return f"{times:#.2g} times"
    return f"{float(f'{times:.2g}'):,.0f} times"


def likelier_words(log10_ratio: float) -> str:
    """Return how many times likelier, or less likely: 0.05 times likelier is 20 times less likely.

    >>> likelier_words(2.0), likelier_words(-1.3)
    ('100 times likelier', '20 times less likely')
    """
    how = "likelier" if log10_ratio > 0 else "less likely"
    return f"{odds_words(abs(log10_ratio))} {how}"


def than_none_words(log10_evidence: float) -> str:
    """Return how much likelier, or less likely, an explanation is than none at all."""
    return f"{likelier_words(log10_evidence)} than none at all"


def behind_words(log10_behind: float | None, best: str = "the best") -> str:
    """Return how far behind the best an explanation is; None: it is compared with no other."""
    if log10_behind is None:
        return "counts with the errors, and is not compared"
    if log10_behind < 0:
        return f"{odds_words(-log10_behind)} likelier"
    return best if log10_behind == 0 else f"{odds_words(log10_behind)} less likely"


def each_behind(log10_behind: Sequence[float | None]) -> list[str]:
    """Return how far behind the best each of some explanations is."""
    best = "the best of the others" if None in log10_behind else "the best"
    return [behind_words(behind, best) for behind in log10_behind]


def chance_words(p_value: float) -> str:
    """Return how often chance alone does as much."""
    if p_value < 1e-6:
        return "chance does so less than once in a million"
    if p_value < 0.1:
        return f"chance does so once in {float(f'{1 / p_value:.2g}'):,.0f}"
    return "chance does so often"
