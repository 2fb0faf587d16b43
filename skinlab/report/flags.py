"""Flags and findings in words: what each says, and what to do about it."""

from __future__ import annotations

import numpy as np

from skinlab.quality.gates import all_gates
from skinlab.report.measured import Measured

NAMES = {"X1_MPa": "X1", "X2_MPa": "X2", "nu": "ν"}

_WORDS = {
    "at_bound": "The best fit has {} at the end of what was searched: the truth may lie beyond. "
    "Check opening and thickness, and do not trust the number.",
    "not_identifiable": "This curve hardly fixes {}: its interval covers most of what is possible, "
    "so do not use the number. Measure with another opening or a higher pressure as well "
    "(“skinlab identify --advise” says which).",
    "outside_database": "Samples, or the whole curve, lie where nothing was computed, and were not "
    "fitted. Use a thickness and a pressure inside the database.",
    "not_converged": "The search did not end by itself: the values are where it was stopped. "
    "Identify again with other options, or measure again.",
    "partial_curve": "The curve was cut short, and only what there is was fitted. Measure again.",
    "not_first_cycle": "The site was loaded before: skin is softer from the second loading on, and "
    "the elastic law describes the first. Compare it with later loadings only.",
}


def signed(correlation: float) -> str:
    """Return a correlation with its sign."""
    return f"{correlation:+.2f}".replace("-", "−")


def explanations(measured: Measured) -> list[str]:
    """Return a point for each flag and finding: its name, what it says, what to do."""
    points = []
    told = {finding.gate for finding in measured.judged.findings}
    for finding in measured.judged.findings:
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
    if kind in _WORDS:
        return _WORDS[kind].replace("{}", NAMES.get(parameter, parameter))
    if kind in {gate.name for gate in all_gates()}:
        return (
            "A quality gate that failed when the curve was measured; it is not found again here, "
            "because the program or the record differs."
        )
    return "A flag that this version of the program does not know."


def _misfit(measured: Measured) -> str:
    ratio, fit = "", measured.fit
    if not isinstance(fit, str) and fit.noise_mm is not None:
        noise_mm = np.sqrt(np.mean(fit.noise_mm**2))  # the pressure's too, as in the band
        ratio = f" ({np.sqrt(np.mean(fit.residual_mm**2)) / noise_mm:.1f} times)"
    return (
        f"The residual is clearly more than the noise{ratio}: the model misses something here, and "
        "the intervals mean less. Repeat the measurement, look for contact, tape and movement; "
        "“skinlab discrepancy” looks for the effect."
    )
