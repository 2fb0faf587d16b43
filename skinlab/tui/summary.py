"""What the curves of a session say together, as pure functions: repeats, their mean and scatter."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skinlab.tui.text import digits, name_of

if TYPE_CHECKING:
    from skinlab.tui.ui_state import Entry


@dataclass(frozen=True)
class Repeats:
    """Curves that were measured alike: mean and standard deviation of each parameter."""

    aperture_mm: float
    program: str
    curves: tuple[int, ...]
    mean: dict[str, float]
    sd: dict[str, float]  # of one curve, n - 1 in the denominator


def repeats(entries: Iterable[Entry], excluded: Mapping[int, str]) -> list[Repeats]:
    """Return the groups of at least two identified curves, the excluded ones left out."""
    groups: dict[tuple[float, str], list[Entry]] = {}
    for entry in entries:
        if entry.index in excluded or entry.result is None or not entry.result.parameters:
            continue
        setup = entry.curve.setup
        groups.setdefault((setup.aperture_mm, str(setup.program)), []).append(entry)
    found = []
    for (aperture_mm, program), members in groups.items():
        if len(members) < 2:
            continue
        values: dict[str, list[float]] = {}
        for entry in members:
            assert entry.result is not None
            for name, value in (entry.result.parameters or {}).items():
                values.setdefault(name, []).append(value.value)
        found.append(
            Repeats(
                aperture_mm,
                program,
                tuple(entry.index for entry in members),
                {name: float(np.mean(v)) for name, v in values.items()},
                {name: float(np.std(v, ddof=1)) for name, v in values.items() if len(v) > 1},
            )
        )
    return found


def repeats_lines(groups: Iterable[Repeats]) -> list[str]:
    """Return a line or two for each group."""
    lines = []
    for group in groups:
        numbers = ", ".join(str(index) for index in group.curves)
        lines.append(f"Curves {numbers} ({group.aperture_mm:g} mm, {group.program}):")
        values = []
        for name, mean in group.mean.items():
            sd = group.sd.get(name)
            scatter = "" if sd is None else f" ± {digits(sd, 2)} ({100 * sd / abs(mean):.0f} %)"
            values.append(f"{name_of(name)} {digits(mean, 3)}{scatter}")
        lines.append("  " + ", ".join(values))
    return lines
