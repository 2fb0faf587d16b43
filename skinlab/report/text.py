"""One result in a few lines of plain text, for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from skinlab.inference.error_models.words import contradiction_in, in_short
from skinlab.inference.flags import CATALOGUE
from skinlab.mechanics.materials.base import NU_CONSISTENT
from skinlab.mechanics.names import is_poisson, plain
from skinlab.text import inert

if TYPE_CHECKING:
    from drivers.dose import Dose
    from skinlab.inference.error_judgement import ErrorModelSummary, PlacementSummary
    from skinlab.inference.result import Advice, Identification
    from skinlab.inference.stored_results import StoredErrors

_MOST_ADVICE = 5  # measurements of which is told, best first
_CLEARLY = 1.3  # times the noise: below, a ratio says nothing
_SENTENCES = (
    "outliers", "correlated_noise", "stated_noise_contradicted",
    "stated_pressure_noise_contradicted", "unlike_cohort", "unlike_model",
)  # fmt: skip


def describe(result: Identification) -> str:
    """Return the text."""
    lines = [inert(result.file)]
    if result.setup is not None:
        lines[0] += (
            f"  ({result.setup.aperture_mm:g} mm opening, {result.setup.thickness_mm:g} mm skin; "
            f"{result.fitted_points} of {result.points} samples fitted: "
            f"{', '.join(result.phases)})"
        )
    elif result.files is not None:
        count = len(result.files)
        how = f"{count} curves together" if count > 1 else "One curve alone"
        lines = [
            f"{how}  ({result.fitted_points} of {result.points} "
            f"samples fitted: {', '.join(result.phases)})"
        ]
    if result.error is not None:
        lines.append(f"  not identified: {inert(result.error)}")
    for name, value in (result.parameters or {}).items():
        label, unit = plain(name)
        text = f"  {label:<4}{'' if len(label) < 4 else ' '}{value.value:10.4g} {unit:<3} "
        if value.low is not None and value.high is not None:
            text += f"90 % interval {value.low:.4g} to {value.high:.4g}  "
        true_nu = result.derived.get(NU_CONSISTENT)
        if is_poisson(name) and true_nu is not None:
            text += f"(ν of linear elasticity: {true_nu:.3f})"
        lines.append(text.rstrip())
    for height in result.heights:
        if height.pressure_mbar is None:
            lines.append(f"  {height.height_mm:g} mm {'' if height.reached else 'not '}reached")
        else:
            lines.append(
                f"  {height.height_mm:g} mm needed {height.pressure_mbar:.1f} mbar "
                f"(± {height.pressure_sd_mbar:.1f})"
            )
    if result.error_um is not None and result.rms_um is not None:
        noise = f", noise {result.noise_um:.3g} µm" if result.noise_um else ""
        placed = "" if result.placement is None else " with what placements did"
        lines.append(
            f"  rms residual {result.rms_um:.3g} µm{placed}{noise} (the paper's error: "
            f"{result.error_um:.3g} µm)"
        )
    if result.error_model is not None:
        lines.append(f"  errors: {errors_in_words(result.error_model)}")
    if result.placement is not None:
        lines.append(f"  placements: {placements_in_words(result.placement)}")
    lines += [f"  {sentence}" for sentence in explain(result)]
    if result.flags:
        lines.append(f"  flags: {', '.join(result.flags)}")
    return "\n".join(lines)


_ERRORS = {
    "white_um": "white {} µm",
    "ou_um": "lasting {} µm",
    "ou_s": "for {} s",
    "proportional_share": "{} of the deflection",
    "pressure_mbar": "pressure {} mbar",
    "step_um": "steps of {} µm",
    "breathing_um": "breathing {} µm",
    "breathing_hz": "at {} Hz",
    "pulse_um": "pulse {} µm",
    "pulse_hz": "at {} Hz",
    "freedom": "heavy tails (Student's t, {} degrees)",
    "wander_um_per_root_s": "zero wandering, {} µm in a second",
}


def errors_in_short(model: ErrorModelSummary) -> str:
    """Return which kinds of error there are, a word or two each."""
    return ", ".join(in_short(kind) for kind in model.name.split("+"))


def errors_in_words(model: ErrorModelSummary | StoredErrors) -> str:
    """Return an error model in a few words, with its numbers."""
    parts = [_errors_number(name, f"{value:.2g}") for name, value in model.parameters.items()]
    return f"{', '.join(parts)} ({model.why})"


def placements_in_words(placement: PlacementSummary) -> str:
    """Return by how much placements differ, in a few words."""
    share = {key: f"{100.0 * value:.2g}" for key, value in placement.scatter.items()}
    said = "stated" if share["low"] == share["high"] else f"{share['low']} to {share['high']}"
    return (
        f"{placement.count}, their stiffnesses differ by {share['value']} % ({said}), "
        f"their zeros by {placement.offset_um['value']:.2g} µm"
    )


def _errors_number(name: str, value: str) -> str:
    if name in _ERRORS:
        return _ERRORS[name].replace("{}", value)
    what, _, unit = name.rpartition("_")  # of an installed error model
    return f"{what.replace('_', ' ')} {value} {'µm' if unit == 'um' else unit}"


def explain(result: Identification, noise_um: float | None = None) -> list[str]:
    """Return what the flags of uncertainty mean here, a sentence each.

    `noise_um` is that of a sample of the curve, the pressure's noise included; None: not known.
    """
    found = []
    loose = [f.split(":")[1] for f in result.flags if f.startswith("not_identifiable:")]
    if loose:
        names = " and ".join(plain(name)[0] for name in loose)
        found.append(
            f"These data do not determine {names}: the interval is most of what is possible."
        )
    if "misfit_above_noise" in result.flags:
        # Of several curves the residual has in it what placements did, and that is no noise.
        rms_um = result.rms_um if result.files is None else None
        times, noise = times_the_noise(result.error_model, rms_um, noise_um)
        less = "" if result.placement is None else ", less what placements did,"
        found.append(
            f"The residual{less} is {f'{times} times' if times else 'clearly more than'} {noise}: "
            "the model misses something here, and the intervals mean less."
        )
        if result.flags_by_file:
            found.append(f"It is so of {', '.join(inert(name) for name in result.flags_by_file)}.")
    for flag in result.flags:
        kind, _, what = flag.partition(":")
        if kind in _SENTENCES:
            meaning = CATALOGUE[kind].meaning.replace("{}", what)
            if kind == "stated_noise_contradicted" and result.error_model is not None:
                both = contradiction_in(result.error_model.why)
                meaning += f" ({both.clause})" if both else ""
            found.append(meaning)
    bounds = [f.split(":")[1] for f in result.flags if f.startswith("at_bound:")]
    for whose, at in (
        ("the model's own bounds", [b for b in bounds if b in result.own_bounds]),
        ("the database", [b for b in bounds if b not in result.own_bounds]),
    ):
        if at:
            names = " and ".join(plain(name)[0] for name in at)
            found.append(f"The best fit has {names} at the end of {whose}: it may lie beyond.")
    return found


def times_the_noise(
    model: ErrorModelSummary | StoredErrors | None, rms_um: float | None, noise_um: float | None
) -> tuple[str, str]:
    """Return how many times a noise the residual is, and which noise.

    The number is "" where it is unknown or would not show that the residual is more. Where the
    residual is more than a stated noise, that noise counts: `noise_um` is the one that was found.
    Where `rms_um` is None the noise that was found stands for the residual.
    """
    which = "the noise"
    both = None if model is None else contradiction_in(model.why)
    if both and both.found_um > both.stated_um:
        noise_um, which = both.stated_um, "the stated noise"
        rms_um = both.found_um if rms_um is None else rms_um
    if not noise_um or not rms_um or rms_um < _CLEARLY * noise_um:
        return "", which
    return f"{rms_um / noise_um:.1f}", which


def describe_advice(advice: Sequence[Advice]) -> str:
    """Return the best measurements in a few lines."""
    if not advice:
        return "No further measurement of the menu would help, or none can be computed."
    lines = ["To narrow the intervals, measure next (expected widths, today's being 100 %):"]
    for item in advice[:_MOST_ADVICE]:
        widths = ", ".join(
            f"{plain(name)[0]} {100 * ratio:.0f} %" for name, ratio in item.narrows.items()
        )
        lines.append(f"  {item.aperture_mm:g} mm opening, {item.program:<14} {widths}")
    return "\n".join(lines)


def describe_dose(dose: Dose) -> str:
    """Return in one line what the site has had."""
    return f"dose of the site: {dose.suction_mbar_s:.0f} mbar·s, {dose.time_s:.1f} s under suction"
