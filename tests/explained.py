"""A curve whose zero is off by 80 µm: quickly made, and quickly explained."""

from __future__ import annotations

import numpy as np

from skinlab.curves.campaign import Campaign
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.mechanics.fem.suction import Geometry
from skinlab.tables.table import Table

UP, UP_AND_DOWN = "ramp:100@50", "ramp:100@50,ramp:0@50"
_NOISE_UM = 2.0
_OFFSET_MM = 0.08  # more than a placement does: a curve alone has a zero of its own


def campaign(table: Table, program_text: str) -> Campaign:
    program = parse_program(program_text)
    time_s = np.arange(int(program.duration_s * 20) + 1) / 20
    pressure_mbar = PressurePath.of_program(program)(time_s)
    model = table.model(Geometry(6.0, 1.0), pressure_mbar, "paper")
    noise = np.random.default_rng(1).normal(0.0, 1e-3 * _NOISE_UM, len(time_s))
    deflection_mm = model.deflection_mm(np.array([[0.03, 1.5, 0.3]]))[0] + _OFFSET_MM + noise
    curve = Curve("curve 1", Setup(6.0, 1.0, program), time_s, pressure_mbar, deflection_mm)
    return Campaign("", _NOISE_UM, 0.0, (curve,))
