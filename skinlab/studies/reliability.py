"""How far a study's values can be relied on: variance shares, ICC, SEM, MDC, repeats, agreement."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations, islice

import numpy as np
from numpy.typing import NDArray
from scipy.stats import linregress
from scipy.stats import t as t_distribution

from skinlab.studies.agreement import BlandAltman, bland_altman, shrout_fleiss
from skinlab.studies.analysis import (
    NOT_STATED,
    PLACED,
    Analysis,
    Array,
    Facet,
    Row,
    analysis_of,
    conditions,
    main_scale,
    numbered,
    undated,
    usable,
    without_a_day,
)
from skinlab.studies.components import interval
from skinlab.studies.design import WITHIN
from skinlab.studies.settings import COMPONENTS
from skinlab.studies.table import Columns


@dataclass(frozen=True, eq=False)
class Reliability:
    """All that a table says of the reliability of its quantities."""

    analyses: tuple[Analysis, ...]
    components: tuple[Row, ...]
    agreement: tuple[Row, ...]
    bland_altman: tuple[Row, ...]
    pairs: tuple[Row, ...]  # what Bland and Altman's limits are of
    trends: tuple[Row, ...]
    notes: tuple[str, ...]

    def of(self, quantity: str) -> Analysis | None:
        """Return the analysis of a quantity with the most curves; None where there is none."""
        fitting = [
            a
            for a in self.analyses
            if a.found is not None and a.quantity == quantity and a.scale == main_scale(quantity)
        ]
        return max(fitting, key=lambda a: a.found.count if a.found else 0, default=None)


def reliability(table: Columns, seed: int = 0) -> Reliability:
    """Return what the table says of the reliability of its quantities."""
    kept = numbered(usable(table))
    analyses: list[Analysis] = []
    blands: list[Row] = []
    pairs: list[Row] = []
    trends: list[Row] = []
    tables: list[Row] = []
    notes = dict.fromkeys(without_a_day(kept))
    for condition, rows in conditions(kept):
        notes |= dict.fromkeys(_limits(condition, rows))
        for quantity in kept.quantities:
            values = rows.number(quantity)
            there = np.isfinite(values)
            if there.sum() < COMPONENTS.fewest:
                continue
            part, values = rows.where(there), values[there]
            for scale in dict.fromkeys((main_scale(quantity), "linear")):
                if scale == "log" and not (values > 0).all():
                    continue
                y = np.log(values) if scale == "log" else values
                one = analysis_of(condition, quantity, scale, part, y, seed)
                analyses.append(one)
                notes |= dict.fromkeys(_notes(one))
                tables += _from_tables(one, part, y)
                for row, pair in _agreements(one, part, y):
                    blands.append(row)
                    pairs += pair
                trends += _trends(one, part, y)
    found = [row for one in analyses for row in _components(one)]
    agreement = [row for one in analyses for row in _agreement(one)] + tables
    return Reliability(
        tuple(analyses),
        tuple(found),
        tuple(agreement),
        tuple(blands),
        tuple(pairs),
        tuple(trends),
        tuple(notes),
    )


def _limits(condition: str, table: Columns) -> Iterator[str]:
    """Yield what a reader of the figures of one condition should know."""
    if condition.endswith(NOT_STATED):
        yield f"{condition}: curves of different programs, if there are any, are taken as one"
    for facet in _AGAIN:
        count = math.comb(len(np.unique(table.text[facet][_compared(table, facet)])), 2)
        if count > COMPONENTS.most_pairs:
            shown = f"the first {COMPONENTS.most_pairs} of {count} pairs of {facet}s"
            yield f"{condition}: agreement of {shown}"


def _notes(one: Analysis) -> list[str]:
    notes = [] if one.why is None else [one.why]
    if one.found is not None:
        notes += [f"{one.condition}: {note}" for note in one.found.notes]
    return notes


# ---- tables ---------------------------------------------------------------------------------


def _components(one: Analysis) -> Iterator[Row]:
    if one.found is None:
        return
    for part in one.found.parts:
        row = asdict(part)
        name = row.pop("name")
        yield {
            **one.key,
            "curves": one.found.count,
            "people": one.people,
            "component": name,
            "sd": math.sqrt(part.variance),
            **row,
            "level": COMPONENTS.level,
        }
    if one.identification is not None:
        total = sum(p.variance for p in one.found.parts)
        # Intervals hold what all curves err in alike as well: of the scatter it is no more than it.
        own = min(one.identification, one.found.variance([WITHIN]))
        yield {
            **one.key,
            "curves": one.found.count,
            "people": one.people,
            "component": "of which identification",
            "sd": math.sqrt(own),
            "variance": own,
            "share": own / total,
            "levels": one.found.count,
        }


def _agreement(one: Analysis) -> Iterator[Row]:
    found = one.found
    if found is None:
        return
    for facet in one.facets():
        error, drawn = found.variance(facet.error), found.drawn(facet.error)
        repeated = found.variance(PLACED)
        true, drawn_true = found.variance(facet.same), found.drawn(facet.same)
        key: Row = {**one.key, "facet": facet.name, "by": "components", "level": COMPONENTS.level}
        for k in (1, 2, 3):
            value = true / (true + error / k) if true + error > 0 else 0.0
            whole = np.maximum(drawn_true + drawn / k, np.finfo(float).tiny)
            form = f"ICC({facet.form},{'1' if k == 1 else 'k'})"
            words = f"{'+'.join(facet.same)} / (the same + ({'+'.join(facet.error)})/k)"
            found_in = (value, *interval(drawn_true / whole, value))
            yield key | _measure(form, k, found_in, "1", words)
        unit = "log" if one.scale == "log" else "of the quantity"
        for k in COMPONENTS.repeats:
            # Repeats are new placements: what a visit, operator or probe adds stays.
            left = error - repeated + repeated / k
            ends = found.sum_interval({n: 1 / k if n in PLACED else 1.0 for n in facet.error})
            for measure, factor in (("SEM", 1.0), ("MDC95", 1.96 * math.sqrt(2.0))):
                value = factor * math.sqrt(left)
                low = min(factor * math.sqrt(ends[0]), value)
                high = max(factor * math.sqrt(ends[1]), value)
                words = f"{'1.96 √2 ' if factor > 1 else ''}√({'+'.join(facet.error)})"
                yield key | _measure(measure, k, (value, low, high), unit, words)
                name = "CV" if measure == "SEM" else "MDC95 %"
                percent = [_percent(v, one, measure) for v in (value, low, high)]
                yield key | _measure(name, k, percent, "%", _percent_words(one.scale, measure))


def _measure(name: str, k: int, found: Sequence[float], unit: str, definition: str) -> Row:
    """Return the columns of a measure of agreement of k repeats: value, low and high."""
    value, low, high = found
    return {
        "measure": name,
        "k": k,
        "value": value,
        "low": low,
        "high": high,
        "unit": unit,
        "definition": definition,
    }


def _percent(value: float, one: Analysis, measure: str) -> float:
    assert one.found is not None
    if one.scale == "linear":
        return 100.0 * value / abs(one.found.mean) if one.found.mean else math.nan
    if measure == "SEM":
        return 100.0 * math.sqrt(math.expm1(min(value, 20.0) ** 2))
    return 100.0 * math.expm1(min(value, 20.0))


def _percent_words(scale: str, measure: str) -> str:
    if scale == "linear":
        return f"100 {measure} / mean"
    return "100 √(exp(SEM²) − 1)" if measure == "SEM" else "100 (exp(MDC95) − 1): a rise"


def repeats_for(one: Analysis, percent: float, facet: Facet) -> int | None:
    """Return how many placements must be averaged for an MDC95 of so many per cent.

    None where no number is enough, because the visit, operator or probe alone adds more.
    """
    found = one.found
    if found is None:
        return None
    repeated = found.variance(PLACED)
    rest = found.variance(facet.error) - repeated
    if one.scale == "log":
        wanted = math.log1p(percent / 100.0)
    else:
        wanted = percent / 100.0 * abs(found.mean)
    left = (wanted / (1.96 * math.sqrt(2.0))) ** 2 - rest
    if left <= 0:
        return None
    needed = repeated / left
    return max(1, math.ceil(needed - 1e-9)) if needed < COMPONENTS.most_repeats else None


# ---- pairs and complete tables --------------------------------------------------------------

_AGAIN: Mapping[str, tuple[str, ...]] = {
    "operator": ("subject", "site", "visit"),
    "probe": ("subject", "site", "visit"),
    "visit": ("subject", "site"),
    "placement": ("subject", "site", "visit", "operator", "probe"),
}


def _compared(table: Columns, facet: str) -> NDArray[np.bool_]:
    """Return the rows (n,) that have a level of a facet in common with others.

    A visit of which nobody said the day is nobody's first or second.
    """
    return ~undated(table) if facet == "visit" else np.ones(len(table), dtype=bool)


def _cells(
    table: Columns, y: Array, facet: str
) -> dict[tuple[str, ...], dict[str, tuple[float, int]]]:
    """Return the mean of each target by the facet's levels, with the number of curves."""
    there = _compared(table, facet)
    table, y = table.where(there), y[there]
    names = _AGAIN[facet]
    keys = list(zip(*(table.text[n].tolist() for n in names), strict=True))
    sums: dict[tuple[str, ...], dict[str, tuple[float, int]]] = {}
    for key, level, value in zip(keys, table.text[facet].tolist(), y.tolist(), strict=True):
        cell = sums.setdefault(key, {})
        total, count = cell.get(level, (0.0, 0))
        cell[level] = (total + value, count + 1)
    return {k: {m: (t / c, c) for m, (t, c) in v.items()} for k, v in sums.items()}


