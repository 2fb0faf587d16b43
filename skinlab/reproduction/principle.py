"""Figure 4a, the simulated space, and Figure 6, how the algorithm closes in."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.methods import stochastic
from skinlab.inference.problem import Options, Problem
from skinlab.reproduction.cases import BLIND_TRUTH, PRESSURE_MBAR, Blind, problem
from skinlab.reproduction.jobs import Job, NeoHookean, Plane, Results
from skinlab.reproduction.part import Cell, Comparison, Part, Table
from skinlab.reproduction.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_SHOWN_MBAR = (10.0, 30.0, 100.0)
_N, _N_B, _DRAWS = 67, 8, 4  # Figure 6's caption, and how many iterations are shown


def jobs(study: Study) -> list[Job]:
    """Return the curves of Figure 4a: the paper's X1 and ν, without X2."""
    return [NeoHookean(x1, nu) for x1 in study.X1_MPa for nu in study.nu]


def parts(study: Study, results: Results) -> list[Part]:
    """Return Figures 4a and 6."""
    return [_figure_4a(study, results), _figure_6(study)]


def _figure_4a(study: Study, results: Results) -> Part:
    curves = np.array([[results[NeoHookean(x, nu)] for nu in study.nu] for x in study.X1_MPa])
    rows: list[tuple[Cell, ...]] = [
        (x1, nu, p, w)
        for i, x1 in enumerate(study.X1_MPa)
        for j, nu in enumerate(study.nu)
        for p, w in zip(PRESSURE_MBAR.tolist(), curves[i, j].tolist(), strict=True)
    ]
    whole = int(np.isfinite(curves[..., -1]).sum())
    at_100 = Comparison(
        "the space is filled: a deflection for every X1 and ν, to 100 mbar",
        "a surface for each step of pressure",
        f"{whole} of {curves[..., -1].size} combinations reach 100 mbar",
        whole == curves[..., -1].size,
        "without X2 soft skin folds at the tape's edge before that; a coarse or reduced mesh may "
        "go on, and the numbers then depend on the mesh. We give none there",
    )
    return Part(
        "figure_4a",
        "Figure 4a: the simulated space of a compressible neo-Hookean law",
        Table(("X1_MPa", "nu", "pressure_mbar", "deflection_mm"), tuple(rows)),
        (at_100,),
        "The paper's law without X2, by the finite elements, on the paper's X1 and ν: the apex "
        "falls with either, and a stiffer skin looks much like a less compressible one.",
        draw=partial(_draw_4a, study, curves),
        size=(9.0, 3.6),
    )


def _draw_4a(study: Study, curves: Array, figure: Figure) -> None:
    from matplotlib import colormaps

    axes = figure.subplots(1, len(_SHOWN_MBAR), sharex=True)
    colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(study.nu)))
    for ax, pressure in zip(axes, _SHOWN_MBAR, strict=True):
        at = int(np.searchsorted(PRESSURE_MBAR, pressure))
        for j, nu in enumerate(study.nu):
            ax.plot(
                study.X1_MPa, curves[:, j, at], "o-", ms=3, lw=1, color=colours[j], label=f"{nu:g}"
            )
        ax.set_title(f"p = {pressure:g} mbar")
        ax.set_xlabel("X1 (MPa)")
        ax.set_xlim(0.0, 0.105)
        ax.set_ylim(bottom=0.0)
    axes[0].set_ylabel("apex deflection (mm)")
    figure.legend(*axes[0].get_legend_handles_labels(), title="ν", loc="outside right center")


def _figure_6(study: Study) -> Part:
    """Two unknowns, Y1 = X1 and Y2 = ν, of the blind test, with X2 at its true value."""
    whole = problem(Blind())
    plane = Plane(1, BLIND_TRUTH[1])
    asked = Problem(plane, whole.misfit, whole.points)
    draws: list[stochastic.Draw] = []
    stochastic.identify(
        asked,
        Options(samples=_N, best=_N_B, most_iterations=_DRAWS),
        np.random.default_rng([study.seed, 0]),
        watch=draws.append,
    )
    rows: list[tuple[Cell, ...]] = []
    for number, draw in enumerate(draws):
        best = set(draw.elite.tolist())
        points = plane.from_unit(draw.candidates)
        for k, ((x1, _, nu), error) in enumerate(zip(points, draw.error_um, strict=True)):
            rows.append((number, float(x1), float(nu), float(error), int(k in best)))
    lost = next(
        (n for n, d in enumerate(draws) if not _inside(plane, d, np.array(BLIND_TRUTH))), None
    )
    comparison = Comparison(
        "the boxes close in on the optimum",
        "Figure 6, steps 0 to 2",
        "all boxes shown contain the true values"
        if lost is None
        else f"box {lost} no longer contains the true values",
        lost is None,
        ""
        if lost is None
        else "the box shrinks along each axis by itself and may pass the optimum",
    )
    return Part(
        "figure_6",
        f"Figure 6: the algorithm at work, N = {_N}, N_b = {_N_B}, two unknowns",
        Table(("iteration", "X1_MPa", "nu", "E_um", "among_best"), tuple(rows)),
        (comparison,),
        "Y1 is X1 and Y2 is ν, on the blind test's curve with X2 kept at its true value.",
        draw=partial(_draw_6, plane, draws),
        size=(8.0, 6.6),
    )


def _inside(plane: Plane, draw: stochastic.Draw, truth: Array) -> bool:
    unit = plane.to_unit(truth)
    return bool(((unit >= draw.low) & (unit <= draw.high)).all())


def _draw_6(plane: Plane, draws: list[stochastic.Draw], figure: Figure) -> None:
    def xy(unit: Array) -> tuple[Array, Array]:
        parameters = plane.from_unit(unit)
        return parameters[..., 0], parameters[..., 2]

    axes = figure.subplots(2, 2).ravel()
    for number, (ax, draw) in enumerate(zip(axes, draws, strict=True)):
        best = np.zeros(len(draw.candidates), dtype=bool)
        best[draw.elite] = True
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=float)
        box = draw.low + (draw.high - draw.low) * corners
        ax.plot(*xy(box), "-", color="0.5", lw=1, label="box of this draw")
        ax.plot(
            *xy(draw.candidates[~best]), "o", ms=3, color="0.65", label=f"the other {_N - _N_B}"
        )
        ax.plot(*xy(draw.candidates[best]), "o", ms=5, color="C0", label=f"the {_N_B} best")
        elite = draw.candidates[best]
        low, high = elite.min(axis=0), elite.max(axis=0)
        ax.plot(*xy(low + (high - low) * corners), "-", color="C0", lw=1.5, label="next box")
        ax.plot(BLIND_TRUTH[0], BLIND_TRUTH[2], "+", ms=14, mew=2, color="C3", label="truth")
        ax.set_title(f"iteration {number}")
        ax.set_xlabel("Y1 = X1 (MPa)")
        ax.set_ylabel("Y2 = ν")
    handles = axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=5, frameon=False)
