"""Has a skin changed? Two sessions, and what else than the skin makes two sessions differ.

The curves' own noise is the least of it: the probe is placed anew, on another day, by another hand.
A study of repeats says how much each adds (`components.csv`). Without one the scatter of placements
is learned from the sessions' own repeats with a prior around published values (docs/study.md), and
what a visit adds stays unknown. A second site that was left alone takes away what visit, operator
and probe have in common. Curves that were fitted together have placements in their interval
already: that share is taken out, so that they count once.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as t_distribution

from drivers.reading import read_whole
from skinlab.curves.curve import Curve
from skinlab.curves.placement import placements_of
from skinlab.errors import InputError
from skinlab.inference.result import Identification
from skinlab.io.documents import text_of
from skinlab.mechanics.names import plain
from skinlab.recording.audit import entries
from skinlab.recording.session import Session
from skinlab.recording.session_fit import comparable, excluded_of
from skinlab.studies.analysis import main_scale
from skinlab.studies.design import WITHIN
from skinlab.studies.settings import CHANGES
from skinlab.text import counted

Array = NDArray[np.float64]
Verdict = Literal["changed", "not_shown", "cannot_say"]


_NORMAL_95 = 1.645
Estimate = tuple[float, float]  # a variance, and the degrees of freedom behind it


@dataclass(frozen=True)
class Scatter:
    """What one quantity scatters by, on its main scale."""

    placed: Estimate  # one placement, mostly without the identification's own share
    source: str
    visit: Estimate | None = None  # None: unknown
    operator: Estimate = (0.0, 1.0)
    probe: Estimate = (0.0, 1.0)


@dataclass(frozen=True)
class Side:
    """One session: its joint answer, how often the probe was placed, by whom, and which."""

    answer: Identification
    placements: int
    operator: str
    probe: str
    conditions: frozenset[tuple[float, str]]

    @property
    def placed(self) -> float:
        """Variance of log stiffness that placements have in the answer; 0 of a curve alone."""
        found = self.answer.placement
        if found is None or not found.scatter["value"]:
            return 0.0
        middle, high = found.scatter["value"], found.scatter["high"]
        wide = math.log(high / middle) / _NORMAL_95  # a scatter is about log-normal
        return middle**2 * math.exp(2.0 * wide**2) / found.count

    @property
    def site_words(self) -> str:
        """How it was measured."""
        return ", ".join(f"{a:g} mm {p}" for a, p in sorted(self.conditions))


@dataclass(frozen=True)
class Changed:
    """One parameter: the change (a log ratio, or a difference), and what could have been shown."""

    name: str
    scale: str
    change: float
    low: float
    high: float
    smallest: float  # change that could have been shown, on the same scale
    verdict: Verdict

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data; a log ratio as per cent."""
        logs = self.scale == "log"
        values = [self.change, self.low, self.high, self.smallest]
        if logs:
            values = [100.0 * math.expm1(min(v, 20.0)) for v in values]
        change, low, high, smallest = values
        return {
            "verdict": self.verdict,
            "change": change,
            "low": low,
            "high": high,
            "smallest_shown": smallest,
            "unit": "%" if logs else "1",
        }


@dataclass(frozen=True)
class Changes:
    """All parameters, and what the judgement rests on.

    `stiffness` is a factor common to all stiffnesses of the law: curves tell it far better than any
    single one of them. None where the law has but one.
    """

    parameters: tuple[Changed, ...]
    stiffness: Changed | None
    basis: str
    paired: bool
    level: float = CHANGES.level

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "level": self.level,
            "basis": self.basis,
            "paired": self.paired,
            "parameters": {c.name: c.to_json() for c in self.parameters},
            "stiffness": None if self.stiffness is None else self.stiffness.to_json(),
        }


def condition(curve: Curve) -> tuple[float, str]:
    """Return what must be alike in two visits: opening (mm) and program."""
    return (curve.setup.aperture_mm, str(curve.setup.program or ""))


def side_of(
    session: Session,
    answer: Identification,
    conditions: frozenset[tuple[float, str]] | None = None,
) -> Side:
    """Return what a session gives for the comparison; of these conditions only, where given."""
    kept = [
        curve
        for curve in comparable(session.curves, excluded_of(session))
        if conditions is None or condition(curve) in conditions
    ]
    instrument = session.meta.get("instrument")
    return Side(
        answer,
        len(set(placements_of(kept))),
        next((e.who for e in entries(session.records)), ""),
        str(instrument.get("serial_number", "")) if isinstance(instrument, dict) else "",
        frozenset(map(condition, kept)),
    )


