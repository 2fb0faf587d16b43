"""The pictures of a session; drawn inside `skinlab.report.pictures.style`.

No text of a user is drawn: curves go by their number. Colours are told apart by shape as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.result import Identification
from skinlab.mechanics.names import heading, is_effects, label, of_law
from skinlab.report.flags import signed
from skinlab.report.measured import Measured
from skinlab.report.pictures import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SERIES,
    VERMILION,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

WIDTH_IN = 5.0  # a phone shows it at three quarters, still readable

_PHASES = {
    "load": (BLUE, "o"),
    "hold": (GREEN, "s"),
    "unload": (ORANGE, "v"),
    "rest": (PURPLE, "x"),
}
_DASHES = ("-", "--", ":", "-.")
_NARROW, _WIDE = 1.0, 2.5  # decades: ticks where a linear axis has them, and only at powers of 10
_WIDE_RATIO = 20.0  # of the ends of an axis that is better logarithmic
_MANY = 2000  # samples from which points are stored as an image inside an SVG
MOST_NAMED = len(SERIES) * len(_DASHES)  # curves that can be told apart by colour and dashes
_LAGS = 40
PRESSURE, DEFLECTION = "pressure (mbar)", "deflection (mm)"


def draw_fit(measured: Measured) -> Figure:
    """Return deflection against pressure, the fitted curve over it, and the residuals below.

    Samples that were left out as glitches have a ring.
    """
    curve, fit = measured.curve, measured.fit
    if isinstance(fit, str):
        figure = new_figure(WIDTH_IN, 3.8)
        axes = figure.add_subplot()
        _points(axes, measured)
        axes.set_xlabel(PRESSURE)
    else:
        figure = new_figure(WIDTH_IN, 5.2)
        axes, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        _points(axes, measured)
        axes.plot(fit.line_mbar, fit.line_mm, color=VERMILION, lw=2, label="fitted curve")
        pressure = curve.pressure_mbar[fit.mask]
        if fit.noise_mm is not None:
            order = np.argsort(pressure)
            band = 2e3 * fit.noise_mm[order]
            below.fill_between(
                pressure[order],
                -band,
                band,
                color="#CFCFCF",
                lw=0,
                rasterized=len(order) > _MANY,
                label="2 × noise",
            )
        below.axhline(0.0, color=VERMILION, lw=1.5)
        _scatter(below, pressure, 1e3 * fit.residual_mm, curve.phase[fit.mask])
        below.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=5, fontsize=8, borderaxespad=0.2
        )
        below.set_xlabel(PRESSURE)
        below.set_ylabel("residual (µm)")
    axes.set_ylabel(DEFLECTION)
    if len(curve):
        axes.legend(loc="best", fontsize=8)
    axes.set_title(f"Curve {measured.number}")
    return figure


def draw_time(measured: Measured) -> Figure:
    """Return pressure and deflection against time, with the fitted curve where it was fitted."""
    curve, fit = measured.curve, measured.fit
    figure = new_figure(WIDTH_IN, 5.2)
    above, below = figure.subplots(2, 1, sharex=True)
    many = len(curve) > _MANY
    above.plot(curve.time_s, curve.pressure_mbar, color=BLUE, lw=1.2, rasterized=many)
    below.plot(
        curve.time_s, curve.deflection_mm, color=BLUE, lw=1.2, rasterized=many, label="measured"
    )
    if not isinstance(fit, str):
        model = np.full(len(curve), np.nan)
        model[fit.mask] = fit.model_mm
        below.plot(
            curve.time_s, model, "--", color=VERMILION, lw=2, rasterized=many, label="fitted curve"
        )
    _ring(below, measured, curve.time_s)
    below.legend(loc="best", fontsize=8)
    above.set_ylabel(PRESSURE)
    below.set_ylabel(DEFLECTION)
    below.set_xlabel("time (s)")
    above.set_title(f"Curve {measured.number}")
    return figure


def draw_errors(measured: Measured) -> Figure:
    """Return what the residuals have to do with their neighbours, and with a normal distribution.

    By lag in samples, with the band in which independent errors stay in 19 of 20 cases; and their
    quantiles in standard deviations of the noise (their own where that is unknown).
    """
    fit = measured.fit
    assert not isinstance(fit, str)
    figure = new_figure(WIDTH_IN, 2.9)
    left, right = figure.subplots(1, 2)
    rho = autocorrelation(fit.residual_mm)
    most = 1.96 / np.sqrt(len(fit.residual_mm))
    left.axhspan(-most, most, color="#CFCFCF", lw=0)
    left.axhline(0.0, color=VERMILION, lw=1.5)
    left.vlines(np.arange(1, len(rho) + 1), 0.0, rho, color=BLUE, lw=2)
    left.set_ylim(min(-0.4, 1.1 * rho.min(initial=0.0)), 1.0)
    left.set_xlabel("lag (samples)")
    left.set_ylabel("autocorrelation")
    expected, seen = quantiles(fit.residual_mm, fit.noise_mm)
    ends = [expected[0], expected[-1]]
    right.plot(ends, ends, color=VERMILION, lw=1.5)
    right.plot(expected, seen, "o", color=BLUE, ms=3, rasterized=len(seen) > _MANY)
    right.set_xlabel("normal quantile")
    right.set_ylabel("residual / noise" if fit.noise_mm is not None else "residual / its sd")
    figure.suptitle(f"Curve {measured.number}: the residuals as errors")
    return figure


def autocorrelation(residual_mm: Array) -> Array:
    """Return the correlations (lags,) of residuals (n,) with those 1, 2, … samples later."""
    off = residual_mm - residual_mm.mean()
    n, whole = len(off), max(float(off @ off), 1e-300)
    return np.array([off[lag:] @ off[:-lag] for lag in range(1, min(_LAGS, n // 3) + 1)]) / whole


def quantiles(residual_mm: Array, noise_mm: Array | None) -> tuple[Array, Array]:
    """Return a normal distribution's quantiles (n,), and those of residuals over their noise."""
    from scipy.special import ndtri  # slow to import

    n = len(residual_mm)
    sd = max(float(residual_mm.std()), 1e-300) if noise_mm is None else noise_mm
    return np.asarray(ndtri((np.arange(n) + 0.5) / n)), np.sort(residual_mm / sd)


