"""What the missing-effect screen says and draws, as pure functions: rows of (text, style).

Styles are `text`, `strong`, `quiet`, `before`, `after` and `band`. The workflow is slow to import,
and is imported where there is an outcome.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from skinlab.discrepancy.odds import each_behind, odds_words
from skinlab.inference.result import Value
from skinlab.mechanics.names import parameter_of, plain
from skinlab.report.rounding import best_words, interval_words
from skinlab.tui.canvas import Bits, dots, runs, share
from skinlab.tui.curve_drawing import Run
from skinlab.tui.plot_data import round_up
from skinlab.tui.value_text import digits, meaning, name_of, scaled_bar, shortened, value_scale

if TYPE_CHECKING:
    from skinlab.discrepancy.candidates import Candidate
    from skinlab.discrepancy.outcome import Outcome
    from skinlab.tui.shown import Missing

_MOST = 5  # places, and candidates, that are told
_NOISE = 2.0  # standard deviations of the band
_DECADES = 4.0  # of evidence, over which the bars of explanations shrink to nothing
_PANEL_COLUMNS = 30  # of a small picture, at least
_PANEL_ROWS = (3, 8)  # of residuals in it, as the screen has room
_BAR = (10, 30)
_BAR_SAYS = 48  # columns of the words behind a bar

Rows = list[list[Run]]


def outcome_rows(outcome: Outcome, columns: int, lines: int = 0) -> Rows:
    """Return the whole answer: what is missing, pictures, how sure that is, values, limits.

    The pictures grow until a screen of so many `lines` is filled.
    """
    from skinlab.discrepancy.text import (
        alike_words,
        doubt_words,
        limits_words,
        places_words,
        repeats_words,
        where_words,
    )  # fmt: skip

    rows: Rows = [[(line, "strong")] for line in repeats_words(outcome) + verdict_lines(outcome)]
    rows += [[(line, "text")] for line in next_lines(outcome)]
    rows += _function_rows(outcome, columns)
    behind = [*_candidate_rows(outcome, columns), *_share_rows(outcome)]
    behind += [[(line, "quiet")] for line in doubt_words(outcome)]
    behind += [[], *_value_rows(outcome, columns)]
    rows += [[], *_multiples(outcome, columns, lines - len(rows) - len(behind))]
    rows += behind
    if outcome.where:
        rows += [[], [(f"{places_words(outcome)}:", "quiet")]]
        rows += [[(f"  {where_words(place)}", "quiet")] for place in outcome.where[:_MOST]]
    rows += [[], *([(line, "quiet")] for line in limits_words(outcome, _least_words))]
    for line in alike_words(outcome):
        rows += [[], [(line, "quiet")]]
    return rows


def verdict_lines(outcome: Outcome) -> list[str]:
    """Return the verdict in a sentence with its doubt, the effect's size, and the gap.

    Where explanations are tied, the size of each.
    """
    from skinlab.discrepancy.text import (
        gap_words,
        lead_words,
        stated_noise_words,
        verdict_words,
    )

    lines = [" ".join([verdict_words(outcome), *lead_words(outcome)])]
    if outcome.learned is None:
        lines += [_effect_size_words(outcome, c) for c in outcome.verdict.explanations[:_MOST]]
    return [*lines, gap_words(outcome), *stated_noise_words(outcome)]


def _effect_size_words(outcome: Outcome, explanation: Candidate) -> str:
    """Return the size of what an explanation adds to the model, and not of the model's own."""
    added = [effect for effect in explanation.effects if effect not in outcome.found.base.effects]
    sizes = [
        f"{plain(name)[0]} {size_words(name, Value(**value))}, {meaning(name)}"
        for name, value in outcome.parameters(explanation).items()
        if name.partition(".")[0] in added
    ]
    whose = "Its size" if len(added) == 1 else "Their sizes"
    if len(outcome.verdict.explanations) > 1:
        whose = f"Its size, if it is {' and '.join(added)}"
    return f"{whose}: {'; '.join(sizes)}."


