"""The result of the workflow, and its JSON form (`skinlab.discrepancy/1`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.stats import norm, truncnorm

from skinlab.discrepancy.adequacy import Place
from skinlab.discrepancy.fit import Fit
from skinlab.discrepancy.heldout import HeldOut
from skinlab.discrepancy.next_measurement import NextMeasurement
from skinlab.discrepancy.search import Candidate, Found
from skinlab.discrepancy.unknowns import BASE_NAMES
from skinlab.discrepancy.verdict import Verdict
from skinlab.identify.intervals import LEVEL

SCHEMA = "skinlab.discrepancy/1"

_MOST_PLACES = 12
_SIGNIFICANT = 0.01
_MOST_CANDIDATES = 10


@dataclass(frozen=True, eq=False)
class Outcome:
    """All that the workflow found in one campaign."""

    verdict: Verdict
    found: Found
    gap_before: HeldOut
    gap_after: HeldOut
    held_out: dict[tuple[str, ...], float]  # explanation -> root mean square, µm
    next_measurement: NextMeasurement | None
    seed: int = 0
    adopted_model: str | None = None
    alike: list[tuple[str, str]] = field(default_factory=list)

    @property
    def best(self) -> Candidate:
        """The best explanation, or the model as it is."""
        if self.verdict.explanations:
            return self.verdict.explanations[0]
        return self.found.base

    def to_json(self) -> dict[str, Any]:
        """Return the document."""
        base = self.found.base
        own = set(base.effects)
        reference = self.found.candidates[0].log10_evidence if self.found.candidates else 0.0
        return {
            "schema": SCHEMA,
            "verdict": self.verdict.name,
            "effects": [[e for e in c.effects if e not in own] for c in self.verdict.explanations],
            "where": [place_json(p) for p in self.where],
            "candidates": [
                {
                    "effects": [e for e in c.effects if e not in own],
                    "parameters": {
                        n: v for n, v in parameters(c.fit).items() if n not in BASE_NAMES
                    },
                    "held_out_rms_um": self.held_out.get(c.effects),
                    "log10_evidence": c.log10_evidence - reference,
                }
                for c in self.found.candidates[:_MOST_CANDIDATES]
            ],
            "gap": {
                "before_um": self.gap_before.rms_um,
                "after_um": self.gap_after.rms_um,
                "noise_um": self.gap_before.noise_um,
                "held_out": list(self.gap_before.files),
            },
            "parameters": {
                "before": _base_only(base.fit),
                "after": _base_only(self.best.fit),
            },
            "detectable": self.detectable,
            "next_measurement": None
            if self.next_measurement is None
            else {
                "aperture_mm": self.next_measurement.aperture_mm,
                "program": self.next_measurement.program,
                "separates": [
                    [e for e in names if e not in own] for names in self.next_measurement.separates
                ],
                "expected_log10_evidence": self.next_measurement.expected_log10_evidence,
            },
            "adopted_model": self.adopted_model,
            "seed": self.seed,
        }

    @property
    def where(self) -> list[Place]:
        """Places where the model as it is leaves more than noise, the most significant first."""
        places = self.found.base.left.places
        found = [p for p in places if p.p_value < _SIGNIFICANT][:_MOST_PLACES]
        # What goes up and down within every stretch stands out in none: then the foremost.
        return found or ([] if self.verdict.name == "none" else list(places[:3]))

    @property
    def detectable(self) -> dict[str, float]:
        """Smallest size of each effect that these data could have shown, as its parameter."""
        found: dict[str, float] = {}
        for name, signature in sorted(self.found.signatures.items()):
            if not math.isfinite(signature.detectable):
                continue
            axis = next(a for a in signature.axes if a.parameter.zero is not None)
            zero = axis.parameter.zero
            assert zero is not None
            size = abs(axis.parameter.typical - zero) * signature.detectable
            if size <= max(axis.parameter.high - zero, zero - axis.parameter.low):
                found[f"{name}.{axis.parameter.name}"] = size
        return found


def place_json(place: Place) -> dict[str, Any]:
    """Return an entry of `where`."""
    return {
        "file": place.file,
        "phase": place.phase,
        "pressure_mbar": list(place.pressure_mbar),
        "time_s": list(place.time_s),
        "mean_um": place.mean_um,
        "noise_um": place.noise_um,
        "p_value": place.p_value,
    }


def parameters(fit: Fit) -> dict[str, dict[str, float]]:
    """Return values with 90 % intervals: Gaussian about the optimum, cut off at the bounds."""
    u, deviations = fit.u, fit.deviations
    low, high = fit.unknowns.bounds
    value = fit.unknowns.named(u)
    ends = []
    for q in (0.5 * (1 - LEVEL), 0.5 * (1 + LEVEL)):
        at = u.copy()
        for j in range(len(u)):
            a, b = (low[j] - u[j]) / deviations[j], (high[j] - u[j]) / deviations[j]
            at[j] = u[j] + deviations[j] * float(truncnorm.ppf(q, a, b))
        ends.append(at)
    found = {}
    lows, highs = (fit.unknowns.named(at) for at in ends)
    # X2 is the product of two unknowns, whose errors go together.
    if "X2_MPa" in value:
        spread = _log_x2_deviation(fit)
        z = float(norm.ppf(0.5 * (1 + LEVEL)))
        lows["X2_MPa"] = value["X2_MPa"] * math.exp(-z * spread)
        highs["X2_MPa"] = value["X2_MPa"] * math.exp(z * spread)
    for name, best in value.items():
        lo, hi = sorted((lows[name], highs[name]))
        found[name] = {"value": best, "low": min(lo, best), "high": max(hi, best)}
    return found


def _log_x2_deviation(fit: Fit) -> float:
    covariance = np.linalg.inv(fit.information)
    return float(np.sqrt(covariance[0, 0] + covariance[1, 1] + 2.0 * covariance[0, 1]))


def _base_only(fit: Fit) -> dict[str, dict[str, float]]:
    return {n: v for n, v in parameters(fit).items() if n in BASE_NAMES}
