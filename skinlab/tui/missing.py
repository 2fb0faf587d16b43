"""What the missing-effect screen says and draws, as pure functions.

The workflow is slow to import, and is imported where there is an outcome.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skinlab.mechanics.names import is_effects
from skinlab.tui.canvas import Bits, dots, level, share
from skinlab.tui.plot_data import round_up
from skinlab.tui.text import digits, name_of

if TYPE_CHECKING:
    from skinlab.discrepancy.fit import Fit
    from skinlab.discrepancy.outcome import Outcome
    from skinlab.discrepancy.search import Candidate
    from skinlab.tui.ui_state import Missing

_MOST = 5  # places, and candidates, that are told
_NOISE = 2.0  # standard deviations of the band
_VALUE = 26  # cells of a value with its interval


def outcome_lines(outcome: Outcome) -> list[str]:
    """Return verdict, gap, where, which, parameters before and after, and what to measure next."""
    from skinlab.discrepancy.text import (
        gap_words,
        limits_words,
        next_words,
        verdict_words,
        where_words,
    )

    lines = [verdict_words(outcome), gap_words(outcome), *next_words(outcome)]
    if outcome.where:
        lines += ["", "Where the model as it is disagrees:"]
        lines += [f"  {where_words(place)}" for place in outcome.where[:_MOST]]
    candidates = outcome.found.candidates
    if outcome.verdict.name != "none" and candidates:
        lines += ["", "Which explanations were tried (log10 evidence, the best has 0):"]
        best = candidates[0].log10_evidence
        for c in candidates[:_MOST]:
            fits = "explains the data" if c.adequate else "does not explain the data"
            lines.append(f"  {_effects(c, outcome):<30}{c.log10_evidence - best:9.1f}  {fits}")
    lines += ["", *_parameter_lines(outcome)]
    lines += ["", *limits_words(outcome)]
    if outcome.alike:
        pairs = "; ".join(f"{a} and {b}" for a, b in outcome.alike)
        lines += ["", f"With these measurements nobody could tell apart: {pairs}."]
    return lines


def _effects(candidate: Candidate, outcome: Outcome) -> str:
    own = set(outcome.found.base.effects)
    return " and ".join(e for e in candidate.effects if e not in own)


def _parameter_lines(outcome: Outcome) -> list[str]:
    before = outcome.parameters(outcome.found.base)
    after = outcome.parameters(outcome.best) if outcome.verdict.explanations else {}
    title = f"{'':<10}{'before':<{_VALUE}}{'after' if after else ''}"
    lines = [title.rstrip()]
    for name in sorted({**before, **after}, key=is_effects):  # the law's first
        label = name_of(name)
        values = f"{_value(before.get(name)):<{_VALUE}}{_value(after.get(name))}".rstrip()
        if len(label) < 10:
            lines.append(f"{label:<10}{values}")
        else:
            lines += [label, f"{'':<10}{values}"]
    return lines


def _value(value: dict[str, float] | None) -> str:
    if value is None:
        return ""
    low, high = digits(value["low"], 3), digits(value["high"], 3)
    return f"{digits(value['value'], 4)} ({low}–{high})"


def missing_lines(missing: Missing | None) -> list[str]:
    """Return all that there is to say at this moment."""
    if missing is None:
        return ["No curve has been looked at yet: d begins."]
    lines = [f"Looked at: {', '.join(missing.curves)}"]
    if missing.outcome is not None:
        lines += ["", *outcome_lines(missing.outcome)]
        if missing.adopted is not None:
            lines += ["", f"Adopted: {missing.adopted} (Ctrl+Z goes back to the model before)"]
        return lines
    done, last = missing.stages[:-1], missing.stages[-1:]
    lines += [f"  done: {stage}" for stage in done]
    if missing.running:
        lines += [f"  now:  {stage} …" for stage in last or ["beginning"]]
        lines += ["", "This can take minutes. The probe can be used meanwhile; Del gives up."]
    else:
        lines += ["", missing.failed or "Given up; d begins anew."]
    return lines


def hints(missing: Missing | None) -> tuple[bool, bool]:
    """Return whether there is a measurement to load, and a model to adopt."""
    outcome = None if missing is None else missing.outcome
    if outcome is None or missing is None:
        return False, False
    named = outcome.verdict.name == "named" and missing.adopted is None
    return outcome.next_measurement is not None, named


def residual_picture(outcome: Outcome, columns: int, rows: int) -> list[tuple[str, Bits, Bits]]:
    """Return (caption, residuals, noise band) before and after; curves side by side, in order.

    One scale for both: what the effect takes away can be seen.
    """
    fits = [("before", outcome.found.base.fit)]
    if outcome.verdict.explanations:
        fits.append(("after", outcome.best.fit))
    records = outcome.found.records
    noise_um = float(np.sqrt(np.mean([r.noise_um**2 for r in records])))
    lefts = [_left_um(outcome, fit) for _, fit in fits]
    largest = max(float(np.abs(left).max()) for left in lefts)
    most_um = round_up(1.05 * max(largest, _NOISE * noise_um), least=0.1)
    ends = np.cumsum([len(r.curve) for r in records])
    at = (np.arange(ends[-1]) + 0.5) / ends[-1]
    band = level(float(share(_NOISE * noise_um, -most_um, most_um)), columns, rows)
    band = band | level(float(share(-_NOISE * noise_um, -most_um, most_um)), columns, rows)
    for end in ends[:-1]:  # where one curve ends and the next begins
        up = (np.arange(0, 4 * rows, 2) + 0.5) / max(4 * rows, 1)
        band = band | dots(np.full(len(up), end / ends[-1]), up, columns, rows)
    pictures = []
    for (name, _), left in zip(fits, lefts, strict=True):
        rms = float(np.sqrt(np.mean(left**2)))
        caption = (
            f"residual {name}, µm, of ±{most_um:g}: rms {digits(rms, 3)}, "
            f"dotted: noise ±{digits(_NOISE * noise_um, 2)}"
        )
        pictures.append((caption, dots(at, share(left, -most_um, most_um), columns, rows), band))
    return pictures


def _left_um(outcome: Outcome, fit: Fit) -> np.ndarray:
    """Return measured less fitted deflection, µm, of all samples (n,)."""
    return np.concatenate(
        [
            1e3 * (record.curve.deflection_mm - w)
            for record, w in zip(outcome.found.records, fit.deflections_mm, strict=True)
        ]
    )
