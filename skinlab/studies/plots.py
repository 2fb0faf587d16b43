"""The pictures of a study; drawn inside `skinlab.report.pictures.style`.

Colours are told apart by shape as well. Labels are those of the study's own tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from skinlab.mechanics.names import heading
from skinlab.report.pictures import BLUE, GREY, SERIES, VERMILION, new_figure
from skinlab.studies.analysis import Analysis
from skinlab.studies.design import WITHIN
from skinlab.studies.settings import COMPONENTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_IN = 6.0
_ORDER = ("subject", "site", "subject:site", "visit", "operator", "probe", "placement", WITHIN)
_HATCH = ("", "//", "\\\\", "..", "xx", "--", "oo", "")
_COLOURS = (*SERIES[:6], "#F0E442", GREY)
_MOST_NAMED = 45  # people whose pseudonyms can be read beside a forest
_MOST_POOLED = 12  # effects that are drawn
_NARROW = 10.0  # ends of an axis closer than this have ticks where a linear one has
_MANY = 3000  # points from which a picture stores them as an image

Row = Mapping[str, Any]


def label(quantity: str) -> str:
    """Return what an axis says."""
    return heading(quantity)


def draw_shares(analyses: Sequence[Analysis]) -> Figure:
    """Return the shares of the variance, a bar a quantity."""
    shown = [a for a in analyses if a.found is not None]
    figure = new_figure(WIDTH_IN + 1.0, 1.5 + 0.45 * len(shown))
    axes = figure.add_subplot()
    for row, one in enumerate(shown):
        assert one.found is not None
        begin = 0.0
        for part in sorted(one.found.parts, key=lambda p: _ORDER.index(p.name)):
            k = _ORDER.index(part.name)
            axes.barh(
                row,
                100 * part.share,
                left=begin,
                color=_COLOURS[k],
                hatch=_HATCH[k],
                edgecolor="white",
                lw=0.5,
                height=0.65,
            )
            if part.share > 0.06:
                axes.text(
                    begin + 50 * part.share,
                    row,
                    f"{100 * part.share:.0f}",
                    ha="center",
                    va="center",
                    fontsize=8,
                    bbox={"facecolor": "white", "alpha": 0.85, "lw": 0, "pad": 1.0},
                )
            begin += 100 * part.share
    there = {p.name for a in shown if a.found is not None for p in a.found.parts}
    handles = [
        _patch(_COLOURS[k], _HATCH[k], name) for k, name in enumerate(_ORDER) if name in there
    ]
    axes.set_yticks(range(len(shown)), [label(a.quantity) for a in shown], parse_math=False)
    axes.set_ylim(len(shown) - 0.5, -0.5)
    axes.set_xlim(0, 100)
    axes.set_xlabel("share of the variance (%)")
    axes.grid(axis="y", visible=False)
    figure.legend(handles=handles, loc="outside right upper", fontsize=8)
    return figure


def _patch(colour: str, hatch: str, name: str) -> Any:
    from matplotlib.patches import Patch

    return Patch(facecolor=colour, hatch=hatch, edgecolor="white", label=name)


def draw_pooled(pooled: Sequence[Row]) -> Figure:
    """Return the sizes of pooled effects with their intervals, those that hold at the top."""
    shown = sorted(pooled, key=lambda r: (not r["holds"], float(r["p_value"])))[:_MOST_POOLED]
    figure = new_figure(WIDTH_IN, 1.2 + 0.28 * len(shown))
    axes = figure.add_subplot()
    for at, row in enumerate(shown):
        colour = VERMILION if row["holds"] else GREY
        axes.hlines(at, float(row["low"]), float(row["high"]), color=colour, lw=2)
        fill = colour if row["holds"] else "white"
        axes.plot(float(row["size"]), at, "o", color=colour, mfc=fill, ms=5)
    axes.axvline(0.0, color=BLUE, lw=1.0)
    ends = [abs(float(r[n])) for r in shown if r["holds"] for n in ("low", "high")]
    reach = 1.3 * max([*ends, 2.0])  # an interval of what the curves hardly show would fill it
    axes.set_xlim(-reach, reach)
    names = [f"{r['effect']}, {r['shared_by']} {r['group']}".strip() for r in shown]
    axes.set_yticks(range(len(shown)), names, parse_math=False, fontsize=8)
    axes.set_ylim(len(shown) - 0.5, -0.5)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("size, in typical sizes, 90 % interval")
    return figure


def draw_forest(one: Analysis, people: Sequence[Row]) -> Figure:
    """Return the people's means with their intervals, the least at the top."""
    rows = sorted(people, key=lambda r: float(r["value"]))
    named = len(rows) <= _MOST_NAMED
    height = 1.2 + (0.16 * len(rows) if named else min(0.03 * len(rows), 7.0) + 2.0)
    figure = new_figure(WIDTH_IN, height)
    axes = figure.add_subplot()
    at = np.arange(len(rows))
    low, high, value = (np.array([float(r[n]) for r in rows]) for n in ("low", "high", "value"))
    axes.hlines(at, low, high, color=BLUE, lw=2 if named else 0.8)
    axes.plot(value, at, "o", color=BLUE, ms=4 if named else 2)
    middle = one.found.mean if one.found is not None else float(value.mean())
    axes.axvline(
        float(np.exp(middle)) if one.scale == "log" else middle,
        color=VERMILION,
        lw=1.5,
        ls="--",
        label="mean",
    )
    if one.scale == "log":
        _log_axis(axes, "x")
    axes.set_ylim(len(rows) - 0.5, -0.5)
    if named:
        axes.set_yticks(at, [str(r["subject"]) for r in rows], parse_math=False, fontsize=7)
    else:
        axes.set_yticks([])
        axes.set_ylabel(f"{len(rows)} people")
    axes.grid(axis="y", visible=False)
    axes.set_xlabel(f"{label(one.quantity)}: mean of a person, 90 % interval")
    axes.legend(loc="upper right", fontsize=8)
    return figure


