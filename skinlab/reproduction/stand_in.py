"""Figures 9 to 12, on the stand-in for Figure 3's curve."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skinlab.reproduction import tables
from skinlab.reproduction.cases import StandIn, model_mm
from skinlab.reproduction.jobs import Found, Job, Results
from skinlab.reproduction.part import Cell, Comparison, Part, Table
from skinlab.reproduction.published_values import PAPER_BOX
from skinlab.reproduction.scatter import NAMES, Scatter, row_words
from skinlab.reproduction.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_LABELS = ("X1 (MPa)", "X2 (MPa)", "ν")
_DECIDES = "the stand-in's valley decides"
_OPEN_UM = 0.1  # of E above its least: what the valley's width is measured at
_SHOWN_N = 1000


def jobs(study: Study) -> list[Job]:
    """Return nothing: Table 2 needs the same runs."""
    del study
    return []


def parts(study: Study, results: Results) -> list[Part]:
    """Return Figures 9 to 12 and the valley."""
    return [
        _figure_9(study, results),
        _figure_10(study, results),
        _figure_11(study, results),
        _figure_12(study, results),
        _valley(study, results),
    ]


def _shown_n(study: Study) -> int:
    return _SHOWN_N if _SHOWN_N in study.samples else study.samples[-1]


def _cases(study: Study, results: Results, samples: int) -> list[Found]:
    runs = tables.stochastic(study, StandIn(), samples, study.repeats)
    return [results[run] for run in runs]


def _figure_9(study: Study, results: Results) -> Part:
    n = _shown_n(study)
    found = _cases(study, results, n)[0]
    pressure, measured = StandIn().measured()
    fitted = model_mm(found.parameters[None])[0]
    rows: list[tuple[Cell, ...]] = [
        (float(p), float(m), float(w), float(1e3 * (m - w)))
        for p, m, w in zip(pressure, measured, fitted, strict=True)
    ]
    rms = 1e3 * float(np.sqrt(np.mean((measured - fitted) ** 2)))
    return Part(
        "figure_9",
        f"Figure 9: the stand-in and the identified curve, N = {n}",
        Table(("pressure_mbar", "stand_in_mm", "identified_mm", "difference_um"), tuple(rows)),
        (
            Comparison(
                "the results are in agreement",
                "by eye, E = 2 µm",
                f"by eye too; E = {found.error_um:.2f} µm is {rms:.1f} µm root mean square",
                None,
                "the stand-in was made so. E divides by the number of samples and not by its "
                "root: 2 µm of E are five times the sensor's noise, and a sign of missing physics "
                "if the curve was a real one",
            ),
        ),
        f"First random case: X1, X2, ν = {', '.join(row_words(found.parameters))}.",
        draw=partial(_draw_9, pressure, measured, fitted),
        size=(7.0, 5.5),
    )


def _draw_9(pressure: Array, measured: Array, fitted: Array, figure: Figure) -> None:
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    top.plot(pressure, measured, "D", ms=3.5, label="stand-in for the experimental curve")
    top.plot(pressure, fitted, "-", color="C3", lw=1.5, label="identified curve")
    top.set_ylabel("deflection (mm)")
    top.legend(frameon=False)
    bottom.plot(pressure, 1e3 * (measured - fitted), "D-", ms=3, lw=0.8)
    bottom.axhline(0.0, color="0.5", lw=0.8)
    bottom.set_ylabel("difference (µm)")
    bottom.set_xlabel("pressure (mbar)")


def _figure_10(study: Study, results: Results) -> Part:
    traces: dict[float, Array] = {
        f: results[tables.recursive(study, StandIn(), f)].passes for f in tables.FORGETTING
    }
    rows: list[tuple[Cell, ...]] = [
        (f, number, *map(float, row[:3]), float(row[3]))
        for f, passes in traces.items()
        for number, row in enumerate(passes, start=1)
    ]
    comparisons = [said for f, passes in traces.items() for said in _said_of_passes(f, passes)]
    return Part(
        "figure_10",
        "Figure 10: recursive least squares on the stand-in, pass by pass",
        Table(("lambda0", "pass", *NAMES, "E_um"), tuple(rows)),
        tuple(comparisons),
        "From the minimal values of the box, P = I in the paper's units (MPa, MPa, 1; deflection "
        "in mm), C = 10⁻⁵ µm. λ0 is 0.9 in the paper's text and 0.99 in this figure's caption.",
        draw=partial(_draw_10, traces),
        size=(8.0, 6.5),
    )


def _said_of_passes(forgetting: float, passes: Array) -> list[Comparison]:
    """Return what the paper says of the passes, for one λ0."""
    low, high = PAPER_BOX.bounds
    error, unit = passes[:, 3], PAPER_BOX.to_unit(passes[:, :3])
    at_bound = np.asarray(((unit <= 1e-5) | (unit >= 1 - 1e-5)).any(axis=1))
    soon = int(np.argmax(error <= error.min() + 0.1)) + 1
    later = passes[soon:] if soon < len(passes) else passes[-1:]
    swing = float((np.ptp(later[:, :3], axis=0) / (high - low)).max())
    touched = f"first after pass {int(np.argmax(at_bound)) + 1}" if at_bound.any() else "never"
    return [
        Comparison(
            f"λ0 = {forgetting:g}: RLS finds the solution soon and oscillates around it",
            "least error around the 10th iteration",
            f"E is within 0.1 µm of its least ({error.min():.2f} µm) after pass {soon}; later an "
            f"unknown swings over {swing:.0%} of the box, and E up to {later[:, 3].max():.0f} µm",
            None,
            _DECIDES,
        ),
        Comparison(
            f"λ0 = {forgetting:g}: it destabilises until it reaches the bounds",
            "ends at the bounds",
            f"at a bound after {int(at_bound.sum())} of {len(passes)} passes, {touched}; ends "
            + ("at one" if at_bound[-1] else "inside"),
            None,
            "the curve decides: "
            + (
                "here the valley leads out" if at_bound[-1] else "here the valley leads back inside"
            ),
        ),
    ]


def _draw_10(traces: dict[float, Array], figure: Figure) -> None:
    axes = figure.subplots(2, 2, sharex=True).ravel()
    for ax, label, column in zip(axes, (*_LABELS, "E (µm)"), range(4), strict=True):
        for f, passes in traces.items():
            numbers = np.arange(1, len(passes) + 1)
            ax.plot(numbers, passes[:, column], "o-", ms=2.5, lw=0.9, label=f"λ0 = {f:g}")
        ax.set_ylabel(label)
    axes[3].set_yscale("log")
    axes[3].yaxis.set_major_formatter("{x:g}")
    axes[3].yaxis.set_minor_formatter("{x:g}")
    for ax in axes[2:]:
        ax.set_xlabel("pass over the curve")
    axes[0].legend(frameon=False)


def _figure_11(study: Study, results: Results) -> Part:
    scatters = {n: Scatter.of(_cases(study, results, n)) for n in study.samples}
    rows: list[tuple[Cell, ...]] = [
        (n, study.repeats, *map(float, s.mean), *map(float, s.sd), float(s.error_um.mean()),
         float(s.error_um.std(ddof=1)))
        for n, s in scatters.items()
    ]  # fmt: skip
    sds = np.array([s.sd for s in scatters.values()])
    first, *others = scatters.values()
    # Means of many cases are known to their standard deviation over the root of their number.
    standard_error = np.sqrt((first.sd**2 + others[-1].sd ** 2) / study.repeats)
    apart = float((np.abs(first.mean - others[-1].mean) / standard_error).max())
    return Part(
        "figure_11",
        f"Figure 11: mean and scatter of {study.repeats} random cases against N, stand-in",
        Table(
            ("N", "cases", *NAMES, "sd_X1_MPa", "sd_X2_MPa", "sd_nu", "E_um", "sd_E_um"),
            tuple(rows),
        ),
        (
            Comparison(
                "more samples reduce the standard deviation",
                "it falls with N",
                "standard deviation of ν " + tables._series(scatters, sds[:, 2]),
                None,
                f"{_DECIDES}; on the blind test it falls too (Table 1)",
            ),
            Comparison(
                f"the means of N = {study.samples[0]} differ from those of more samples",
                "clearly different",
                f"N = {study.samples[0]}: {', '.join(row_words(first.mean))}; "
                f"N = {study.samples[-1]}: {', '.join(row_words(others[-1].mean))}; "
                f"{apart:.1f} standard errors apart",
                None,
                f"{_DECIDES}. N = {study.samples[0]} breaks the paper's own rule, eq. (10), which "
                "asks for 459; along the valley the box then ends early and anywhere",
            ),
            Comparison(
                f"those of N = {study.samples[-2]} and of N = {study.samples[-1]} are alike",
                "3.1 and 3.06 MPa in Table 2",
                f"X2 {scatters[study.samples[-2]].mean[1]:.2f} and {others[-1].mean[1]:.2f} MPa",
                None,
                f"{_DECIDES}: along the valley E hardly changes (see the end): the more samples, "
                "the further down it the box closes",
            ),
        ),
        draw=partial(_draw_11, scatters),
        size=(9.0, 3.4),
    )


def _draw_11(scatters: dict[int, Scatter], figure: Figure) -> None:
    axes = figure.subplots(1, 3)
    numbers = list(scatters)
    for d, ax in enumerate(axes):
        mean = [s.mean[d] for s in scatters.values()]
        sd = [s.sd[d] for s in scatters.values()]
        ax.errorbar(numbers, mean, sd, fmt="o", ms=5, capsize=4)
        ax.set_xscale("log")
        ax.set_xlim(0.5 * numbers[0], 2.0 * numbers[-1])
        ax.set_xlabel("N")
        ax.set_ylabel(f"{_LABELS[d]}, mean ± sd")


def _figure_12(study: Study, results: Results) -> Part:
    n = _shown_n(study)
    found = _cases(study, results, n)
    scatter = Scatter.of(found)
    rows: list[tuple[Cell, ...]] = [
        (number, *map(float, f.parameters), f.error_um) for number, f in enumerate(found, start=1)
    ]
    spread = scatter.sd / scatter.mean
    return Part(
        "figure_12",
        f"Figure 12: the identified parameters of {study.repeats} random cases, N = {n}, stand-in",
        Table(("case", *NAMES, "E_um"), tuple(rows)),
        (
            Comparison(
                "the standard deviation is low beside the mean",
                "low values",
                f"{spread[0]:.0%} of X1, {spread[1]:.0%} of X2, {spread[2]:.0%} of ν",
                None,
                f"{_DECIDES}; and the scatter of restarts is not the uncertainty: see the valley "
                "below",
            ),
        ),
        draw=partial(_draw_12, scatter),
        size=(7.0, 5.5),
    )


def _draw_12(scatter: Scatter, figure: Figure) -> None:
    axes = figure.subplots(3, 1, sharex=True)
    numbers = np.arange(1, len(scatter.error_um) + 1)
    for d, ax in enumerate(axes):
        ax.plot(numbers, scatter.parameters[:, d], "o", ms=4)
        ax.axhline(scatter.mean[d], color="C3", lw=1)
        ax.axhspan(*(scatter.mean[d] + scatter.sd[d] * np.array([-1, 1])), color="C3", alpha=0.12)
        ax.set_ylabel(_LABELS[d])
    axes[-1].set_xlabel("random case (line: mean; band: ± one standard deviation)")


def _valley(study: Study, results: Results) -> Part:
    floor: list[Found] = [results[job] for job in tables.valley(study)]
    error = np.array([f.error_um for f in floor])
    points = np.array([f.parameters for f in floor])
    open_ = points[error <= error.min() + _OPEN_UM]
    rows: list[tuple[Cell, ...]] = [
        (float(x[2]), float(x[0]), float(x[1]), float(e))
        for x, e in zip(points, error, strict=True)
    ]
    words = "; ".join(
        f"{name} {low:.3g} to {high:.3g}"
        for name, low, high in zip(_LABELS, open_.min(axis=0), open_.max(axis=0), strict=True)
    )
    return Part(
        "valley",
        "Beside the paper: the valley that explains Figures 10 to 12",
        Table(("nu", "X1_MPa", "X2_MPa", "least_E_um"), tuple(rows)),
        (),
        "The least E that any X1 and X2 reach at a given ν, on the stand-in. Within "
        f"{_OPEN_UM:g} µm of its least E leaves open: {words}. One curve does not tell these "
        "apart; every method ends somewhere along this line, and the scatter of the stochastic "
        "algorithm's restarts measures where its boxes happen to close, not what the data say.",
        draw=partial(_draw_valley, points, error),
        size=(9.0, 3.4),
    )


def _draw_valley(points: Array, error: Array, figure: Figure) -> None:
    axes = figure.subplots(1, 3)
    nu = points[:, 2]
    for ax, values, label in zip(
        axes,
        (error, points[:, 0], points[:, 1]),
        ("least E at this ν (µm)", "X1 there (MPa)", "X2 there (MPa)"),
        strict=True,
    ):
        ax.plot(nu, values, "o-", ms=4, lw=1)
        ax.set_xlabel("ν")
        ax.set_ylabel(label)
    axes[0].set_ylim(0.0, 1.3 * float(error.max()))