def changes(
    before: Side,
    after: Side,
    *,
    study: Path | None = None,
    control: tuple[Side, Side] | None = None,
    placement_scatter: float | None = None,
    relevant_percent: float = CHANGES.relevant_percent,
) -> Changes:
    """Return whether each parameter changed.

    `placement_scatter` is a standard deviation of log stiffness that is known; None: of the study,
    or learned from the repeats.

    Raises:
        InputError: an answer has no intervals, parameters differ, or the study is of another
            opening or program.
    """
    sides = [before, after, *(control or ())]
    parts = [_moments(side.answer) for side in sides]
    if any(list(p) != list(parts[0]) for p in parts):
        raise InputError("the sessions have different parameters")
    for first, last, whose in (
        (before, after, ""),
        *([(*control, "control site ")] if control else []),
    ):
        if first.conditions != last.conditions:
            raise InputError(
                f"{whose}measured differently: {first.site_words} before, {last.site_words} after; "
                "expected the same openings and programs"
            )
    signs = (-1.0, 1.0) if control is None else (-1.0, 1.0, 1.0, -1.0)
    found = []
    basis = ""
    for name in parts[0]:
        scatter = _scatter(name, sides, study, placement_scatter)
        basis = scatter.source
        change = sum(s * p[name][0] for s, p in zip(signs, parts, strict=True))
        logs = main_scale(name) == "log"
        own = sum(
            max(p[name][1] - logs * side.placed, 0.0) for side, p in zip(sides, parts, strict=True)
        )
        found.append(_judged(name, change, own, scatter, sides, relevant_percent))
    stiffness = None
    names = [n for n in parts[0] if main_scale(n) == "log"]
    if len(names) > 1:
        change, own = _common(sides, signs, list(parts[0]), names)
        own = max(own - sum(side.placed for side in sides), 0.0)
        # Curves leave each stiffness more open than their common factor: what intervals explain of
        # a parameter's scatter they need not explain of this one's.
        whole = [_scatter(n, sides, study, placement_scatter, whole=True) for n in names]
        scatter = min(whole, key=lambda one: one.placed[0])
        stiffness = _judged("stiffness", change, own, scatter, sides, relevant_percent, "log")
    return Changes(tuple(found), stiffness, basis, control is not None)


def _judged(
    name: str,
    change: float,
    own: float,
    scatter: Scatter,
    sides: Sequence[Side],
    relevant_percent: float,
    scale: str | None = None,
) -> Changed:
    """Return the verdict on a change whose curves' own variance is `own`."""
    paired = len(sides) > 2
    parts = [(sum(1.0 / side.placements for side in sides), scatter.placed)]
    if not paired:  # at a control site the same visit, operator and probe add the same
        before, after = sides
        parts += [(2.0, scatter.visit)] if scatter.visit else []
        parts += [(2.0, scatter.operator)] if before.operator != after.operator else []
        parts += [(2.0, scatter.probe)] if before.probe != after.probe else []
    variance = own + sum(times * size for times, (size, _) in parts)
    quantile = float(t_distribution.ppf(0.5 + CHANGES.level / 2, _freedom(parts)))
    reach = quantile * math.sqrt(variance)
    scale = scale or main_scale(name)
    relevant = math.log1p(relevant_percent / 100) if scale == "log" else CHANGES.relevant_linear
    verdict: Verdict = "cannot_say"
    if abs(change) > reach:
        verdict = "changed"
    elif reach <= relevant:
        verdict = "not_shown"
    if verdict == "changed" and scatter.visit is None and not paired:
        # What a visit adds is not known: as much again as a placement may be in it.
        extra = variance + 2.0 * scatter.placed[0]
        if abs(change) <= reach * math.sqrt(extra / variance):
            verdict = "cannot_say"
    return Changed(name, scale, change, change - reach, change + reach, reach, verdict)


def _freedom(parts: Sequence[tuple[float, Estimate]]) -> float:
    """Return the degrees of freedom of a sum of so many times each variance (Satterthwaite 1946).

    Two operators of a study are one degree of freedom: where they differ, little is known of it.
    """
    total = sum(times * size for times, (size, _) in parts)
    if not total > 0:
        return min(freedom for _, (_, freedom) in parts)
    return total**2 / sum((times * size) ** 2 / freedom for times, (size, freedom) in parts)


def _common(
    sides: Sequence[Side], signs: Sequence[float], names: Sequence[str], logs: Sequence[str]
) -> tuple[float, float]:
    """Return the factor common to these parameters, as a logarithm, and its own variance.

    By generalised least squares, with all other parameters as they were.
    """
    difference = np.zeros(len(names))
    covariance = np.zeros((len(names), len(names)))
    for side, sign in zip(sides, signs, strict=True):
        left = side.answer.uncertainty
        assert left is not None
        x, w = left.draws.parameters[:, : len(names)], left.draws.weight
        z = np.column_stack(
            [np.log(c) if main_scale(n) == "log" else c for n, c in zip(names, x.T, strict=True)]
        )
        mean = w @ z
        difference += sign * mean
        covariance += (w[:, None] * (z - mean)).T @ (z - mean)
    along = np.array([float(n in logs) for n in names])
    scale = np.sqrt(np.diag(covariance))
    inverse = np.linalg.pinv(covariance / np.outer(scale, scale), hermitian=True)
    inverse = inverse / np.outer(scale, scale)
    information = float(along @ inverse @ along)
    return float(along @ inverse @ difference) / information, 1.0 / information