def next_lines(outcome: Outcome) -> list[str]:
    """Return the one next step, with its key."""
    following = outcome.next_measurement
    if following is not None:
        times = f", put on {following.placements} times" if following.placements > 1 else ""
        lines = [
            f"Next: F7 loads {following.program} through {following.aperture_mm:g} mm{times}, "
            f"expected to make one explanation {odds_words(following.expected_log10_evidence)} "
            "likelier."
        ]
        from skinlab.discrepancy.text import next_words

        return lines + next_words(outcome)[1:]
    if outcome.verdict.explains:
        return ["Next: a adopts the model with it; it asks first."]
    if outcome.verdict.name == "none":
        return ["Next: b goes back; nothing has to be done."]
    return ["Next: measure through another opening, or with a hold, then d looks again."]


_SMALL = {"s": ("ms", 1e3, 0.5), "mm": ("µm", 1e3, 0.2)}  # below this, in the smaller unit


def size_words(name: str, value: Value) -> str:
    """Return a value with its unit and interval, in the unit that suits: 23 ms (17–28)."""
    declared = parameter_of(name)
    unit = "" if declared is None else declared.unit
    largest = max(abs(value.value), abs(value.low or 0.0), abs(value.high or 0.0))
    if unit in _SMALL and largest < _SMALL[unit][2]:
        unit, scale, _ = _SMALL[unit]
        ends = [None if x is None else x * scale for x in (value.low, value.high)]
        value = Value(value.value * scale, *ends)
    words = f"{best_words(value)}{unit and ' '}{unit}"
    return words if value.low is None else f"{words} ({interval_words(value)})"


def _least_words(name: str, size: float) -> str:
    """Return a size that could have been shown: 4.00 ms."""
    return size_words(name, Value(size, None, None))


def _function_rows(outcome: Outcome, columns: int) -> Rows:
    """Return the learned function with its band as a small picture."""
    learned = outcome.learned
    if learned is None:
        return []
    from skinlab.discrepancy.text import learned_words

    low, high = float(learned.low.min()), float(learned.high.max())
    width, height = min(columns - 4, 2 * _BAR[1]), 2 * _PANEL_ROWS[0]
    x = np.linspace(learned.x[0], learned.x[-1], 2 * width)
    at = share(x, learned.x[0], learned.x[-1])

    def drawn(y: np.ndarray) -> Bits:
        return dots(at, share(np.interp(x, learned.x, y), low, high), width, height)

    one = learned.family
    title = (
        f"{one.y_name} ({low:.3g} to {high:.3g}) by {one.x_name} "
        f"({learned.x[0]:.3g} to {learned.x[-1]:.3g}), with the ends of its 90 % band"
    )
    rows: Rows = [[(line, "text")] for line in learned_words(outcome)]
    rows += [[], [(title, "quiet")]]
    pictures = (drawn(learned.y), drawn(learned.low) | drawn(learned.high))
    return rows + [
        [(text, ("after", "band")[layer]) for text, layer in row] for row in runs(pictures)
    ]


def _candidate_rows(outcome: Outcome, columns: int) -> Rows:
    candidates = outcome.found.candidates
    if outcome.verdict.name == "none" or not candidates:
        return []
    from skinlab.discrepancy.candidates import behind_best
    from skinlab.discrepancy.text import explanation_words

    own = set(outcome.found.base.effects)
    behind = behind_best(candidates, own)
    rows: Rows = [[], [("Explanations, by how likely they are:", "quiet")]]
    whole = min(max(columns - 4 - _BAR_SAYS, _BAR[0]), _BAR[1])
    each = zip(behind, each_behind(behind), strict=True)
    for c, (decades, odds) in zip(candidates[:_MOST], each, strict=False):
        length = 0 if decades is None else round(whole * max(1.0 - decades / _DECADES, 0.0))
        fits = "" if c.adequate else ", leaves more than noise"
        rows.append([(f" {explanation_words(c, own)}", "text")])
        rows.append(
            [
                ("   ", "text"),
                ("█" * length or "▏", "after" if c.adequate else "before"),
                (f" {odds}{fits}", "quiet"),
            ]
        )
    return rows


