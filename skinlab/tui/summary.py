"""What the curves of a session say together, as pure functions: repeats, their mean and scatter.

Only what is alike is averaged: first loadings with first loadings, whole curves, and no parameter
that one of the curves does not fix. What is left out is said.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from skinlab.mechanics.names import beyond_zero, unit_of
from skinlab.recording.session_fit import comparable
from skinlab.report.rounding import decimals, rounded
from skinlab.report.verdict import Step, Use
from skinlab.tui.value_text import name_of

if TYPE_CHECKING:
    from skinlab.tui.shown import Entry

_FORBIDS = ("not_identifiable", "at_bound")  # flags of a parameter over which there is no mean


@dataclass(frozen=True)
class Repeats:
    """Curves that were measured alike: mean and standard deviation of each parameter."""

    aperture_mm: float
    program: str
    first: bool  # first loadings; else later ones
    curves: tuple[int, ...]
    mean: dict[str, float]
    sd: dict[str, float]  # of one curve, n - 1 in the denominator
    loose: dict[str, tuple[int, ...]] = field(default_factory=dict)  # by curves that do not fix it
    joined: bool = True  # whether the joint fit has them


def left_out(entries: Iterable[Entry], excluded: Mapping[int, str]) -> dict[int, str]:
    """Return why curves are in no mean, by their number."""
    found = {}
    for entry in entries:
        reason, verdict = excluded.get(entry.index), entry.verdict
        cut = entry.curve.partial or entry.cut is not None
        if reason is not None:
            found[entry.index] = reason
        elif cut:
            found[entry.index] = "cut short"
        elif verdict is not None and verdict.step is Step.LOOK_AGAIN:
            found[entry.index] = verdict.why
        elif entry.result is None or not entry.result.parameters:
            found[entry.index] = "not identified"
        elif verdict is not None and verdict.use is Use.NOT:
            found[entry.index] = verdict.why
    return found


def repeats(entries: Iterable[Entry], excluded: Mapping[int, str]) -> list[Repeats]:
    """Return the groups of at least two curves that can be averaged."""
    all_entries = list(entries)
    out = left_out(all_entries, excluded)
    joined = {id(c) for c in comparable([e.curve for e in all_entries if e.index not in excluded])}
    groups: dict[tuple[float, str, bool], list[Entry]] = {}
    for entry in all_entries:
        if entry.index not in out:
            setup = entry.curve.setup
            key = (setup.aperture_mm, str(setup.program), setup.cycle == 1)
            groups.setdefault(key, []).append(entry)
    found = []
    for (aperture_mm, program, first), members in groups.items():
        if len(members) < 2:
            continue
        values: dict[str, list[float]] = {}
        loose: dict[str, list[int]] = {}
        for entry in members:
            assert entry.result is not None
            for name, value in (entry.result.parameters or {}).items():
                values.setdefault(name, []).append(value.value)
                if any(f"{kind}:{name}" in entry.result.flags for kind in _FORBIDS):
                    loose.setdefault(name, []).append(entry.index)
        kept = {n: v for n, v in values.items() if n not in loose and len(v) == len(members)}
        found.append(
            Repeats(
                aperture_mm,
                program,
                first,
                tuple(entry.index for entry in members),
                {name: float(np.mean(v)) for name, v in kept.items()},
                {name: float(np.std(v, ddof=1)) for name, v in kept.items()},
                {name: tuple(of) for name, of in loose.items()},
                all(id(entry.curve) in joined for entry in members),
            )
        )
    return found


def repeats_lines(groups: Iterable[Repeats], out: Mapping[int, str] | None = None) -> list[str]:
    """Return a line or two for each group, and what is in none."""
    lines = []
    for group in groups:
        which = "first loadings" if group.first else "later loadings"
        what = f"{group.aperture_mm:g} mm, {group.program}, {which}"
        lines.append(f"Curves {_numbers(group.curves)} ({what}):")
        values = []
        for name, mean in group.mean.items():
            sd, unit, size = group.sd[name], unit_of(name), beyond_zero(name, mean)
            # One digit of the scatter, and three of the size where there is next to none
            places = decimals(0.0, 5.0 * max(sd, 0.01 * size))
            share = f" ({100 * sd / size:.0f} %)" if size > sd else ""  # else it says nothing
            values.append(
                f"{name_of(name)} {rounded(mean, places)} ± {rounded(sd, places)}"
                f"{unit and ' '}{unit}{share}"
            )
        if values:
            lines.append(f"  {', '.join(values)}")
        together = "; j fits them together" if group.joined else ""
        lines += [
            f"  {name_of(name)}: no mean, curve{'s' * (len(of) > 1)} {_numbers(of)} "
            f"{'do' if len(of) > 1 else 'does'} not fix it{together}"
            for name, of in group.loose.items()
        ]
    lines += [f"Curve {index} is in no mean: {why}" for index, why in (out or {}).items()]
    return lines


def _numbers(indices: Iterable[int]) -> str:
    return ", ".join(str(index) for index in indices)
