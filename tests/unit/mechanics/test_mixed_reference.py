"""Domes against another program, whose elements cannot lock: every opening, ν to 0.499, effects."""

import json
from pathlib import Path

import numpy as np
import pytest

from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.mechanics.effects.model import Skin, response
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials.compressibility import kappa_ratio
from skinlab.tables.model_errors import locking

FILE = Path(__file__).parents[2] / "data" / "mixed_reference" / "domes.json"
DOMES = json.loads(FILE.read_text(encoding="utf-8"))


@pytest.mark.parametrize("dome", DOMES)
def test_the_dome_is_that_of_elements_that_cannot_lock(dome):
    if "program" in dome:
        path, time = PressurePath.of_program(parse_program(dome["program"])), dome["time_s"]
    else:  # a second a mbar
        top, time = dome["pressure_mbar"][-1], dome["pressure_mbar"]
        path = PressurePath((0.0, top), (0.0, top))
    found = response(
        Skin((dome["X1_MPa"], dome["X2_MPa"], dome["nu"])),
        dome["effects"],
        Geometry(dome["aperture_mm"], dome["thickness_mm"]),
        path,
        time,
    )
    assert found.stopped == ""
    theirs = np.array(dome["deflection_um"])
    # The mesh is too stiff by what it locks, and off by 0.2 % besides.
    share = 2e-3 + 1.5 * float(locking(kappa_ratio(dome["nu"], "paper")))
    low, high = theirs * (1.0 - share) - 0.05, theirs * 1.002 + 0.05
    assert np.all((low < 1e3 * found.deflection_mm) & (1e3 * found.deflection_mm < high))