def draw_intervals(measured: Measured) -> Figure:
    """Return the parameters as dots with their 90 % intervals as bars, on what was searched."""
    result = measured.result
    assert result is not None
    assert result.parameters
    figure = new_figure(WIDTH_IN, 0.6 + 1.05 * len(result.parameters))
    rows: Any = figure.subplots(len(result.parameters), 1, squeeze=False)[:, 0]
    for axes, (name, value) in zip(rows, result.parameters.items(), strict=True):
        if value.low is not None and value.high is not None:
            axes.plot([value.low, value.high], [0, 0], color=BLUE, lw=7, solid_capstyle="butt")
        axes.plot(value.value, 0, "|", color=VERMILION, ms=22, mew=3, clip_on=False)
        if not isinstance(measured.fit, str) and name in measured.fit.ranges:
            axes.set_xlim(*measured.fit.ranges[name])
        _scale(axes, name, 5)
        axes.set_ylim(-1, 1)
        axes.set_yticks([])
        axes.grid(axis="y", visible=False)
        axes.set_xlabel(heading(name), parse_math=False)
    rows[0].set_title(f"Curve {measured.number}: values and 90 % intervals")
    return figure


def draw_correlation(measured: Measured) -> Figure:
    """Return the correlations as coloured squares with their numbers."""
    result = measured.result
    assert result is not None
    assert result.correlation is not None
    matrix = np.array(result.correlation, dtype=float)
    names = [label(name) for name in result.order]
    long = any(map(is_effects, result.order))
    figure = new_figure(WIDTH_IN, 4.8 if long else 3.8)
    axes = figure.add_subplot()
    image = axes.imshow(matrix, cmap="PuOr", vmin=-1, vmax=1)
    figure.colorbar(image, ax=axes, label="correlation", shrink=0.6 if long else 1.0)
    ticks = np.arange(len(names))
    size = 8 if long else 10
    axes.set_xticks(ticks, names, parse_math=False, rotation=90 if long else 0, fontsize=size)
    axes.set_yticks(ticks, names, parse_math=False, fontsize=size)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    for (i, j), value in np.ndenumerate(matrix):
        colour = "white" if abs(value) > 0.6 else "black"
        axes.text(j, i, signed(value), ha="center", va="center", color=colour, fontsize=size)
    axes.set_title(f"Curve {measured.number}: correlations")
    return figure


def draw_pairs(answer: Identification) -> Figure:
    """Return the posterior's draws, pair by pair, and each parameter's own distribution."""
    left, names = answer.uncertainty, list(answer.parameters or {})
    assert left is not None
    draws, weight = left.draws.parameters[:, : len(names)], left.draws.weight
    n = len(names)
    figure = new_figure(WIDTH_IN, 0.4 + 1.6 * n)
    grid: Any = figure.subplots(n, n, squeeze=False)
    span = [np.quantile(draws[:, i], [0.001, 0.999]) for i in range(n)]
    for i, j in np.ndindex(n, n):
        axes = grid[i, j]
        if j > i:
            axes.set_visible(False)
            continue
        wide = [(float(a), float(b)) if b > a else (float(a) - 1, float(b) + 1) for a, b in span]
        if i == j:
            axes.hist(draws[:, i], bins=40, range=wide[i], weights=weight, color=BLUE)
            axes.set_yticks([])
        else:
            counts, x, y = np.histogram2d(
                draws[:, j], draws[:, i], bins=40, range=[wide[j], wide[i]], weights=weight
            )
            axes.pcolormesh(x, y, counts.T, cmap="Blues", rasterized=True)
        axes.grid(visible=False)
        axes.tick_params(labelsize=7, labelbottom=i == n - 1, labelleft=j == 0 and i > 0)
        axes.locator_params(nbins=4)
        if i == n - 1:
            axes.set_xlabel(heading(names[j]), parse_math=False, fontsize=8)
        if j == 0 and i > 0:
            axes.set_ylabel(heading(names[i]), parse_math=False, fontsize=8)
    figure.suptitle("What the curves leave open")
    return figure


