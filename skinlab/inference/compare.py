"""Is a change real? Two answers, of two sites or two dates, held against each other.

A parameter by itself may stay undecided where the curves differ beyond doubt, because one curve
leaves a long valley of skins that explain it. So the whole is judged as well: whether one skin
explains both as well as two skins do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinlab.errors import InputError
from skinlab.inference.joint import JointMisfit
from skinlab.inference.optimise import polish
from skinlab.inference.result import Identification, Value
from skinlab.inference.settings import POPULATION
from skinlab.mechanics.names import plain

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Change:
    """One parameter before and after. `overlap` is the area that both posteriors share (0 to 1)."""

    name: str
    before: Value
    after: Value
    probability_higher: float  # after than before
    overlap: float

    @property
    def sign(self) -> int:
        """+1 or -1 where the change has a sign for sure (97.5 %), else 0."""
        if self.probability_higher >= POPULATION.sure:
            return 1
        return -1 if self.probability_higher <= 1 - POPULATION.sure else 0


@dataclass(frozen=True)
class Comparison:
    """All parameters, and how probable so large a difference is if it were one skin.

    By the errors of both answers: of a curve alone the sensor's noise.
    """

    changes: tuple[Change, ...]
    p_value: float | None  # None: the two were fitted with different unknowns
    placements: bool = False  # whether these are among the errors: of curves fitted together

    @property
    def counted(self) -> str:
        """What may differ between measurements of one skin, in words."""
        noise = "the sensor's noise"
        return f"{noise} and how the probe was put on" if self.placements else noise

    @property
    def real(self) -> bool:
        """Whether the measurements differ by more than their noise explains."""
        by_sign = any(change.sign for change in self.changes)
        return by_sign if self.p_value is None else self.p_value < POPULATION.random

    def to_json(self) -> dict[str, Any]:
        """Return the document `skinlab.comparison/1`."""
        return {
            "schema": "skinlab.comparison/1",
            "real": self.real,
            "p_value": self.p_value,
            "p_value_counts": ["noise", *(["placements"] if self.placements else [])],
            "parameters": {
                c.name: {
                    "before": vars(c.before),
                    "after": vars(c.after),
                    "probability_higher": c.probability_higher,
                    "overlap": c.overlap,
                }
                for c in self.changes
            },
        }


def compare(before: Identification, after: Identification) -> Comparison:
    """Return how two answers differ.

    Raises:
        InputError: one of them has no intervals, or they have other parameters.
    """
    for answer in (before, after):
        if answer.uncertainty is None or answer.parameters is None:
            why = answer.error or "the method gives no intervals"
            raise InputError(f"{answer.file}: nothing to compare ({why})")
    first, second = before.parameters or {}, after.parameters or {}
    if list(first) != list(second):
        raise InputError(f"{before.file} and {after.file} have different parameters")
    assert before.uncertainty is not None
    assert after.uncertainty is not None
    a, b = before.uncertainty.draws, after.uncertainty.draws
    changes = tuple(
        Change(
            name,
            first[name],
            second[name],
            probability_higher((a.parameters[:, i], a.weight), (b.parameters[:, i], b.weight)),
            overlap((a.parameters[:, i], a.weight), (b.parameters[:, i], b.weight)),
        )
        for i, name in enumerate(first)
    )
    placements = any(answer.placement is not None for answer in (before, after))
    return Comparison(changes, _one_skin(before, after), placements)


def probability_higher(before: tuple[Array, Array], after: tuple[Array, Array]) -> float:
    """Return the probability that a value of `after` exceeds one of `before`; ties count half.

    Each is (values (n,), weights (n,) that sum up to 1).
    """
    values, weight = before
    order = np.argsort(values, kind="stable")
    values, below = values[order], np.concatenate([[0.0], np.cumsum(weight[order])])
    left = below[np.searchsorted(values, after[0], side="left")]
    right = below[np.searchsorted(values, after[0], side="right")]
    return float(np.clip(after[1] @ (0.5 * (left + right)), 0.0, 1.0))


def overlap(before: tuple[Array, Array], after: tuple[Array, Array]) -> float:
    """Return the area under the lesser of both densities, by histograms: 1 same, 0 apart."""
    low = min(before[0].min(), after[0].min())
    high = max(before[0].max(), after[0].max())
    if not high > low:
        return 1.0
    shares = [
        np.histogram(values, bins=POPULATION.bins, range=(low, high), weights=weight)[0]
        for values, weight in (before, after)
    ]
    return float(np.minimum(*shares).sum())


def _one_skin(before: Identification, after: Identification) -> float | None:
    """Return the probability of so much more misfit of one skin to both than of two skins.

    Twice the logarithm of a likelihood ratio is distributed as chi-square with as many degrees of
    freedom as there are unknowns (Wilks 1938).
    """
    a, b = before.uncertainty, after.uncertainty
    assert a is not None
    assert b is not None
    if a.draws.unit.shape[1] != b.draws.unit.shape[1] or a.names != b.names:
        return None
    # The stated thickness' uncertainty counts once for each: one skin may have been restated.
    parts = (*a.parts, *b.parts)
    apart = 0.0
    starts = []
    for left in (a, b):
        heavy = np.argsort(-left.draws.weight)[: POPULATION.starts]
        starts.append(left.draws.unit[heavy])
        least = _least(left.space, JointMisfit(left.parts), starts[-1])
        apart += least
    together = _least(a.space, JointMisfit(parts), np.concatenate(starts))
    from scipy.special import chdtrc  # slow to import

    return float(chdtrc(a.draws.unit.shape[1], max(together - apart, 0.0)))


def _least(space: Any, misfit: JointMisfit, starts: Array) -> float:
    return float(misfit.rest + polish(space, misfit, starts, least_gain=1e-3).cost.min())


def in_words(comparison: Comparison) -> list[str]:
    """Return what is said of each parameter, if nothing but the sensor's noise differs."""
    lines = []
    for change in comparison.changes:
        p = change.probability_higher
        likely, word = (p, "higher") if p >= 0.5 else (1 - p, "lower")
        label = plain(change.name)[0]
        values = f"{change.before.value:.4g} → {change.after.value:.4g}"
        if likely >= POPULATION.sure:
            said = f"is {word} now"
        elif likely >= POPULATION.likely:
            said = f"is probably {word} now"
        else:
            said = "is not shown to have changed"
        lines.append(
            f"{label} {said}: {values}; {word} with probability {100 * likely:.3g} %, "
            f"overlap {100 * change.overlap:.0f} %."
        )
    if comparison.real and not any(change.sign for change in comparison.changes):
        lines.append("These curves do not show which parameter changed.")
    return lines
