"""What to measure next: by how much each measurement of a menu would narrow the intervals.

Linearised at draws from the posterior of what is known so far: with H the information (JᵀJ of
whitened residuals) of the data at hand, of the prior and of a further curve, the width of an
interval changes by sqrt(diag (H + H')⁻¹ / diag H⁻¹); the median over the draws is reported. A
further measurement is a placement of its own: its stiffness and its zero differ, as learned or as
expected before data.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.apertures import APERTURES_MM
from skinlab.curves.program import parse_program
from skinlab.errors import NotTrustworthyError
from skinlab.inference.covariance import independent
from skinlab.inference.error_models.placement import expected_sizes
from skinlab.inference.noise import MESH_REST, mesh_error_shapes, slope_mm_per_mbar
from skinlab.inference.posterior import FLAT_PRECISION
from skinlab.inference.problem import LeastSquares
from skinlab.inference.result import Advice
from skinlab.inference.settings import ADVICE
from skinlab.inference.uncertainty import Uncertainty
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.tables.base import Database

Array = NDArray[np.float64]


def advise(
    known: Uncertainty,
    database: Database,
    kappa: KappaConvention,
    thickness_mm: float,
    *,
    placement_scatter: float | None = None,
    rng: np.random.Generator,
) -> list[Advice]:
    """Return the menu's measurements, the one that narrows most first.

    `thickness_mm` is that of the skin; `placement_scatter` what is stated of placements (0: they do
    not differ), used where they were not learned. A measurement in which the model holds for less
    than half of the draws (the skin would crease), or that the database does not speak of, is left
    out.
    """
    space, draws = known.space, known.draws
    chosen = rng.choice(len(draws.weight), ADVICE.draws, p=draws.weight)
    parameters = draws.parameters[chosen]
    turn = space.by_unit(parameters)  # (draws, p, k)
    now = _information(known.parts, parameters, turn) + FLAT_PRECISION * np.eye(turn.shape[2])
    found: list[tuple[float, Advice]] = []
    noise = max(known.errors.noise_um, ADVICE.least_noise_um)
    scatter, zero_mm = _placement_sizes(known, placement_scatter)
    for aperture, top in product(APERTURES_MM, ADVICE.pressures_mbar):
        pressure = np.linspace(0.0, top, ADVICE.points)
        sd = known.relative_thickness_sd * thickness_mm
        try:
            model = database.model(Geometry(aperture, thickness_mm), pressure, kappa, sd)
        except NotTrustworthyError:
            continue
        curves = model.deflection_mm(parameters)
        holds = np.isfinite(curves).all(axis=1) & ~model.creases(parameters)
        held = np.flatnonzero(holds)
        if 2 * len(held) < ADVICE.draws:
            continue
        middle = curves[held[len(held) // 2]]
        sigma = np.hypot(1e-3 * noise, MESH_REST * middle)
        dw_dp = slope_mm_per_mbar(pressure, middle)
        sigma = np.hypot(sigma, known.pressure_noise_mbar * dw_dp)
        placed = np.column_stack([scatter * pressure * dw_dp, np.full(ADVICE.points, zero_mm)])
        shapes = np.hstack([mesh_error_shapes(pressure, middle), placed])
        for rate in ADVICE.rates_mbar_per_s:
            program = parse_program(f"ramp:{top:g}@{rate:g}")
            # A slow ramp has more samples: the few that stand for them are as much surer.
            fewer = np.sqrt(ADVICE.points / (program.duration_s * ADVICE.sampling_hz + 1.0))
            misfit = model.misfit(middle, independent(fewer * sigma, shapes))
            more = _information([misfit], parameters[held], turn[held])
            ratios = np.median(_ratios(now[held], more, turn[held]), axis=0)
            narrows = dict(zip(known.names, ratios.tolist(), strict=False))
            score = float(np.mean(np.log(list(narrows.values()))))
            found.append((score, Advice(aperture, str(program), narrows)))
    found.sort(key=lambda item: item[0])
    return [advice for _, advice in found]


def _placement_sizes(known: Uncertainty, stated: float | None) -> tuple[float, float]:
    """Return by how much placements differ: log stiffness, and zero in mm."""
    learned = known.errors.placement
    if learned is None:
        return expected_sizes(stated)
    return learned.scatter["value"], 1e-3 * learned.offset_um["value"]


def _information(parts: Sequence[LeastSquares], parameters: Array, turn: Array) -> Array:
    """Return JᵀJ (n, k, k) by the cube's coordinates at parameters (n, p); zero without a model."""
    total = np.zeros((len(parameters), turn.shape[2], turn.shape[2]))
    for part in parts:
        slopes = part.slopes(parameters) @ turn
        total += np.nan_to_num(np.einsum("nmk,nml->nkl", slopes, slopes))
    return total


def _ratios(now: Array, more: Array, turn: Array) -> Array:
    """Return the ratios (n, p) of standard deviations with and without `more`."""
    before, after = (
        np.sqrt(np.einsum("npk,nkl,npl->np", turn, np.linalg.inv(h), turn))
        for h in (now, now + more)
    )
    return np.asarray(after / before)