def _share_rows(outcome: Outcome) -> Rows:
    """Return what the gap is made of, as shares of its mean square."""
    if outcome.shares is None:
        return []
    squares = [
        ("░", "band", "noise", outcome.shares.noise_um**2),
        ("▒", "before", "placement", outcome.shares.placement_um**2),
        ("▓", "quiet", "mesh", outcome.shares.mesh_um**2),
        ("█", "after", "the effect", outcome.shares.effect_um**2),
    ]
    whole = sum(square for *_, square in squares)
    if not whole > 0:
        return []
    bar: list[Run] = [(" ", "text")]
    ends = np.cumsum([0.0, *(square for *_, square in squares)]) / whole
    cells = np.round(ends * _BAR[1]).astype(int)
    for (cell, style, *_), begin, end in zip(squares, cells[:-1], cells[1:], strict=True):
        bar.append((cell * int(end - begin), style))
    parts = [(c, what, round(100 * x / whole)) for c, _, what, x in squares]
    words = ", ".join(f"{c} {what} {percent} %" for c, what, percent in parts if percent)
    return [
        [],
        [("What the gap is made of:", "quiet")],
        [*bar, (f" {words}", "quiet")],
    ]


def _value_rows(outcome: Outcome, columns: int) -> Rows:
    """Return what the model has, its own effects too, before and after, on one scale each."""
    from skinlab.discrepancy.text import explained_by

    before = outcome.parameters(outcome.found.base)
    found_by = [(words, outcome.parameters(one)) for words, one in explained_by(outcome)]
    rows: Rows = [[("Values, with 90 % intervals:", "quiet")]]
    if len(found_by) > 1:
        rows[0] = [("Values, with 90 % intervals; which explanation is true is open:", "quiet")]
    longest = max(7, *(len(words) for words, _ in found_by)) if found_by else 7
    for name in before:
        pairs = [("before", before[name])]
        pairs += [(words, after[name]) for words, after in found_by if name in after]
        values = [(when, Value(**found)) for when, found in pairs]
        ends = [x for _, v in values for x in (v.low, v.high) if x is not None]
        rows.append([(f" {name_of(name)} {meaning(name)}", "text")])
        low, high, logarithmic = value_scale(name, ends or [values[0][1].value])
        left, right = f"{low:g} ", f" {high:g} "
        width = min(columns - 3 - longest - len(left) - len(right) - 26, 2 * _BAR[1])
        for when, value in values:
            row = [(f"  {when:<{longest}} " if len(values) > 1 else "  ", "quiet")]
            if width >= 8 and value.low is not None:
                drawn = scaled_bar(value, low, high, width, logarithmic=logarithmic)
                style = "before" if when == "before" else "after"
                row += [(left, "quiet"), (drawn, style), (right, "quiet")]
            rows.append([*row, (size_words(name, value), "text")])
    return rows


# ---- small pictures ---------------------------------------------------------------------------


