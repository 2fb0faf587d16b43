"""A curve that was not measured: its program, its record, and the errors that it will have."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import STEP_RATE_MBAR_PER_S, parse_program
from skinlab.discrepancy.campaign_error_models import walk_shapes
from skinlab.discrepancy.campaign_errors import CampaignErrors, Linearised
from skinlab.discrepancy.fit import Fit, Fitter
from skinlab.discrepancy.misfit import mesh_columns
from skinlab.discrepancy.placement_curves import softer_mm, thickness_slopes
from skinlab.discrepancy.records import Record, fitted_lag_s
from skinlab.discrepancy.settings import PLANS
from skinlab.discrepancy.space_mapping import MappedModel
from skinlab.inference.covariance import Covariance, OrnsteinUhlenbeck
from skinlab.inference.error_choice import Node
from skinlab.inference.noise import MESH_REST, slope_mm_per_mbar
from skinlab.mechanics.effects.regulator_lag import RegulatorLag
from skinlab.mechanics.fem.suction import Geometry
from skinlab.tables.model_errors import SeenErrors

Array = NDArray[np.float64]

_STEP = 1e-3  # of an unknown, for slopes


def menu(
    aperture_mm: float, holds_to_mbar: float = math.inf, *, relaxes: bool = False
) -> tuple[str, ...]:
    """Return the programs of an opening, for a skin that creases at a suction.

    Pulses are last: where two programs tell as much in as much time, the gentler one is taken.
    Where an explanation relaxes, many pulses take long to foresee; a jump that is held, with a slow
    ramp behind it, tells creeps apart as well (docs/decisions/0199).
    """
    least = int(PLANS.of_crease * min(holds_to_mbar, 1e4)) // 10 * 10
    top = min(PLANS.tops_mbar[aperture_mm], least)
    if top < PLANS.least_top_mbar:
        return ()
    slow, slow_behind = (math.ceil(top / s) for s in (PLANS.slow_s, PLANS.slow_behind_s))
    at_once = f"{STEP_RATE_MBAR_PER_S:g}"
    jump = f"ramp:{top}@{at_once},hold:10,ramp:0@{at_once},hold:5"
    return (
        f"ramp:{top}@60,ramp:0@60",
        f"ramp:{top}@80,hold:20,ramp:0@80,hold:8",
        f"ramp:{top}@{slow},ramp:0@{slow}",
        *([f"{jump},ramp:{top}@{slow_behind},ramp:0@{slow_behind}"] if relaxes else []),
        f"mode1:{top},1,1,4",
        *([] if relaxes else [f"mode1:{top},1,1,8"]),
    )


@dataclass(frozen=True)
class PlannedErrors:
    """The errors that a further measurement will have."""

    white_um: float
    ou_um: float = 0.0
    ou_s: float = 1.0
    stiffness: float = 0.0  # standard deviations, of each placement
    offset_um: float = 0.0
    thickness: float = 0.0
    wander: float = 0.0  # µm per root second
    sines: tuple[tuple[float, float], ...] = ()  # µm and Hz of breath and pulse, in each curve

    @classmethod
    def of(cls, node: Node) -> PlannedErrors:
        """Return them by one setting of a campaign's errors."""
        known = node.values
        lasting = node.combination.lasting | {"pressure"}
        sizes = node.sizes_um.items()
        alone = [v**2 for n, v in sizes if n not in lasting and not n.startswith("placement")]
        return cls(
            math.sqrt(sum(alone)),
            known.get("ou_um", 0.0),
            known.get("ou_s", 1.0),
            known.get("placement_scatter", 0.0),
            known.get("placement_offset_um", 0.0),
            known.get("placement_thickness", 0.0),
            known.get("wander_um_per_root_s", 0.0),
            tuple(
                (known[f"{part.name}_um"], known[hz])
                for part in node.combination.parts
                if (hz := f"{part.name}_hz") in known
            ),
        )

    @classmethod
    def settings(
        cls, errors: CampaignErrors, explanations: Sequence[Linearised]
    ) -> list[PlannedErrors]:
        """Return a few settings that stand for all by which these explanations explain.

        Those that repeats prefer may not be those that an explanation needs: what it expects of a
        new placement is as uncertain as by its own.
        """
        weighed = errors.weights(explanations)
        weighed.sort(key=lambda one: sum(one[0].sizes_um.values()))
        below = np.cumsum([w for _, w in weighed])
        at = (np.arange(PLANS.settings) + 0.5) / PLANS.settings * below[-1]
        return [cls.of(weighed[i][0]) for i in np.searchsorted(below, at).tolist()]


def rig_lag_s(records: Sequence[Record]) -> float:
    """Return how long the measured suction is behind its program: the median of the curves.

    A rig does not make the corners that are asked for, and these are what tells lags apart.
    """
    found = [
        fitted_lag_s(PressurePath.of_program(program), r.curve.time_s, r.pressure_mbar)
        for r in records
        if r.pressure_sd_mbar and (program := r.curve.program_as_run) is not None
    ]
    return float(np.median(found)) if found else 0.0


