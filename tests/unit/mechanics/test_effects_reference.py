"""The effects against curves of another program, at the truth that they were computed from."""

import json
from pathlib import Path

import numpy as np
import pytest

from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.mechanics.effects.model import Skin, response
from skinlab.mechanics.fem.suction import Geometry

FILE = Path(__file__).parents[2] / "data" / "effects_reference" / "curves.json"
CURVES = json.loads(FILE.read_text(encoding="utf-8"))
NOISE_UM = np.hypot(3.0, 1 / np.sqrt(12))


@pytest.mark.parametrize("curve", CURVES, ids=lambda curve: curve["name"])
def test_nothing_is_left_but_noise(curve):
    path = PressurePath.of_program(parse_program(curve["program"]))
    time = np.array(curve["time_s"])
    found = response(
        Skin((curve["X1_MPa"], curve["X2_MPa"], curve["nu"]), curve["kappa"]),
        curve["effects"],
        Geometry(curve["aperture_mm"], curve["thickness_mm"]),
        path,
        np.union1d(time, path.time_s),
        cycle=curve["cycle"],
    )
    assert found.stopped == ""
    dome = 1e3 * found.deflection_mm
    assert dome.max() == pytest.approx(curve["top_um"], rel=4e-3)
    left = np.array(curve["deflection_um"]) - dome[np.isin(np.union1d(time, path.time_s), time)]
    n = len(left)
    # 0.4 % between two programs or meshes, and four standard deviations of what noise can do
    model_um = 4e-3 * np.sqrt(np.mean(dome**2))
    assert abs(left.mean()) < model_um + 4 * NOISE_UM / np.sqrt(n)
    assert np.mean(left**2) < NOISE_UM**2 * (1 + 4 * np.sqrt(2 / n)) + model_um**2
    without = response(
        Skin((curve["X1_MPa"], curve["X2_MPa"], curve["nu"]), curve["kappa"]), {},
        Geometry(curve["aperture_mm"], curve["thickness_mm"]), path, time,
    )  # fmt: skip
    off = np.array(curve["deflection_um"]) - 1e3 * without.deflection_mm
    assert np.mean(off**2) > 1.5 * np.mean(left**2)  # and the effect is there to be seen