def _multiples(outcome: Outcome, columns: int, lines: int) -> Rows:
    """Return the residuals of each curve, before and after, on one scale; noise shaded."""
    from skinlab.discrepancy.text import explained_by

    fits = [("before", outcome.found.base.fit)]
    fits += [(words, one.fit) for words, one in explained_by(outcome)[:1]]
    records = outcome.found.records
    across = max(1, min(columns // (_PANEL_COLUMNS + 2), len(records)))
    width = max(columns // across - 2, 8)
    deep = -(
        -len(records) // across
    )  # rows of panels: each has a title, and a caption for each fit
    room = (lines - 2 - deep) // (deep * len(fits)) - 1
    height = min(max(room, _PANEL_ROWS[0]), _PANEL_ROWS[1])
    lefts = {
        name: [
            1e3 * (record.at_pressure_mm - w)
            for record, w in zip(records, fit.deflections_mm, strict=True)
        ]
        for name, fit in fits
    }
    noise_um = [record.noise_um for record in records]
    largest = max(float(np.abs(x).max(initial=0.0)) for some in lefts.values() for x in some)
    most_um = round_up(1.05 * max(largest, _NOISE * max(noise_um)), least=0.1)
    title = f"What each curve leaves, all to ±{most_um:g} µm; shaded: twice the noise"
    rows: Rows = [[(title, "quiet")]]
    panels = [
        _panel(
            f"{record.name}, {record.geometry.aperture_mm:g} mm",
            [(name, lefts[name][i]) for name, _ in fits],
            most_um,
            noise_um[i],
            width,
            height,
        )
        for i, record in enumerate(records)
    ]
    for begin in range(0, len(panels), across):
        for line in zip(*panels[begin : begin + across], strict=True):
            rows.append([run for part in line for run in (*part, ("  ", "text"))])
    return rows


def _panel(
    title: str,
    residuals: Sequence[tuple[str, np.ndarray]],
    most_um: float,
    noise_um: float,
    width: int,
    height: int,
) -> Rows:
    rows: Rows = [[(shortened(title, width).ljust(width), "text")]]
    for name, left_um in residuals:
        rms = float(np.sqrt(np.mean(np.square(left_um)))) if len(left_um) else math.nan
        when = f"{name}: " if len(residuals) > 1 else ""  # else nothing was before or after
        caption = f"{when}{digits(rms, 2)} µm rms"
        rows.append([(shortened(caption, width).ljust(width), "quiet")])
        at = (np.arange(len(left_um)) + 0.5) / max(len(left_um), 1)
        style = "before" if name == "before" else "after"
        main = dots(at, share(left_um, -most_um, most_um), width, height)
        band = _shade(_NOISE * noise_um / most_um, width, height)
        rows += [
            [(text, (style, "band")[layer]) for text, layer in row] for row in runs((main, band))
        ]
    return rows


def _shade(reach: float, width: int, height: int) -> Bits:
    """Return sparse dots over all that lies within `reach` (of the half height) of zero."""
    up = (np.arange(4 * height) + 0.5) / (4 * height)
    up = up[np.abs(2 * up - 1) <= max(reach, 0.5 / height)]
    across = (np.arange(0, 2 * width, 3) + 0.5) / (2 * width)
    x, y = np.meshgrid(across, up[::2])
    return dots(x.ravel(), y.ravel(), width, height)


# ---- all of it --------------------------------------------------------------------------------


def missing_rows(missing: Missing | None, columns: int, lines: int = 0) -> Rows:
    """Return all that there is to say at this moment, for a screen of so many columns and lines."""
    if missing is None:
        return [[("No curve has been looked at yet: d begins.", "text")]]
    looked: list[Run] = [(f"Looked at: {', '.join(missing.curves)}", "quiet")]
    if missing.outcome is not None:
        rows = outcome_rows(missing.outcome, columns, lines)
        if missing.adopted is not None:
            said = f"Adopted: {missing.adopted} (Ctrl+Z goes back to the model before)"
            rows = [[(said, "strong")], *rows]
        return [*rows, [], looked]
    done, last = missing.stages[:-1], missing.stages[-1:]
    rows = [looked, *([(f"  done: {stage}", "quiet")] for stage in done)]
    if missing.running:
        rows += [[(f"  now:  {stage} …", "text")] for stage in last or ["beginning"]]
        said = "This can take minutes. The probe can be used meanwhile; Del gives up."
        return [*rows, [], [(said, "text")]]
    return [*rows, [], [(missing.failed or "Given up; d begins anew.", "text")]]


def hints(missing: Missing | None) -> tuple[bool, bool]:
    """Return whether there is a measurement to load, and a model to adopt."""
    outcome = None if missing is None else missing.outcome
    if outcome is None or missing is None:
        return False, False
    named = outcome.verdict.explains and missing.adopted is None
    return outcome.next_measurement is not None, named
