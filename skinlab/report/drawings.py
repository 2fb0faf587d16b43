"""Which pictures there are of a session, with what they show in words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skinlab.inference.result import Identification
from skinlab.mechanics.names import label, of_law
from skinlab.report import plots
from skinlab.report.fitted import Fit
from skinlab.report.flags import signed
from skinlab.report.measured import Measured
from skinlab.report.text import errors_in_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FEWEST = 20  # residuals of which a picture says something


@dataclass(frozen=True)
class Drawing:
    """A picture to be drawn; `name` becomes that of its file."""

    name: str
    draw: Callable[[], Figure]
    alt: str
    caption: str


def session_drawings(curves: Sequence[Measured]) -> list[Drawing]:
    """Return the pictures that compare curves; none where there are not two."""
    found = []
    if len(curves) > 1:
        tops = [m.curve.deflection_mm.max(initial=0.0) for m in curves]
        colours = (
            ""
            if len(curves) <= plots.MOST_NAMED
            else " They are too many to be told apart by colour."
        )
        found.append(
            Drawing(
                "all_curves",
                lambda: plots.draw_all_curves(curves),
                f"{len(curves)} curves, deflection against pressure; their highest deflections go "
                f"from {min(tops):.3f} to {max(tops):.3f} mm.",
                "All curves, loading and unloading." + colours,
            )
        )
    if sum(_has_values(m) for m in curves) > 1:
        found.append(
            Drawing(
                "all_intervals",
                lambda: plots.draw_all_intervals(curves),
                f"{_listed(curves)} of all curves with their 90 % intervals as bars; the numbers "
                "are in the table.",
                "Values (red strokes) with their 90 % intervals (blue bars), curve by curve. Bars "
                "that overlap widely show no difference. Stiffness on a logarithmic scale.",
            )
        )
    return found


def _listed(curves: Sequence[Measured]) -> str:
    *names, last = map(label, of_law(m.result.parameters or () for m in curves if m.result))
    return f"{', '.join(names)} and {last}" if names else last


def curve_drawings(measured: Measured) -> list[Drawing]:
    """Return the pictures of one curve."""
    name = f"curve_{measured.number:04d}"
    found = [
        Drawing(f"{name}_fit", lambda: plots.draw_fit(measured), *_fit_words(measured)),
        Drawing(f"{name}_time", lambda: plots.draw_time(measured), *_time_words(measured)),
    ]
    result, fit = measured.result, measured.fit
    if not isinstance(fit, str) and len(fit.residual_mm) >= _FEWEST:
        found.append(
            Drawing(
                f"{name}_errors", lambda: plots.draw_errors(measured), *_errors_words(measured, fit)
            )
        )
    if result is not None and result.parameters:
        said = "; ".join(
            f"{label(name)} {value.value:.4g}"
            + (
                ", no interval"
                if value.low is None or value.high is None
                else f", interval {value.low:.4g} to {value.high:.4g}"
            )
            for name, value in result.parameters.items()
        )
        searched = not isinstance(measured.fit, str) and bool(measured.fit.ranges)
        whole = " The axes span all that was searched." if searched else ""
        found.append(
            Drawing(
                f"{name}_intervals",
                lambda: plots.draw_intervals(measured),
                f"Parameters with their 90 % intervals: {said}.",
                "Values (red strokes) with their 90 % intervals (blue bars)." + whole,
            )
        )
    if result is not None and result.correlation is not None and result.order:
        pairs = [
            f"{label(a)} and {label(b)} {signed(result.correlation[i][j])}"
            for i, a in enumerate(result.order)
            for j, b in enumerate(result.order)
            if i < j
        ]
        found.append(
            Drawing(
                f"{name}_correlation",
                lambda: plots.draw_correlation(measured),
                f"Correlations: {', '.join(pairs)}.",
                "Correlations of the parameters: near +1 or −1, an error of one goes with an "
                "error of the other.",
            )
        )
    return found


def posterior_drawings(answer: Identification | str) -> list[Drawing]:
    """Return the picture of what the curves together leave open, where there are draws of it."""
    if isinstance(answer, str) or answer.uncertainty is None or len(answer.parameters or {}) < 2:
        return []
    names = [label(name) for name in answer.parameters or {}]
    return [
        Drawing(
            "posterior",
            lambda: plots.draw_pairs(answer),
            f"{', '.join(names)}: draws from the posterior, each pair against each other; a narrow "
            "slanted cloud is a valley, along which the parameters make up for each other.",
            "What the curves together leave open: draws of the parameters, pair by pair, and each "
            "one's own distribution. Dark is probable; a slanted cloud is a valley.",
        )
    ]


def _has_values(measured: Measured) -> bool:
    return bool(measured.result and measured.result.parameters)


def _fit_words(measured: Measured) -> tuple[str, str]:
    curve, fit = measured.curve, measured.fit
    if not len(curve):
        return "An empty diagram: the curve has no samples.", "Deflection against pressure."
    seen = (
        f"{len(curve)} samples from {curve.pressure_mbar.min():.1f} to "
        f"{curve.pressure_mbar.max():.1f} mbar, deflection up to {curve.deflection_mm.max():.3f} mm"
    )
    ringed = len(plots.left_out(measured))
    rings = f" Rings: {ringed} left out as glitches." if ringed else ""
    if isinstance(fit, str):
        return f"Deflection against pressure: {seen}.", "Deflection against pressure." + rings
    below = f"residuals from {1e3 * fit.residual_mm.min():.1f} to {1e3 * fit.residual_mm.max():.1f}"
    band = "The noise is unknown, so there is no band."
    inside = ""
    if fit.within is not None:
        inside = f", {100 * fit.within:.0f} % of them inside the band of twice the noise"
        band = "Grey: twice the noise of one sample."
    return (
        f"Deflection against pressure with the fitted curve: {seen}; {below} µm{inside}.",
        "Measured samples and fitted curve; below, what is left, measured less fitted. "
        + band
        + rings,
    )


def _errors_words(measured: Measured, fit: Fit) -> tuple[str, str]:
    rho = plots.autocorrelation(fit.residual_mm)
    beyond = int((np.abs(rho) > 1.96 / np.sqrt(len(fit.residual_mm))).sum())
    said = measured.result and measured.result.error_model
    found = "" if not said else f" Errors found: {errors_in_words(said)}."
    return (
        f"Autocorrelation of the residuals, {rho[0]:.2f} of neighbours, {beyond} of {len(rho)} "
        "lags outside the band of independent errors; and their quantiles against a normal "
        "distribution.",
        "Left: how much residuals have in common with those so many samples later; independent "
        "errors stay in the grey band in 19 of 20 lags, errors that last or come again do not. "
        "Right: their quantiles; on the line they are normally distributed, heavy tails leave it "
        f"at the ends, steps are stairs.{found}",
    )


def _time_words(measured: Measured) -> tuple[str, str]:
    curve = measured.curve
    lasts = f"{curve.time_s[-1] - curve.time_s[0]:.1f} s" if len(curve) else "no time"
    fitted = "" if isinstance(measured.fit, str) else ", and the fitted curve where it was fitted"
    return (
        f"Pressure and deflection against time, for {lasts}{fitted}.",
        f"Pressure and deflection against time{fitted}.",
    )
