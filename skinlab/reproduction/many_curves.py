"""Figure 13: the errors of many simulated curves."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skinlab.reproduction.cases import NOISE_MM, PRESSURE_NOISE_MBAR, Skin
from skinlab.reproduction.jobs import Found, Identify, Job, Results
from skinlab.reproduction.part import Cell, Comparison, Part, Table
from skinlab.reproduction.published_values import FIGURE_13_MEAN_UM, FIGURE_13_SD_UM
from skinlab.reproduction.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


def _runs(study: Study) -> list[Identify]:
    options = study.sto(1000)
    return [
        Identify(Skin(study.seed, number), "sto", options, study.seed)
        for number in range(study.curves)
    ]


def jobs(study: Study) -> list[Job]:
    """Return one identification for each skin."""
    return [*_runs(study)]


def parts(study: Study, results: Results) -> list[Part]:
    """Return Figure 13."""
    found: list[Found] = [results[run] for run in _runs(study)]
    truths = [Skin(study.seed, number).truth() for number in range(study.curves)]
    error = np.array([f.error_um for f in found])
    rows: list[tuple[Cell, ...]] = [
        (number, *map(float, x), h, *map(float, f.parameters), f.error_um, int(f.converged))
        for number, ((x, h), f) in enumerate(zip(truths, found, strict=True), start=1)
    ]
    thickness = np.array([h for _, h in truths])
    off = np.array([f.parameters[0] / x[0] for (x, _), f in zip(truths, found, strict=True)])
    thick = thickness > 1.4
    mean, sd = float(error.mean()), float(error.std(ddof=1))
    words = (
        f"X1 comes out {off[thick].mean():.1f} times too high where the skin is thicker than "
        f"1.4 mm, with E = {error[thick].mean():.2f} µm, which nobody would notice"
        if thick.any()
        else "no skin is thicker than 1.4 mm"
    )
    table = Table(
        (
            "curve",
            "true_X1_MPa",
            "true_X2_MPa",
            "true_nu",
            "true_thickness_mm",
            "X1_MPa",
            "X2_MPa",
            "nu",
            "E_um",
            "settled",
        ),
        tuple(rows),
    )
    return [
        Part(
            "figure_13",
            f"Figure 13: the identification errors of {study.curves} simulated curves",
            table,
            (
                Comparison(
                    f"E is {FIGURE_13_MEAN_UM:g} ± {FIGURE_13_SD_UM:g} µm over the curves",
                    f"{FIGURE_13_MEAN_UM:g} ± {FIGURE_13_SD_UM:g} µm (mean, standard deviation)",
                    f"{mean:.2f} ± {sd:.2f} µm, at most {error.max():.2f} µm",
                    None,
                    "the paper's curves are of real skin. These obey the law and differ from it by "
                    "the sensor's noise and the "
                    "assumed thickness only; the paper's 1.6 µm, 11 µm root mean square with 51 "
                    "samples, must be what the law leaves out of real skin",
                ),
                Comparison(
                    "a small error proves the accuracy of the method",
                    "“which proves the accuracy”",
                    words,
                    bool(thick.any() and abs(off[thick].mean() - 1.0) < 0.2),
                    "the other parameters take up what the wrong thickness does to the curve: a "
                    "small misfit is no proof",
                ),
            ),
            "The paper's 300 curves are of real skin; these are simulated: X1 and X2 log-normal "
            "around 0.025 and 3 MPa (standard deviation 0.3 of the logarithm), ν evenly in "
            "0.22–0.46, thickness evenly in 0.8–1.6 mm while 1 mm is assumed for everybody, as in "
            f"the paper; {1e3 * NOISE_MM:g} µm of noise on the deflection, "
            f"{PRESSURE_NOISE_MBAR:g} mbar on the pressure, both rounded as the sensor does.",
            draw=partial(_draw, error, thickness, off),
            size=(9.0, 3.8),
        )
    ]


def _draw(error: Array, thickness: Array, off: Array, figure: Figure) -> None:
    left, right = figure.subplots(1, 2)
    left.hist(error, bins=np.arange(0.0, max(4.0, error.max()) + 0.1, 0.1), color="C0")
    left.axvline(error.mean(), color="C3", lw=1.2, label=f"mean {error.mean():.2f} µm")
    left.axvline(
        FIGURE_13_MEAN_UM, color="0.4", lw=1.2, ls="--", label=f"paper {FIGURE_13_MEAN_UM:g} µm"
    )
    left.set_xlabel("error E (µm)")
    left.set_ylabel("curves")
    left.legend(frameon=False)
    right.plot(thickness, off, "o", ms=3, alpha=0.6)
    right.axhline(1.0, color="0.5", lw=0.8)
    right.set_ylim(bottom=0.0)
    right.set_xlabel("true thickness (mm); 1 mm is assumed")
    right.set_ylabel("identified / true X1")
