"""Figures 7, 8a and 8b: what N_b and N/N_b do to the blind test."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.stats import linregress, spearmanr

from skinlab.reproduction.cases import BLIND_TRUTH, Blind
from skinlab.reproduction.jobs import Found, Identify, Job, Results
from skinlab.reproduction.part import Cell, Comparison, Part, Table
from skinlab.reproduction.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_LABELS = ("X1", "X2", "ν")


def _runs(study: Study, samples: int, best: int, repeats: int) -> list[Identify]:
    options = study.sto(samples, best)
    return [Identify(Blind(), "sto", options, study.seed, run) for run in range(repeats)]


def _sweep(study: Study) -> dict[int, list[Identify]]:
    """Return the runs behind each N_b of Figures 7 and 8a."""
    n = study.sweep_samples
    return {b: _runs(study, n, b, study.sweep_repeats) for b in study.best if b <= n}


def _ratios(study: Study) -> dict[tuple[int, int], list[Identify]]:
    """Return the runs behind each (N, N_b) of Figure 8b; N_b = N would never close in."""
    return {
        (n, b): _runs(study, n, b, study.ratio_repeats(n))
        for n in study.ratio_samples
        for b in study.best
        if b < n
    }


def jobs(study: Study) -> list[Job]:
    """Return the runs of the three figures."""
    groups = [*_sweep(study).values(), *_ratios(study).values()]
    return [run for group in groups for run in group]


def parts(study: Study, results: Results) -> list[Part]:
    """Return Figures 7, 8a and 8b."""
    sweep: dict[int, list[Found]] = {
        best: [results[run] for run in runs] for best, runs in _sweep(study).items()
    }
    return [_figure_7(study, sweep), _figure_8a(study, sweep), _figure_8b(study, results)]


def _figure_7(study: Study, sweep: dict[int, list[Found]]) -> Part:
    best = np.array(list(sweep))
    ratio = np.array([[f.parameters / BLIND_TRUTH for f in found] for found in sweep.values()])
    mean, sd = ratio.mean(axis=1), ratio.std(axis=1, ddof=1)
    rows: list[tuple[Cell, ...]] = [
        (int(b), study.sweep_repeats, *map(float, m), *map(float, s))
        for b, m, s in zip(best, mean, sd, strict=True)
    ]
    # How far a single case is from the truth: rms over the cases, in the worst of the unknowns.
    miss = np.sqrt(((ratio - 1.0) ** 2).mean(axis=1)).max(axis=1)

    def typical(of: Array, chosen: NDArray[np.bool_]) -> float:
        return float(np.median(of[chosen])) if chosen.any() else float("nan")

    few, middle, many = best < 10, (best >= 10) & (best <= 50), best > 50
    worst = sd.max(axis=1)
    return Part(
        "figure_7",
        f"Figure 7: influence of N_b, N = {study.sweep_samples}",
        Table(
            (
                "N_b",
                "cases",
                "X1_over_true",
                "X2_over_true",
                "nu_over_true",
                "sd_X1_over_true",
                "sd_X2_over_true",
                "sd_nu_over_true",
            ),
            tuple(rows),
        ),
        (
            Comparison(
                "for N_b < 10 the identification error is significant",
                "large ratios",
                f"cases scatter by {typical(worst, few):.0%} for N_b < 10, by "
                f"{typical(worst, middle):.0%} for 10 to 50",
                typical(worst, few) > 1.5 * typical(worst, middle),
            ),
            Comparison(
                "above 10 the parameters remain stable",
                "ratios near 1",
                f"a case misses by {typical(miss, middle):.0%} for 10 to 50",
                typical(miss, middle) < 0.15,
                "the scatter is small, but the mean is off: the box has lost the optimum",
            ),
            Comparison(
                "the accuracy seems to decrease for N_b > 50",
                "larger ratios",
                f"a case misses by {typical(miss, many):.0%} above 50, by "
                f"{typical(miss, middle):.0%} for 10 to 50",
                typical(miss, many) > typical(miss, middle),
                "the scatter still falls, but the mean moves further off along the valley",
            ),
        ),
        "Mean and standard deviation over random cases of identified / true; a miss is the root "
        "mean square deviation of a single case, in the worst of the three.",
        draw=partial(_draw_7, best, mean, sd),
    )


def _draw_7(best: Array, mean: Array, sd: Array, figure: Figure) -> None:
    ax = figure.subplots()
    for d, (label, marker) in enumerate(zip(_LABELS, "os^", strict=True)):
        ax.errorbar(
            best * 1.03 ** (d - 1), mean[:, d], sd[:, d],
            fmt=marker + "-", ms=4, lw=1, capsize=2, label=label,
        )  # fmt: skip
    ax.axhline(1.0, color="0.5", lw=0.8)
    ax.set_xscale("log")
    ax.set_xticks(best, [f"{b:g}" for b in best], fontsize=8)
    ax.minorticks_off()
    ax.set_xlabel("N_b, best candidates that span the next box")
    ax.set_ylabel("identified / true (mean ± sd)")
    ax.legend(frameon=False)


def _figure_8a(study: Study, sweep: dict[int, list[Found]]) -> Part:
    best = np.array(list(sweep), dtype=float)
    counts = np.array([[f.iterations for f in found] for found in sweep.values()], dtype=float)
    mean, sd = counts.mean(axis=1), counts.std(axis=1, ddof=1)
    rows: list[tuple[Cell, ...]] = [
        (int(b), study.sweep_repeats, float(m), float(s))
        for b, m, s in zip(best, mean, sd, strict=True)
    ]
    # Nothing but zero iterations in both would be a straight line through no points.
    line = linregress(best, mean) if len(best) > 2 else None
    straight = 0.0 if line is None else float(line.rvalue) ** 2
    slope, start = (0.0, 0.0) if line is None else (float(line.slope), float(line.intercept))
    return Part(
        "figure_8a",
        f"Figure 8a: iterations against N_b, N = {study.sweep_samples}",
        Table(("N_b", "cases", "iterations", "sd_iterations"), tuple(rows)),
        (
            Comparison(
                "the number of iterations increases linearly with N_b",
                "a straight line",
                f"iterations ≈ {start:.0f} + {slope:.2f} N_b, R² = {straight:.3f}",
                straight > 0.95 and slope > 0,
            ),
        ),
        draw=partial(_draw_8a, best, mean, sd, (start, slope)),
    )


def _draw_8a(
    best: Array, mean: Array, sd: Array, line: tuple[float, float], figure: Figure
) -> None:
    ax = figure.subplots()
    ax.errorbar(best, mean, sd, fmt="o", ms=4, capsize=2, label="mean ± sd")
    x = np.array([0.0, best.max()])
    ax.plot(x, line[0] + line[1] * x, "-", color="0.5", lw=1, label="straight line")
    ax.set_xlabel("N_b")
    ax.set_ylabel("iterations until E changes by less than 10⁻⁵ µm")
    ax.set_ylim(bottom=0.0)
    ax.legend(frameon=False)


def _figure_8b(study: Study, results: Results) -> Part:
    rows: list[tuple[Cell, ...]] = []
    for (samples, best), runs in _ratios(study).items():
        found: list[Found] = [results[run] for run in runs]
        iterations = float(np.mean([f.iterations for f in found]))
        settled = sum(f.converged for f in found)
        rows.append((samples, best, samples / best, len(runs), iterations, settled))
    ranks = []
    for samples in study.ratio_samples:
        pairs = np.array([(row[2], row[4]) for row in rows if row[0] == samples], dtype=float)
        ranks.append(float(spearmanr(pairs[:, 0], pairs[:, 1]).statistic))
    return Part(
        "figure_8b",
        "Figure 8b: iterations against N / N_b",
        Table(("N", "N_b", "N_over_N_b", "cases", "iterations", "settled"), tuple(rows)),
        (
            Comparison(
                "the number of iterations decreases as N / N_b increases",
                "for every study case",
                f"rank correlation for each N: {min(ranks):.2f} to {max(ranks):.2f}, "
                f"{len(rows)} pairs (N, N_b)",
                max(ranks) < -0.9,
                "at the same ratio a larger N takes more iterations: N_b alone says more (8a)",
            ),
        ),
        "All pairs with N_b < N; with N_b = N the box would not close in. At most 500 iterations.",
        draw=partial(_draw_8b, study.ratio_samples, rows),
    )


def _draw_8b(samples: tuple[int, ...], rows: list[tuple[Cell, ...]], figure: Figure) -> None:
    from matplotlib import colormaps

    ax = figure.subplots()
    colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(samples)))
    for colour, n in zip(colours, samples, strict=True):
        mine = sorted((float(r[2] or 0), float(r[4] or 0)) for r in rows if r[0] == n)
        ax.plot(*np.array(mine).T, "o-", ms=3, lw=1, color=colour, label=f"{n}")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlabel("N / N_b")
    ax.set_ylabel("iterations")
    figure.legend(title="N", loc="outside right center", frameon=False)
