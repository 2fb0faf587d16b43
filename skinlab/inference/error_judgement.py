"""What the errors of a curve mean for its answer: noise, flags, and a sentence why."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.error_choice import ErrorChoice, Node
from skinlab.inference.error_models.words import contradiction
from skinlab.inference.noise import roughness
from skinlab.inference.settings import JUDGEMENT

Array = NDArray[np.float64]

_PLACEMENT = frozenset({"placement", "placement_thickness"})  # told by themselves: of no sample
_OTHER = frozenset({"pressure"}) | _PLACEMENT


@dataclass(frozen=True)
class ErrorModelSummary:
    """The errors of the samples in a few numbers, medians of the likeliest combination."""

    name: str
    parameters: dict[str, float]
    why: str


@dataclass(frozen=True)
class PlacementSummary:
    """How placements differ: medians with 90 % intervals; `count` of them."""

    scatter: dict[str, float]
    offset_um: dict[str, float]
    count: int


@dataclass(frozen=True)
class Judged:
    """`noise_um` is the standard deviation of one deflection sample's errors."""

    summary: ErrorModelSummary
    noise_um: float
    flags: tuple[str, ...]
    placement: PlacementSummary | None = None


def judge_errors(
    errors: ErrorChoice, stated_um: float | None, residual_um: float = math.inf
) -> Judged:
    """Return what these errors say, next to a noise that was stated.

    `residual_um` is the root mean square of what the best fit leaves. Slow errors may be larger
    than what a short curve shows of them: that alone contradicts no statement.
    """
    flags: list[str] = []
    sizes = _Sizes.of(errors)
    misses = errors.quantile_of(sizes.lasting_um, 0.5) > JUDGEMENT.most_um
    noise = errors.quantile_of(sizes.noise_um(lasting=not misses), 0.5)
    lasts = errors.weight[sizes.lasting_um > JUDGEMENT.shows * sizes.noise_um(lasting=False)].sum()
    if lasts >= JUDGEMENT.sure:
        flags.append("correlated_noise")
    told = errors.told
    numbers = {k: v for k, v in errors.parameters().items() if not k.startswith("placement_")}
    why = [_with_numbers(part.why, numbers) for part in told.parts if part.why]
    if stated_um is not None:
        # A statement may or may not count the rounding as noise.
        found = [
            _beside(errors, sizes.noise_um(rounding=rounding), stated_um)
            for rounding in (True, False)
        ]
        all_um = found[0][0]
        seen = all_um < stated_um or residual_um > JUDGEMENT.contradicted * stated_um
        if seen and all(contradicted for _, contradicted in found):
            flags.append("stated_noise_contradicted")
            both = contradiction(stated_um, all_um)
            if misses:  # the noise that is told is then without them
                both += f" with errors that last, {noise:.3g} µm without"
            why.append(both)
            misses = misses or all_um > stated_um
    each_um = errors.quantile_of(sizes.noise_um(lasting=False, proportional=False), 0.5)
    if each_um > JUDGEMENT.most_each_um and (stated_um is None or misses):
        why.append(f"{each_um:.0f} µm of each sample alone is no sensor's noise")
        misses = True
    zero_um = errors.median(lambda node: node.values.get("placement_offset_um", 0.0))
    if zero_um > JUDGEMENT.most_zero_um:
        why.append(f"zeros of placements are off by {zero_um:.0f} µm")
        misses = True
    if misses:
        flags.append("misfit_above_noise")
    sentence = "; ".join(why) or "residuals are as white noise's"
    name = "+".join(part.name for part in told.parts if part.name not in _PLACEMENT)
    summary = ErrorModelSummary(name, numbers, sentence)
    return Judged(summary, noise, tuple(flags), _placement(errors))


def misses_noise(residuals_mm: Sequence[NDArray[np.float64]]) -> bool:
    """Return whether residuals (u,) of curves are more than noise: for methods without intervals.

    By what is left of their mean square without that of white noise as rough as they are.
    """
    lasting_mm2 = [np.mean(r**2) - roughness(r) ** 2 for r in residuals_mm]
    return bool(np.mean(lasting_mm2) > (1e-3 * JUDGEMENT.most_um) ** 2)


def _with_numbers(why: str, numbers: dict[str, float]) -> str:
    """Return a sentence with the values that are reported in place of their names."""
    for name, value in numbers.items():
        why = why.replace(f"{{{name}}}", f"{value:.2g}")
    return why


def _beside(errors: ErrorChoice, found_um: Array, stated_um: float) -> tuple[float, bool]:
    """Return the noise, µm, of that of the nodes, and whether it contradicts the stated one."""
    median = errors.quantile_of(found_um, 0.5)
    if max(median / stated_um, stated_um / median) <= JUDGEMENT.contradicted:
        return median, False
    low, high = (errors.quantile_of(found_um, q) for q in (JUDGEMENT.doubt, 1.0 - JUDGEMENT.doubt))
    return median, not low <= stated_um <= high


def _placement(errors: ErrorChoice) -> PlacementSummary | None:
    part = next((p for p in errors.best.parts if p.name == "placement"), None)
    if part is None or "placement_count" not in part.stated:  # nothing is told of a curve alone
        return None

    def interval(name: str) -> dict[str, float]:
        def value(node: Node) -> float:
            at = node.combination.parameters.index(name)
            return float(np.exp(node.log_values[at]))

        if name in part.stated:
            return dict.fromkeys(("value", "low", "high"), part.stated[name])
        shares = {"value": 0.5, "low": 0.05, "high": 0.95}
        return {key: errors.quantile(value, share) for key, share in shares.items()}

    return PlacementSummary(
        interval("placement_scatter"),
        interval("placement_offset_um"),
        int(part.stated["placement_count"]),
    )


@dataclass(frozen=True, eq=False)
class _Sizes:
    """Squares (nodes, kinds) of the sizes of the errors' parts, µm²."""

    squares: Array
    kinds: tuple[str, ...]
    lasting: frozenset[str]  # of the kinds, those that are correlated in time

    @classmethod
    def of(cls, errors: ErrorChoice) -> _Sizes:
        each = [node.sizes_um for node in errors.nodes]
        kinds = tuple(dict.fromkeys(name for sizes in each for name in sizes))
        squares = np.square([[sizes.get(name, 0.0) for name in kinds] for sizes in each])
        lasting = frozenset[str]().union(*(node.combination.lasting for node in errors.nodes))
        return cls(squares.reshape(len(each), -1), kinds, lasting)

    @property
    def lasting_um(self) -> Array:
        """Return the size (nodes,) of errors that last."""
        return np.sqrt(self.squares @ [float(name in self.lasting) for name in self.kinds])

    def noise_um(
        self, *, lasting: bool = True, rounding: bool = True, proportional: bool = True
    ) -> Array:
        """Return the standard deviations (nodes,) of a deflection sample's errors.

        The pressure's noise and what placements do are not among them, nor, if so asked, are errors
        that last, rounding, and shares of the deflection.
        """
        without = _OTHER if lasting else _OTHER | self.lasting
        if not rounding:
            without = without | {"quantised"}
        if not proportional:
            without = without | {"proportional"}
        return np.sqrt(self.squares @ [float(name not in without) for name in self.kinds])
