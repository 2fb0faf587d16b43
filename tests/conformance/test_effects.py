"""All effects: recovered from another mesh, and together; their rules are in skinlab/extensions."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from sim_device.skin import MESH as OTHER_MESH
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.extensions.effects import curve, tangent_error
from skinlab.mechanics.effects import all_effects
from skinlab.mechanics.effects.model import Skin, problem_of, response
from skinlab.mechanics.fem.suction import (
    Geometry,
)

EFFECTS = [effect for effect in all_effects() if not effect.family]
NAMES = [effect.name for effect in EFFECTS]
SKIN = Skin((0.04, 1.5, 0.32))
GEOMETRY = Geometry(6.0, 1.0)
PATH = PressurePath.of_program(parse_program("ramp:60@40,hold:2,ramp:0@40,hold:1"))
TIMES = np.linspace(0.0, 6.0, 61)
STEP = 0.2  # of an effect's size


@pytest.mark.parametrize("effect", EFFECTS, ids=NAMES)
def test_it_is_recovered_from_another_mesh(effect):
    """Its size, from noisy data of a 9-node mesh, with the base known; the mesh of record fits."""
    values = effect.typical
    rng = np.random.default_rng(11)
    data = curve({effect.name: values}, mesh=OTHER_MESH)
    data = data + 3e-3 * rng.standard_normal(len(data))
    size = next(p for p in effect.parameters if p.zero is not None)
    span = size.typical - size.zero

    def fitted(x):
        tried = values | {size.name: size.zero + x * span}
        return response(SKIN, {effect.name: tried}, GEOMETRY, PATH, TIMES, cycle=2).deflection_mm

    # Curves of other sizes by a parabola through three, which at the true one is exact
    low, true, high = (fitted(x) for x in (1.0 - STEP, 1.0, 1.0 + STEP))
    slope, bend = (high - low) / (2 * STEP), (high - 2 * true + low) / STEP**2

    def residual(x):
        d = float(x[0]) - 1.0
        return (data - (true + slope * d + 0.5 * bend * d**2)) / 3e-3

    fit = least_squares(residual, [0.7])
    spread = 1 / np.linalg.norm(fit.jac)  # one standard deviation
    assert spread < 0.15
    assert abs(fit.x[0] - 1.0) < 4 * spread + 0.05  # the meshes differ by a thousandth of the dome


EVERYTHING = {effect.name: effect.typical for effect in EFFECTS}
# A curve of all with their memory takes seconds
MEMORIES = {"viscoelasticity", "power_law_creep", "poroelastic_creep"}
AT_ONCE = [effect for effect in EFFECTS if effect.name not in MEMORIES]
SOME = [EFFECTS[NAMES.index(n)] for n in ("viscoelasticity", "sensor_curve", "hypodermis")]


@pytest.mark.parametrize(
    ("effects", "among"),
    [
        (AT_ONCE, AT_ONCE),
        pytest.param(SOME, EFFECTS, marks=pytest.mark.long),
        pytest.param(EFFECTS, EFFECTS, marks=pytest.mark.soak),
    ],
    ids=["at once", "some", "each"],
)
def test_all_of_them_together(effects, among):
    values = {effect.name: effect.typical for effect in among}
    together = curve(values)
    np.testing.assert_array_equal(curve(dict(reversed(values.items()))), together)
    for effect in effects:
        without = {k: v for k, v in values.items() if k != effect.name}
        zero = curve(values | {effect.name: effect.zero})
        np.testing.assert_allclose(zero, curve(without), rtol=1e-13, atol=1e-15)
        assert np.abs(together - zero).max() > 5e-4  # mm


def test_the_tangent_of_all_together_is_the_derivative_of_the_forces():
    off, order = tangent_error(EVERYTHING)
    assert order == pytest.approx(2, abs=0.1)
    assert off < 1e-3


def test_solutions_are_shared():
    """Curves that differ in sensor effects alone are one solution; so is a second call."""
    problem = problem_of(SKIN, EVERYTHING, GEOMETRY, cycle=2)
    sensors = {e.name: e.typical for e in EFFECTS if not e.physical}
    physical = {k: v for k, v in EVERYTHING.items() if k not in sensors}
    assert problem == problem_of(SKIN, physical, GEOMETRY, cycle=2)
    assert hash(problem) == hash(replace(problem))
