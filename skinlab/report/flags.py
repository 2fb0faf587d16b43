"""Flags and findings in words: what each says, and what to do about it."""

from __future__ import annotations

import numpy as np

from skinlab.inference.flags import CATALOGUE
from skinlab.mechanics.names import label
from skinlab.quality.gates import all_gates
from skinlab.report.measured import Measured, scolded
from skinlab.report.text import times_the_noise
from skinlab.report.verdict import FEW


def signed(correlation: float) -> str:
    """Return a correlation with its sign."""
    return f"{correlation:+.2f}".replace("-", "−")


def explanations(measured: Measured) -> list[str]:
    """Return a point for each flag and finding: its name, what it says, what to do."""
    points = []
    told = {finding.gate for finding in measured.judged.findings}
    if measured.for_effect:
        told.add(FEW)
    for finding in scolded(measured):
        sentence = finding.sentence[:1].upper() + finding.sentence[1:]
        advice = finding.advice[:1].upper() + finding.advice[1:]
        points.append(f"{finding.gate}: {sentence}. What to do: {advice}.")
    result = measured.result
    if result is not None:
        points += [f"{f}: {_words(f, measured)}" for f in result.flags if f not in told]
    return points


def _words(flag: str, measured: Measured) -> str:
    kind, _, parameter = flag.partition(":")
    if kind == "misfit_above_noise":
        return _misfit(measured)
    if kind in CATALOGUE:
        entry = CATALOGUE[kind]
        return f"{entry.meaning} {entry.advice}".replace("{}", label(parameter))
    if kind in {gate.name for gate in all_gates()}:
        return (
            "A quality gate that failed when the curve was measured; it is not found again here, "
            "because the program or the record differs."
        )
    return "A flag that this version of the program does not know."


def _misfit(measured: Measured) -> str:
    rms_um, noise_um, fit = None, None, measured.fit
    if not isinstance(fit, str) and fit.noise_mm is not None:
        rms_um = 1e3 * float(np.sqrt(np.mean(fit.residual_mm**2)))
        noise_um = 1e3 * float(np.sqrt(np.mean(fit.noise_mm**2)))  # the pressure's too
    result, flag = measured.result, CATALOGUE["misfit_above_noise"]
    model = None if result is None else result.error_model
    times, noise = times_the_noise(model, rms_um, noise_um)
    ratio = f" ({times} times)" if times else ""
    meaning = flag.meaning.replace("more than noise", f"more than {noise}{ratio}")
    return f"{meaning} {flag.advice}"