def _from_tables(one: Analysis, table: Columns, y: Array) -> Iterator[Row]:
    """Yield the intraclass correlations of complete two-way tables, as publications have them."""
    for facet in _AGAIN:
        levels = _levels(table, facet)
        if not 2 <= len(levels) <= 20:
            continue
        cells = _cells(table, y, facet)
        whole = [
            [cell[level][0] for level in levels]
            for cell in cells.values()
            if all(level in cell for level in levels)
        ]
        if len(whole) < 3:
            continue
        try:
            found = shrout_fleiss(np.array(whole))
        except ValueError:
            continue
        key: Row = {"facet": facet, "by": "table", "level": COMPONENTS.published_level}
        words = (
            f"Shrout and Fleiss 1979: {len(whole)} targets "
            f"({'×'.join(_AGAIN[facet])}) × {len(levels)} of {facet}, means of cells"
        )
        for icc in found:
            k = 1 if icc.form.endswith("1)") else len(levels)
            ends = (icc.value, icc.low, icc.high)
            yield one.key | key | _measure(icc.form, k, ends, "1", words)


def _agreements(one: Analysis, table: Columns, y: Array) -> Iterator[tuple[Row, list[Row]]]:
    for facet in _AGAIN:
        levels = _levels(table, facet)
        if len(levels) < 2:
            continue
        cells = _cells(table, y, facet)
        for first, second in islice(combinations(levels, 2), COMPONENTS.most_pairs):
            both = [(k, c) for k, c in cells.items() if first in c and second in c]
            a = np.array([c[first][0] for _, c in both])
            b = np.array([c[second][0] for _, c in both])
            try:
                found: BlandAltman = bland_altman(a, b)
            except ValueError:
                continue
            key: Row = {**one.key, "facet": facet, "first": first, "second": second}
            targets = [" ".join(k) for k, _ in both]
            pairs: list[Row] = [
                {**key, "target": t, "mean": float(m), "difference": float(d)}
                for t, m, d in zip(targets, (a + b) / 2, b - a, strict=True)
            ]
            yield {**key, **asdict(found), "level": COMPONENTS.published_level}, pairs