def _moments(answer: Identification) -> dict[str, tuple[float, float]]:
    """Return mean and variance of each parameter's posterior, on its main scale."""
    left = answer.uncertainty
    if left is None or answer.parameters is None:
        why = answer.error or "the method gives no intervals"
        raise InputError(f"{answer.file}: nothing to compare ({why})")
    found = {}
    for i, name in enumerate(answer.parameters):
        x, w = left.draws.parameters[:, i], left.draws.weight
        y = np.log(x) if main_scale(name) == "log" else x
        mean = float(w @ y)
        found[name] = mean, float(w @ np.square(y - mean))
    return found


def _scatter(
    name: str,
    sides: Sequence[Side],
    study: Path | None,
    stated: float | None,
    *,
    whole: bool = False,
) -> Scatter:
    """Return what a quantity scatters by; `whole`: the identification's own share left in."""
    if study is not None:
        return _of_study(name, sides[0], study, whole=whole)
    if stated is not None:
        source = f"a placement scatter of {100 * stated:g} %, stated; what a visit adds is unknown"
        return Scatter((stated**2, 1e6), source)
    logs = main_scale(name) == "log"
    prior = CHANGES.prior_sd if logs else CHANGES.prior_sd_linear
    squares, freedom = 0.0, 0
    for found in (side.answer.placement for side in sides):
        if logs and found is not None:  # they move all stiffnesses alike, and nothing else
            squares += found.scatter["value"] ** 2 * (found.count - 1)
            freedom += found.count - 1
    variance = (CHANGES.prior_freedom * prior**2 + squares) / (CHANGES.prior_freedom + freedom)
    source = (
        f"published scatter of placements and {counted(_repeats(sides), 'repeat')} in these "
        "sessions; what a visit adds is unknown (--study FOLDER says it)"
    )
    return Scatter((variance, CHANGES.prior_freedom + freedom), source)


def _repeats(sides: Sequence[Side]) -> int:
    """Return how many placements tell, beyond the first of each session, how these scatter."""
    return sum(p.count - 1 for side in sides if (p := side.answer.placement) is not None)


def components_of(study: Path) -> tuple[Path, list[dict[str, str]]]:
    """Return the components of variance of a study's folder, or such a file: its path, its rows.

    Raises:
        InputError: it cannot be read, or is none.
    """
    path = study / "components.csv" if study.is_dir() else study
    try:
        text = text_of(read_whole(path))
        rows = list(csv.DictReader(io.StringIO(text, newline="")))
    except (OSError, ValueError, csv.Error) as error:
        why = (isinstance(error, OSError) and error.strerror) or error
        raise InputError(f"{path}: cannot be read ({why}); expected that of a study") from None
    if rows and not {"condition", "quantity", "component", "variance", "freedom"} <= rows[0].keys():
        raise InputError(f"{path}: expected the components.csv of a study")
    return path, rows


def _of_study(name: str, side: Side, study: Path, *, whole: bool) -> Scatter:
    path, rows = components_of(study)
    words = {f"{a:g} mm, {p or 'program not stated'}" for a, p in side.conditions}
    known = {r.get("condition", "") for r in rows}
    if not words <= known:
        raise InputError(
            f"{path}: a study of {'; '.join(sorted(known)) or 'nothing'}; these sessions are of "
            f"{'; '.join(sorted(words))}: expected the same opening and program"
        )
    try:
        of = {
            r["component"]: (float(r["variance"]), max(float(r["freedom"] or 0), 1.0))
            for r in rows
            if r["quantity"] == name
            and r["scale"] == main_scale(name)
            and r["condition"] == min(words)
        }
        within, freedom = of[WITHIN]
    except (KeyError, ValueError):
        raise InputError(f"{path}: no components of {name}; expected those of a study") from None
    none = (0.0, freedom)
    anew, freedom = of.get("placement", (0.0, freedom))  # of both, the fewer
    own = 0.0 if whole else of.get("of which identification", none)[0]
    placed = max(anew + within - own, 0.0)
    return Scatter(
        (placed, max(freedom, CHANGES.least_freedom)),
        f"the components of variance of {path}",
        of.get("visit"),
        of.get("operator", none),
        of.get("probe", none),
    )


WORDS = {
    "changed": "changed",
    "not_shown": "no change is shown",
    "cannot_say": "too uncertain to say",
}


def in_words(found: Changes) -> list[str]:
    """Return the answer in sentences."""
    lines = []
    whole = () if found.stiffness is None else (found.stiffness,)
    for one in (*whole, *found.parameters):
        said = one.to_json()
        name = plain(one.name)[0]
        unit = " %" if said["unit"] == "%" else ""
        lines.append(
            f"{name}: {WORDS[one.verdict]}: {said['change']:+.3g}{unit} "
            f"({said['low']:+.3g} to {said['high']:+.3g}); the smallest change that could have "
            f"been shown is {said['smallest_shown']:.3g}{unit}."
        )
    control = ", less the change of the control site" if found.paired else ""
    lines.append(f"At {100 * found.level:g} %{control}, by {found.basis}.")
    return lines