def planned_record(
    fitter: Fitter,
    at: Geometry,
    program_text: str,
    creases_mbar: float,
    late_s: float,
    table_errors: SeenErrors | None = None,
) -> Record:
    """Return a record that was not measured, with the campaign's rate and noise."""
    like = fitter.records[0]
    program = parse_program(program_text)
    step_s = float(np.median(np.diff(like.curve.time_s)))
    time = step_s * np.arange(math.floor(program.duration_s / step_s) + 1, dtype=np.float64)
    path = RegulatorLag().felt(PressurePath.of_program(program), {"tau_s": late_s})
    setup = Setup(at.aperture_mm, at.thickness_mm, program)
    pressure = path(time)
    curve = Curve(f"planned, {at.aperture_mm:g} mm", setup, time, pressure, np.zeros(len(time)))
    return Record(
        curve, at, path, pressure, like.pressure_sd_mbar, like.noise_um, creases_mbar=creases_mbar,
        table_errors=table_errors,
    )  # fmt: skip


def expected(
    fitter: Fitter, fit: Fit, records: Sequence[Record]
) -> tuple[list[Array], list[Array]] | None:
    """Return each curve expected (n,), and how it gives way (n, k), a standard deviation each."""
    model = MappedModel(records, fit.unknowns, fitter.domes)
    if not fitter.prepare(model, fit.u, slopes=True):
        return None
    low, high = fit.unknowns.bounds
    k = len(fit.u)
    up, down = np.minimum(_STEP, high - fit.u), np.minimum(_STEP, fit.u - low)
    moved = [fit.u, *(fit.u + np.diag(up)), *(fit.u - np.diag(down))]
    curves = model.predict_many(np.array(moved))
    if not all(np.isfinite(c[0]).all() for c in curves):
        return None
    root = np.linalg.cholesky(np.linalg.inv(fit.information))
    slopes = [
        np.nan_to_num((c[1 : k + 1] - c[k + 1 :]) / np.maximum(up + down, 1e-12)[:, None]).T @ root
        for c in curves
    ]
    return [c[0] for c in curves], slopes


@dataclass(frozen=True, eq=False)
class PlannedCurve:
    """A planned record about the mean of what explanations expect, and how it may be off.

    The mesh is that of the campaign: what each explanation needs of its errors there it expects
    of them again. Two that are apart by what the mesh may do are not told apart by more of it.
    """

    record: Record
    softer_mm: Array  # (n,) dw/d(log softness)
    thicker_mm: Array  # (n,) dw/d(log thickness)
    mesh_mm: Array  # (n, m) shapes in which the mesh errs, a standard deviation each
    mesh_left_mm: Array  # (n, m) the same with what the campaign tells of them
    _fitter: Fitter
    _white: Array  # (u, m) these shapes of the campaign's samples, whitened

    @classmethod
    def of(
        cls, fitter: Fitter, record: Record, like: Fit, expected: Sequence[Array]
    ) -> PlannedCurve:
        """Return it; `expected` are the curves (n,) of explanations, `like` a fit of one."""
        w = np.mean(expected, axis=0)
        c = record.curve
        record = replace(record, curve=Curve(c.name, c.setup, c.time_s, c.pressure_mbar, w))
        shapes = mesh_columns([*fitter.records, record])
        white = fitter.errors.whiten(shapes[: fitter.errors.count])
        new = shapes[fitter.errors.count :]
        values, vectors = np.linalg.eigh(np.eye(white.shape[1]) - white.T @ white)
        # To a higher suction than before the shapes are stretched: none is known too well.
        left = vectors * np.sqrt(np.maximum(values, 0.0))
        thicker = thickness_slopes([record], replace(like, deflections_mm=[w]), fitter.domes)
        return cls(record, softer_mm([record]), thicker, new, new @ left, fitter, white)

    def mesh_expected_mm(self, fit: Fit) -> Array:
        """Return what the mesh is expected to add to the curve (n,) where this fit is right."""
        left = self._fitter.measured - np.concatenate(fit.deflections_mm)
        return np.asarray(self.mesh_mm @ (self._white.T @ self._fitter.errors.whiten(left)))

    def ways_mm(self, fit: Fit, ways_mm: Array) -> Array:
        """Return how the curve gives way (n, k), the mesh's errors with it."""
        root = np.linalg.cholesky(np.linalg.inv(fit.information))
        return np.asarray(ways_mm - self.mesh_mm @ (self._white.T @ fit.jacobian @ root))

    def errors(self, errors: PlannedErrors, placements: int) -> Covariance:
        """Return the covariance of the curve, measured at so many placements, end to end."""
        curve, sd_mbar = self.record.curve, self.record.pressure_sd_mbar
        w, n = curve.deflection_mm, len(curve)
        slope = slope_mm_per_mbar(self.record.pressure_mbar, w)
        variance = (1e-3 * errors.white_um) ** 2 + (slope * sd_mbar) ** 2 + (MESH_REST * w) ** 2
        own = [
            errors.stiffness * self.softer_mm,
            np.full(n, 1e-3 * errors.offset_um),
            errors.thickness * self.thicker_mm,
        ]
        for size_um, hz in errors.sines:
            angle = 2.0 * np.pi * hz * curve.time_s
            own += [1e-3 * size_um * np.sin(angle), 1e-3 * size_um * np.cos(angle)]
        if errors.wander:
            own += list(1e-3 * errors.wander * walk_shapes(curve.time_s).T)
        placed = np.kron(np.eye(placements), np.column_stack(own))
        return Covariance(
            np.tile(variance, placements),
            np.hstack([np.tile(self.mesh_left_mm, (placements, 1)), placed]),
            tuple(n * (k + 1) for k in range(placements)),
            OrnsteinUhlenbeck(1e-3 * errors.ou_um, errors.ou_s) if errors.ou_um else None,
            np.tile(curve.time_s, placements),
        )