def _levels(table: Columns, facet: str) -> list[str]:
    return _ordered(np.unique(table.text[facet][_compared(table, facet)]).tolist())


def _ordered(levels: Sequence[str]) -> list[str]:
    """Return labels in the order of their numbers, where all are numbers."""
    try:
        return sorted(levels, key=float)
    except ValueError:
        return sorted(levels)


# ---- trends ---------------------------------------------------------------------------------

_NOT_COVARIATES = frozenset({"seed", "numpy", "scipy", "method"})


def _trends(one: Analysis, table: Columns, y: Array) -> Iterator[Row]:
    """Yield slopes: of people's means over numbers known of them, and over the order of visits."""
    subjects, at = np.unique(table.text["subject"], return_inverse=True)
    counts = np.bincount(at)
    means = np.bincount(at, y) / counts
    for name in covariates_of(table):
        values = table.number(name)
        by_person = np.bincount(at, np.nan_to_num(values, nan=np.inf)) / counts
        there = np.isfinite(by_person)
        if there.sum() >= 5 and np.ptp(by_person[there]) > 0:
            yield _slope(one, name, by_person[there], means[there], int(there.sum()) - 2)
    there = _compared(table, "visit")
    table, y = table.where(there), y[there]
    visits = _levels(table, "visit")
    if len(visits) > 1:
        order = {visit: k for k, visit in enumerate(visits)}
        x = np.array([order[v] for v in table.text["visit"].tolist()], dtype=float)
        subjects, at = np.unique(table.text["subject"], return_inverse=True)
        counts = np.bincount(at)
        within_x = x - (np.bincount(at, x) / counts)[at]
        within_y = y - (np.bincount(at, y) / counts)[at]
        freedom = len(y) - len(subjects) - 1
        if freedom >= 3 and np.ptp(within_x) > 0:
            yield _slope(one, "visit (in order)", within_x, within_y, freedom)


def covariates_of(table: Columns) -> list[str]:
    """Return the columns of what else is known of the people, and is a number."""
    names = list(table.names)
    begin, end = names.index("error") + 1, names.index("method")
    return [
        n
        for n in names[begin:end]
        if n not in _NOT_COVARIATES and np.isfinite(table.number(n)).sum() >= 5
    ]


def _slope(one: Analysis, against: str, x: Array, y: Array, freedom: int) -> Row:
    fit = linregress(x, y)
    slope = float(fit.slope)
    error = float(fit.stderr) * math.sqrt((len(x) - 2) / max(freedom, 1))
    reach = float(t_distribution.ppf(0.95, max(freedom, 1))) * error
    return {
        **one.key,
        "against": against,
        "slope": slope,
        "low": slope - reach,
        "high": slope + reach,
        "level": COMPONENTS.level,
        "correlation": float(fit.rvalue),
        "count": len(x),
    }
