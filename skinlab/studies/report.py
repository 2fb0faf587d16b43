"""The report of a study: one HTML page that needs no other file; its numbers are in the tables."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from skinlab.report.page import Illustration, Section, Table, page
from skinlab.report.pictures import style, to_data_uri
from skinlab.studies import plots
from skinlab.studies.analysis import FACETS, Analysis, conditions, tells_nothing, usable
from skinlab.studies.design import WITHIN
from skinlab.studies.reliability import Reliability
from skinlab.studies.settings import NORMAL_90
from skinlab.studies.table import Cell, Columns

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = dict[str, Cell]

_MOST_FAILURES = 200
_MOST_PERCENT = 1000.0
_MOST_PICTURED = 6  # quantities with pictures of their own
_MARK = "Made by skinlab study. Research software; the limits are not clinically validated."


def people_of(table: Columns, one: Analysis) -> list[Row]:
    """Return each person's mean of a quantity with a 90 % interval, by the study's components."""
    rows = dict(conditions(usable(table)))[one.condition]
    values = rows.number(one.quantity)
    there = np.isfinite(values)
    y = np.log(values[there]) if one.scale == "log" else values[there]
    names, at = np.unique(rows.text["subject"][there], return_inverse=True)
    visits = [len(np.unique(rows.text["visit"][there][at == k])) for k in range(len(names))]
    counts = np.bincount(at)
    means = np.bincount(at, y) / counts
    found = one.found
    repeated = visit = 0.0
    if found is not None:
        visit = found.variance(["visit"])
        repeated = found.variance(["operator", "probe", "placement", WITHIN])
    made: list[Row] = []
    for name, mean, count, n in zip(names.tolist(), means, counts, visits, strict=True):
        reach = NORMAL_90 * math.sqrt(repeated / int(count) + visit / n)
        ends = (float(mean), float(mean) - reach, float(mean) + reach)
        if one.scale == "log":
            ends = (math.exp(ends[0]), math.exp(ends[1]), math.exp(ends[2]))
        made.append(
            {
                "condition": one.condition,
                "quantity": one.quantity,
                "subject": name,
                "curves": int(count),
                "visits": n,
                "value": ends[0],
                "low": ends[1],
                "high": ends[2],
            }
        )
    return made


def flags_of(table: Columns) -> list[Row]:
    """Return how many curves have each flag."""
    counts: Counter[str] = Counter()
    for flags in table.text["flags"].tolist():
        counts.update(flags.split())
    if "error" in table.text:
        failed = int((table.text["error"] != "").sum())
        if failed:
            counts["not identified"] = failed
    if copies := int((table.text["same_as"] != "").sum()):
        counts["the same curve again (left out)"] = copies
    if silent := int(tells_nothing(table).sum()):
        counts["tells no parameter (left out)"] = silent
    return [
        {"flag": flag, "curves": count, "share": count / max(len(table), 1)}
        for flag, count in counts.most_common()
    ]


def main_analyses(found: Reliability) -> list[Analysis]:
    """Return one analysis a quantity: on its main scale, under the condition of most curves."""
    quantities = dict.fromkeys(a.quantity for a in found.analyses)
    chosen = (found.of(q) for q in quantities)
    return [a for a in chosen if a is not None]


def html(
    title: str,
    table: Columns,
    found: Reliability,
    people: Mapping[str, Sequence[Row]],
    failures: Sequence[Mapping[str, str]],
    more: Sequence[Section] = (),
) -> str:
    """Return the page."""
    main = main_analyses(found)
    sections = [
        _overview(table, found, failures),
        *([_shares(main)] if main else []),
        *([_agreement(found, main)] if main else []),
        *_forests(main, people),
        *_bland_altman(found, main),
        *_trends(table, found, main),
        *more,
        _flags(table),
        *([_failures(failures)] if failures else []),
        _method(),
    ]
    return page(title, sections, subtitle=_MARK, notices=_notices(table))


def _notices(table: Columns) -> list[str]:
    missing = [
        name
        for name in ("subject", "visit", "site", "operator", "probe")
        if not (table.text[name] != "").any()
    ]
    if len(table) and "subject" in missing:
        return ["No file states whose curves these are: people and repeats cannot be told apart."]
    return []


def _picture(draw: Callable[[], Figure], alt: str, caption: str) -> Illustration:
    with style():
        return Illustration(to_data_uri(draw()), alt, caption)


def _overview(table: Columns, found: Reliability, failures: Sequence[Mapping[str, str]]) -> Section:
    def count(name: str) -> str:
        values = np.unique(table.text[name])
        return str(int((values != "").sum()))

    rows = [
        ["curves", str(len(table))],
        ["identified", str(int((table.text["error"] == "").sum()))],
        ["files in failures.csv", str(len({f["file"] for f in failures}))],
        *(
            [n + "s" if n != "subject" else "people", count(n)]
            for n in ("subject", "site", "visit", "operator", "probe")
        ),
    ]
    under = [
        [name, str(len(rows_)), str(len(np.unique(rows_.text["subject"])))]
        for name, rows_ in conditions(usable(table))
    ]
    return Section(
        "What was measured",
        points=list(found.notes),
        tables=[
            Table(["", "number"], rows),
            Table(["opening and program", "curves", "people"], under),
        ],
    )


def _shares(main: Sequence[Analysis]) -> Section:
    rows = []
    for one in main:
        assert one.found is not None
        for part in one.found.parts:
            rows.append(
                [
                    f"{one.quantity} ({one.scale})",
                    part.name,
                    f"{100 * part.share:.1f} %",
                    f"{100 * part.share_low:.0f} to {100 * part.share_high:.0f} %",
                    f"{math.sqrt(part.variance):.4g}",
                    f"{math.sqrt(part.low):.3g} to {math.sqrt(part.high):.3g}",
                    str(part.levels),
                ]
            )
    picture = _picture(
        lambda: plots.draw_shares(main),
        "Bars of the shares of variance of each quantity: people, sites, visits, operators, "
        "probes, placements and what is left within.",
        "Shares of the variance, per cent.",
    )
    return Section(
        "Where the scatter comes from",
        [
            "How much people differ, and how much only the measurement scatters. A share of two or "
            "three operators or probes is known poorly, and its interval says so. Stiffness is "
            "taken in logarithms: a standard deviation of 0.1 is about 10 %."
        ],
        figures=[picture],
        tables=[
            Table(
                ["quantity", "component", "share", "90 %", "standard deviation", "90 %", "levels"],
                rows,
            )
        ],
    )


def _agreement(found: Reliability, main: Sequence[Analysis]) -> Section:
    head = ["quantity", "done anew", "ICC single", "90 %", "ICC mean of 2", "CV", "MDC95", "90 %"]
    rows: list[list[str]] = []
    figures: list[Illustration] = []
    for one in main:
        own = [r for r in found.agreement if one.owns(r) and r["by"] == "components"]
        for facet in FACETS:
            of = {(str(r["measure"]), r["k"]): r for r in own if r["facet"] == facet.name}
            single = of.get((f"ICC({facet.form},1)", 1))
            if single is None:
                continue
            double, cv, mdc = of[f"ICC({facet.form},k)", 2], of["CV", 1], of["MDC95 %", 1]
            rows.append(
                [
                    one.quantity,
                    facet.words,
                    f"{single['value']:.2f}",
                    f"{single['low']:.2f} to {single['high']:.2f}",
                    f"{double['value']:.2f}",
                    f"{cv['value']:.1f} %",
                    f"{mdc['value']:.0f} %",
                    _ends(mdc, 0),
                ]
            )
        repeats = [r for r in own if r["measure"] == "MDC95 %"]
        if repeats and len(figures) < _MOST_PICTURED:
            figures.append(
                _picture(
                    lambda o=one, r=repeats: plots.draw_repeats(o, r),  # type: ignore[misc]
                    f"Minimal detectable change of {one.quantity} over the number of placements.",
                    "Bars: 90 % intervals.",
                )
            )
    return Section(
        "Repeatability and reproducibility",
        [
            "ICC: the share of the variance that is of people when so much is done anew (forms of "
            "Shrout and Fleiss). CV: the standard error of measurement, per cent. MDC95: the "
            "smallest change between two measurements that is more than their scatter, at 95 %."
        ],
        figures=figures,
        tables=[Table(head, rows)],
    )


def _ends(row: Row, digits: int) -> str:
    """Return the interval of a percentage; what is beyond all use is not written out."""
    low, high = float(row["low"] or 0), float(row["high"] or 0)
    upper = f"{high:.{digits}f}" if high < _MOST_PERCENT else f"over {_MOST_PERCENT:.0f}"
    return f"{low:.{digits}f} to {upper} %"


def _forests(main: Sequence[Analysis], people: Mapping[str, Sequence[Row]]) -> Iterator[Section]:
    figures = [
        _picture(
            lambda o=one: plots.draw_forest(o, people[o.quantity]),  # type: ignore[misc]
            f"Every person's mean of {one.quantity} with its 90 % interval.",
            one.condition,
        )
        for one in main[:_MOST_PICTURED]
        if people.get(one.quantity)
    ]
    if figures:
        yield Section(
            "People",
            ["Intervals count visits, operators, probes, placements and noise."],
            figures=figures,
        )


def _bland_altman(found: Reliability, main: Sequence[Analysis]) -> Iterator[Section]:
    rows: list[list[str]] = []
    figures: list[Illustration] = []
    for one in main:
        pictured: set[str] = set()
        for row in filter(one.owns, found.bland_altman):
            rows.append(
                [
                    f"{one.quantity} ({one.scale})",
                    str(row["facet"]),
                    f"{row['second']} − {row['first']}",
                    str(row["count"]),
                    f"{row['bias']:+.3g}",
                    f"{row['bias_low']:+.3g} to {row['bias_high']:+.3g}",
                    f"{row['lower']:+.3g} to {row['upper']:+.3g}",
                ]
            )
            facet = str(row["facet"])
            if facet in pictured or len(figures) >= 2 * _MOST_PICTURED:
                continue
            pictured.add(facet)
            keys = ("condition", "quantity", "scale", "facet", "first", "second")
            pairs = [p for p in found.pairs if all(p[k] == row[k] for k in keys)]
            figures.append(
                _picture(
                    lambda r=row, p=pairs: plots.draw_agreement(r, p),  # type: ignore[misc]
                    f"Differences of {one.quantity} between {row['second']} and {row['first']} "
                    "over their means, with the limits of agreement.",
                    "Bands: 95 % intervals.",
                )
            )
    if rows:
        yield Section(
            "Agreement (Bland and Altman)",
            [
                "The mean difference of pairs, and the limits within which 95 % of differences "
                "lie. In logarithms 0.1 is about 10 %."
            ],
            figures=figures,
            tables=[
                Table(["quantity", "of", "difference", "pairs", "mean", "95 %", "limits"], rows)
            ],
        )


def _trends(table: Columns, found: Reliability, main: Sequence[Analysis]) -> Iterator[Section]:
    rows: list[list[str]] = []
    figures: list[Illustration] = []
    for one in main:
        for row in filter(one.owns, found.trends):
            rows.append(
                [
                    f"{one.quantity} ({one.scale})",
                    str(row["against"]),
                    f"{row['slope']:+.3g}",
                    f"{row['low']:+.3g} to {row['high']:+.3g}",
                    f"{row['correlation']:+.2f}",
                    str(row["count"]),
                ]
            )
            name = str(row["against"])
            if name in table.names and len(figures) < _MOST_PICTURED:
                x, y = _by_person(table, one, name)
                figures.append(
                    _picture(
                        lambda o=one, r=row, a=x, b=y: plots.draw_trend(o, r, a, b),  # type: ignore[misc]
                        f"Every person's mean of {one.quantity} over {name}.",
                        one.condition,
                    )
                )
    if rows:
        yield Section(
            "Trends",
            ["Slopes of people's means over what is known of them; of visits, within people."],
            figures=figures,
            tables=[Table(["quantity", "over", "slope", "90 %", "correlation", "values"], rows)],
        )


def _by_person(table: Columns, one: Analysis, name: str) -> tuple[Any, Any]:
    rows = dict(conditions(usable(table)))[one.condition]
    values, known = rows.number(one.quantity), rows.number(name)
    there = np.isfinite(values) & np.isfinite(known)
    y = np.log(values[there]) if one.scale == "log" else values[there]
    _, at = np.unique(rows.text["subject"][there], return_inverse=True)
    counts = np.bincount(at)
    return np.bincount(at, known[there]) / counts, np.bincount(at, y) / counts


def _flags(table: Columns) -> Section:
    rows = [
        [str(r["flag"]), str(r["curves"]), f"{100 * float(r['share'] or 0):.1f} %"]
        for r in flags_of(table)
    ]
    if not rows:
        return Section("Flags", ["No curve has any."])
    return Section("Flags", tables=[Table(["flag", "curves", "share"], rows)])


def _failures(failures: Sequence[Mapping[str, str]]) -> Section:
    rows = [[f["file"], f["reason"]] for f in failures[:_MOST_FAILURES]]
    rest = len(failures) - len(rows)
    return Section(
        "Files that could not be used, or were left alone",
        [f"And {rest} more: failures.csv has all."] if rest else [],
        tables=[Table(["file", "reason"], rows)],
    )


def _method() -> Section:
    return Section(
        "How it was computed",
        [
            "Components of variance: a mixed model with random people, sites (of all people, and "
            "of each), visits of each person, operators, probes and placements, by restricted "
            "maximum likelihood; later cycles of a site are a fixed effect. Intervals: generalised "
            "confidence intervals from the mean squares of each effect, adjusted for all effects "
            "not nested in it. An effect that nothing tells apart from another is left out, and "
            "said so above.",
            "Stiffnesses are taken on a log scale here; agreement.csv and "
            "components.csv have both scales, every quantity and every opening and program.",
        ],
    )
