"""Campaigns of a simulated skin with effects that nobody states, and their fitters."""

from __future__ import annotations

import numpy as np

from skinlab.curves.campaign import Campaign
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.discrepancy.campaign_errors import CampaignErrors, Measured, learn, look_at_errors
from skinlab.discrepancy.fit import Fitter
from skinlab.discrepancy.misfit import errors_of
from skinlab.discrepancy.records import records_of
from skinlab.discrepancy.table_domes import TableDomes
from skinlab.mechanics.effects.model import Skin, response
from skinlab.mechanics.fem.suction import Geometry

SKIN = Skin((0.035, 1.2, 0.32))
X1, X2, NU = SKIN.values
TRUE = np.array([np.log(X1), np.log(X2 / X1), NU])
RAMPS = (
    (6.0, "ramp:100@20,ramp:0@20", 1),
    (2.0, "ramp:300@60,ramp:0@60", 1),
    (8.0, "ramp:100@20,ramp:0@20", 1),
)
STAIRS = (6.0, "ramp:100@80,hold:3,ramp:0@80", 1)


def measured(effects, plan, *, noise_um=2.0, pressure_noise_mbar=0.1, seed=0, stated=True):
    """Return a campaign of the mesh of record, with noise."""
    rng = np.random.default_rng(seed)
    curves = []
    for i, (aperture, text, cycle) in enumerate(plan):
        program = parse_program(text)
        t = np.arange(int(program.duration_s * 20 + 1e-9) + 1) / 20
        path = PressurePath.of_program(program)
        w = response(SKIN, effects, Geometry(aperture, 1.1), path, t, cycle=cycle).deflection_mm
        setup = Setup(aperture, 1.1, program, cycle)
        w = w + rng.normal(0, 1e-3 * noise_um, len(t))
        curves.append(
            Curve(f"c{i}", setup, t, path(t) + rng.normal(0, pressure_noise_mbar, len(t)), w)
        )
    return Campaign(
        "made", noise_um if stated else None, pressure_noise_mbar if stated else None, tuple(curves)
    )  # fmt: skip


def fitter_of(campaign, table, **options):
    records = records_of(campaign)
    return Fitter(records, errors_of(records), TableDomes(table), **options)


def learned(records, base, noise_um=None, placement_scatter=None):
    """Return the errors as repeats and roughness tell them, and as the model as it is sees them."""
    none = np.zeros(sum(len(r.curve) for r in records))
    measured = Measured(records, noise_um, placement_scatter)
    pure = learn(measured, base, none)
    return CampaignErrors((*pure.looks, look_at_errors(pure, measured, base, none)))
