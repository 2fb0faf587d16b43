"""The report of the missing-effect workflow: one HTML page that stands alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from skinlab.discrepancy.candidates import behind_best
from skinlab.discrepancy.fit import Fit
from skinlab.discrepancy.odds import chance_words, each_behind
from skinlab.discrepancy.outcome import Outcome
from skinlab.discrepancy.text import (
    doubt_words,
    explained_by,
    explanation_words,
    function_rows,
    gap_words,
    lead_words,
    learned_words,
    left_out_words,
    limits_words,
    next_words,
    parameter_table,
    places_words,
    repeats_words,
    shares_words,
    stated_noise_words,
    values_words,
    verdict_words,
    where_words,
)
from skinlab.errors import InputError
from skinlab.io.files import cannot_write, check_can_write, write_file
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.names import effect_words
from skinlab.report.page import Illustration, Section, Table, page
from skinlab.report.pictures import new_figure, style, to_data_uri
from skinlab.text import inert, inert_lines

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NAME = "missing-effect.html"
_FEW = 12  # points of a function that are drawn one by one
_WIDE = 50.0  # a range that is drawn in its logarithm
_MARK = "skinlab missing-effect report"
_PARTIAL = "partial.txt"  # what an interrupted run knew
_PARTIAL_MARK = "Interrupted"  # how its text begins


def check_report(folder: Path) -> Path:
    """Make sure that the page can be written into the folder; return its path.

    Raises:
        InputError: the folder cannot be written, or holds a file of this name that is not ours.
    """
    to = folder / _NAME
    with cannot_write(to):
        if to.exists() and _MARK not in _text(to):
            raise InputError(f"{to}: exists and is not a report of ours; expected another folder")
    check_can_write(to)
    return to


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace")


def write_report(outcome: Outcome, folder: Path, title: str = "") -> Path:
    """Write the page into the folder; return its path.

    `title` is the campaign's. What an interrupted run left there is removed: it is known now.

    Raises:
        InputError: as `check_report`.
    """
    to = check_report(folder)
    write_file(to, render(outcome, title), replace=True)
    partial = folder / _PARTIAL
    with cannot_write(partial):
        if partial.is_file() and _text(partial).startswith(_PARTIAL_MARK):
            partial.unlink()
    return to


def write_partial(text: str, folder: Path) -> None:
    """Write what an interrupted run knows, which the next report there removes.

    Raises:
        InputError: it cannot be written.
    """
    write_file(folder / _PARTIAL, inert_lines(text) + "\n", replace=True)


def render(outcome: Outcome, title: str = "") -> str:
    """Return the page's text, with the campaign's title; the same outcome gives the same text."""
    sections = [
        Section(
            "Verdict",
            [
                *repeats_words(outcome),
                verdict_words(outcome),
                *lead_words(outcome),
                gap_words(outcome),
                *stated_noise_words(outcome),
                *left_out_words(outcome),
                *learned_words(outcome),
                *shares_words(outcome),
                *next_words(outcome),
            ],
            points=[line.strip() for line in doubt_words(outcome)],
        ),
        Section(
            places_words(outcome),
            [] if outcome.where else ["Nowhere by more than the noise."],
            points=[where_words(p) for p in outcome.where],
            figures=_residuals(outcome),
        ),
        *_learned(outcome),
        _which(outcome),
        _parameters(outcome),
        Section(
            "What these data cannot show", [], points=[x.strip() for x in limits_words(outcome)]
        ),
        _methods(outcome),
    ]
    subtitle = f"{title}: {_MARK}" if title else _MARK
    return page("What is missing in the model", sections, subtitle=subtitle)


def _parameters(outcome: Outcome) -> Section:
    heading = "Parameters before and after" if outcome.verdict.explanations else "Parameters"
    return Section(heading, [values_words(outcome)], tables=[Table(*parameter_table(outcome))])


def _learned(outcome: Outcome) -> list[Section]:
    """Return the function that was learned, with its band; nothing where none was."""
    learned = outcome.learned
    if learned is None:
        return []
    one = learned.family
    with style():
        source = to_data_uri(draw_function(outcome), "png")
    picture = Illustration(
        source,
        f"{one.y_name} against {one.x_name}: the median, and a band that holds 90 %.",
        "What was learned. Line: median. Band: 90 %.",
    )
    rows = Table([one.x_name, one.y_name, "90 %"], function_rows(outcome))
    return [
        Section(
            "What was learned",
            [f"{one.meaning}: {one.formula}."],
            tables=[rows],
            figures=[picture],
        )
    ]


def draw_function(outcome: Outcome) -> Figure:
    """Return the learned function with its band; called in `style()`."""
    learned = outcome.learned
    assert learned is not None
    figure = new_figure(6.0, 3.2)
    ax = figure.subplots()
    few = len(learned.x) <= _FEW
    ax.fill_between(learned.x, learned.low, learned.high, color="0.85", label="90 %")
    ax.plot(learned.x, learned.y, "o-" if few else "-", label="median")
    if few and learned.x.max() > _WIDE * learned.x.min():
        ax.set_xscale("log")
    ax.set_xlabel(learned.family.x_name)
    ax.set_ylabel(learned.family.y_name)
    ax.legend()
    return figure


def _which(outcome: Outcome) -> Section:
    own = set(outcome.found.base.effects)
    candidates = outcome.found.candidates
    rows = [
        [
            explanation_words(c, own),
            odds,
            "yes" if c.adequate else "no",
            chance_words(c.left.p_value),
        ]
        for c, odds in zip(candidates, each_behind(behind_best(candidates, own)), strict=True)
    ]
    screen = [
        [effect_words(s.effect), f"{s.gain:z.0f}", f"{100 * s.absorbed:z.0f} %"]
        for s in sorted(outcome.found.signatures.values(), key=lambda s: -s.gain)
    ]
    tables = [
        Table(
            ["effect", "misfit (χ²) it could explain", "of it hidden in the law's parameters"],
            screen,
            "Screen: every effect's signature against what is left",
        )
    ]
    if rows and outcome.verdict.name != "none":  # there they are behind none at all
        tables.insert(
            0,
            Table(
                ["explanation", "how likely", "explains the data", "what it leaves"],
                rows,
                "Explanations that were fitted",
            ),
        )
    meanings = [
        f"{e}: {get_effect(e).meaning}; {get_effect(e).formula}."
        for c in outcome.verdict.explanations
        for e in c.effects
    ]
    return Section("Which effect", points=meanings, tables=tables)


def _methods(outcome: Outcome) -> Section:
    records = outcome.found.records
    data = [
        [
            r.name,
            f"{r.geometry.aperture_mm:g}",
            f"{r.geometry.thickness_mm:g}",
            str(r.curve.setup.program or "read from the pressure"),
            str(r.curve.setup.cycle),
            str(len(r.curve)),
            f"{r.noise_um:.2f}",
        ]
        for r in records
    ]
    return Section(
        "Data, method and limits",
        [
            "All samples of all curves are fitted together, by finite elements on the mesh of "
            "record; errors are the sensor's noise, the pressure's noise through the slope of the "
            "curve, and the mesh's own error, whose size was measured. Evidence is Laplace's "
            "approximation, with priors as wide as three typical sizes of each effect; one effect "
            "is as likely beforehand as any other, none at all as likely as all together.",
            "An effect that is not in the library cannot be named, and one that the data cannot "
            "tell from the law's parameters cannot be seen: the section before says what "
            "could have been.",
        ],
        tables=[
            Table(
                ["curve", "aperture mm", "thickness mm", "program", "cycle", "samples", "noise µm"],
                data,
            ),
        ],
    )


def _residuals(outcome: Outcome) -> list[Illustration]:
    with style():
        source = to_data_uri(draw_residuals(outcome), "png")
    fits = "before and after the effect was added"
    if outcome.verdict.name == "ambiguous":
        fits = f"of the model as it is, and {explained_by(outcome)[0][0]}"
    if not outcome.verdict.explanations:
        fits = "of the model as it is"
    return [
        Illustration(
            source,
            f"Residuals of every curve against time, {fits}; a grey band shows twice the noise.",
            "Measured minus fitted deflection. Grey: twice the noise.",
        )
    ]


def draw_residuals(outcome: Outcome) -> Figure:
    """Return residuals of every curve, before and after, against time; called in `style()`."""
    fits: list[tuple[str, Fit]] = [("the model as it is", outcome.found.base.fit)]
    if outcome.verdict.explanations:
        after, best = explained_by(outcome)[0]
        fits = [("before", outcome.found.base.fit), (after, best.fit)]
    records = outcome.found.records
    columns = 2
    rows = (len(records) + 1) // columns
    figure = new_figure(9.0, 2.2 * rows + 0.6)
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for i, record in enumerate(records):
        ax = axes[i]
        time = record.curve.time_s
        ax.axhspan(-2 * record.noise_um, 2 * record.noise_um, color="0.88", zorder=0)
        for name, fit in fits:
            left = 1e3 * (record.at_pressure_mm - fit.deflections_mm[i])
            ax.plot(time, left, ".", markersize=2.5, label=name)
        ax.set_title(inert(record.name), parse_math=False)
        ax.set_xlabel("time (s)")
        ax.set_ylabel("residual (µm)")
    for ax in axes[len(records) :]:
        ax.set_visible(False)
    axes[0].legend()
    return figure