def draw_agreement(row: Row, pairs: Sequence[Row]) -> Figure:
    """Return Bland and Altman's picture: differences of pairs over their means."""
    logs = row["scale"] == "log"
    figure = new_figure(WIDTH_IN, 3.8)
    axes = figure.add_subplot()
    mean = np.array([float(p["mean"]) for p in pairs])
    difference = np.array([float(p["difference"]) for p in pairs])
    axes.plot(
        np.exp(mean) if logs else mean,
        difference,
        "o",
        color=BLUE,
        ms=4,
        alpha=0.7,
        rasterized=len(mean) > _MANY,
    )
    for name, colour, style, words in (
        ("bias", VERMILION, "-", "mean difference"),
        ("lower", "#000000", "--", "95 % limits of agreement"),
        ("upper", "#000000", "--", None),
    ):
        axes.axhspan(
            float(row[f"{name}_low"]), float(row[f"{name}_high"]), color=colour, alpha=0.1, lw=0
        )
        axes.axhline(float(row[name]), color=colour, ls=style, lw=1.3, label=words)
    if logs:
        _log_axis(axes, "x")
    axes.set_xlabel(f"mean of both: {label(str(row['quantity']))}")
    unit = "log ratio" if logs else "difference"
    axes.set_ylabel(f"{unit}, {row['second']} − {row['first']}", parse_math=False)
    axes.set_title(f"{row['facet']}: {row['second']} against {row['first']}", parse_math=False)
    figure.legend(loc="outside lower right", ncols=2, fontsize=8)
    return figure


def draw_repeats(one: Analysis, rows: Sequence[Row]) -> Figure:
    """Return the minimal detectable change over the number of placements that are averaged."""
    figure = new_figure(WIDTH_IN, 3.6)
    axes = figure.add_subplot()
    facets = list(dict.fromkeys(str(r["facet"]) for r in rows))
    for k, facet in enumerate(facets):
        own = [r for r in rows if r["facet"] == facet]
        x = np.array([float(r["k"]) for r in own]) * (1 + 0.02 * (k - len(facets) / 2))
        value, low = (np.array([float(r[n]) for r in own]) for n in ("value", "low"))
        high = np.array([float(r["high"]) for r in own])
        known = high < 2.0 * value.max()  # else two operators or probes say next to nothing
        axes.plot(x, value, color=_COLOURS[k], marker="osv^D"[k % 5], ms=5, lw=1.2, label=facet)
        axes.vlines(x[known], low[known], high[known], color=_COLOURS[k], lw=1.2)
    axes.set_xscale("log")
    axes.set_xticks(COMPONENTS.repeats, [str(k) for k in COMPONENTS.repeats])
    axes.minorticks_off()
    top = max(float(r["value"]) for r in rows)
    axes.set_ylim(0, min(1.6 * top, 400.0))
    axes.set_xlabel("placements that are averaged")
    axes.set_ylabel("MDC95 (%)")
    axes.set_title(f"{label(one.quantity)}: smallest change that can be shown")
    axes.legend(title="done anew", fontsize=8, title_fontsize=8)
    return figure


def draw_trend(one: Analysis, row: Row, x: Any, y: Any) -> Figure:
    """Return people's means over what is known of them, with the line of least squares."""
    figure = new_figure(WIDTH_IN, 3.6)
    axes = figure.add_subplot()
    logs = one.scale == "log"
    axes.plot(x, np.exp(y) if logs else y, "o", color=BLUE, ms=4, alpha=0.7)
    ends = np.array([np.min(x), np.max(x)])
    line = np.mean(y) + float(row["slope"]) * (ends - np.mean(x))
    axes.plot(ends, np.exp(line) if logs else line, color=VERMILION, lw=1.8)
    if logs:
        _log_axis(axes, "y")
    axes.set_xlabel(str(row["against"]), parse_math=False)
    axes.set_ylabel(label(one.quantity))
    axes.set_title(f"correlation {float(row['correlation']):+.2f}".replace("-", "−"))
    return figure


def _log_axis(axes: Axes, which: str) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    axis = axes.xaxis if which == "x" else axes.yaxis
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    low, high = sorted(axes.get_xlim() if which == "x" else axes.get_ylim())
    wide = high / max(low, 1e-300)
    if wide < _NARROW:
        axis.set_major_locator(MaxNLocator(5))
    else:
        subs = (1.0, 2.0, 5.0) if wide < 100 else (1.0,)
        axis.set_major_locator(LogLocator(subs=subs, numticks=15))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