def draw_all_curves(curves: Sequence[Measured]) -> Figure:
    """Return all curves, deflection against pressure."""
    figure = new_figure(WIDTH_IN, 4.2)
    axes = figure.add_subplot()
    named = len(curves) <= MOST_NAMED
    for k, measured in enumerate(curves):
        curve = measured.curve
        axes.plot(
            curve.pressure_mbar,
            curve.deflection_mm,
            color=SERIES[k % len(SERIES)] if named else GREY,
            ls=_DASHES[k // len(SERIES) % len(_DASHES)] if named else "-",
            lw=1.4,
            rasterized=len(curve) > _MANY,
            label=f"{measured.number}: {curve.setup.aperture_mm:g} mm",
        )
    if named:
        axes.legend(
            title="curve: opening", fontsize=8, ncols=1 + len(curves) // 8, title_fontsize=8
        )
    axes.set_xlabel(PRESSURE)
    axes.set_ylabel(DEFLECTION)
    axes.set_title("All curves")
    return figure


def draw_all_intervals(curves: Sequence[Measured]) -> Figure:
    """Return the parameters of all curves that have some, one below the other."""
    found = [(m.number, m.result.parameters) for m in curves if m.result and m.result.parameters]
    names = of_law(values for _, values in found)
    figure = new_figure(WIDTH_IN, 1.6 + 0.25 * len(found))
    columns: Any = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
    for axes, name in zip(columns, names, strict=True):
        for row, (_, values) in enumerate(found):
            value = values.get(name)
            if value is None:
                continue
            if value.low is not None and value.high is not None:
                axes.plot(
                    [value.low, value.high], [row, row], color=BLUE, lw=5, solid_capstyle="butt"
                )
            axes.plot(value.value, row, "|", color=VERMILION, ms=13, mew=2.5, clip_on=False)
        axes.set_ylim(len(found) - 0.5, -0.5)
        axes.set_yticks(range(len(found)), [str(number) for number, _ in found])
        _scale(axes, name, 2)
        axes.set_xlabel(heading(name))
    columns[0].set_ylabel("curve")
    figure.suptitle("Values and 90 % intervals of all curves")
    return figure


def _points(axes: Axes, measured: Measured) -> None:
    curve = measured.curve
    _scatter(axes, curve.pressure_mbar, curve.deflection_mm, curve.phase)
    _ring(axes, measured, curve.pressure_mbar)


def _ring(axes: Axes, measured: Measured, x: Array) -> None:
    """Put a ring around each sample that was left out as a glitch."""
    out, curve = left_out(measured), measured.curve
    if out:
        axes.plot(
            x[out], curve.deflection_mm[out], "o", mfc="none", mec="black", mew=1.5, ms=9,
            label="left out: glitch",
        )  # fmt: skip


def left_out(measured: Measured) -> list[int]:
    """Return which samples of a curve were left out as glitches."""
    said = () if measured.result is None else measured.result.outliers
    return [i for i in said if 0 <= i < len(measured.curve)]


def _scatter(axes: Axes, x: Any, y: Any, phase: Any) -> None:
    for name, (colour, marker) in _PHASES.items():
        chosen = phase == name
        if chosen.any():
            axes.plot(
                x[chosen],
                y[chosen],
                marker,
                color=colour,
                ms=3.5,
                alpha=0.8,
                rasterized=len(x) > _MANY,
                label=name,
            )


def _scale(axes: Axes, name: str, ticks: int) -> None:
    """Give a stiffness, or a wide range, a logarithmic axis; few ticks, so that none touch."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    low, high = axes.get_xlim()
    stiffness = name.endswith("_MPa")
    if low <= 0.0 or not (stiffness or high / low > _WIDE_RATIO):
        axes.xaxis.set_major_locator(MaxNLocator(ticks))
        return
    decades = np.log10(high / low)
    axes.set_xscale("log")
    if decades < _NARROW:
        axes.xaxis.set_major_locator(MaxNLocator(ticks))
    else:
        subs = (1.0,) if decades > _WIDE else (1.0, 2.0, 5.0)
        axes.xaxis.set_major_locator(LogLocator(subs=subs, numticks=12))
    axes.set_xlim(low, high)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
