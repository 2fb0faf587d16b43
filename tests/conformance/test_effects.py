"""Every effect that is found in the folder, by the same rules."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from sim_device.skin import MESH as OTHER_MESH
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.mechanics.effects import all_effects, get_effect
from skinlab.mechanics.effects.describe import markdown
from skinlab.mechanics.effects.model import Skin, problem_of, response
from skinlab.mechanics.fem.element import QUAD8_FULL
from skinlab.mechanics.fem.skin import prepare
from skinlab.mechanics.fem.suction import (
    MBAR,
    MESH_OF_RECORD,
    SCREENING_MESH,
    Discretisation,
    Geometry,
)

EFFECTS = all_effects()
NAMES = [effect.name for effect in EFFECTS]
SKIN = Skin((0.04, 1.5, 0.32))
GEOMETRY = Geometry(6.0, 1.0)
PATH = PressurePath.of_program(parse_program("ramp:60@40,hold:2,ramp:0@40,hold:1"))
TIMES = np.linspace(0.0, 6.0, 61)
COARSE = Discretisation("coarse", QUAD8_FULL, 0.05, 2.0, 0.3, 0.5, 0.5, True, (5, 4, 3))


def curve(effects, cycle=2, discretisation=COARSE, pressure=None):
    found = response(
        SKIN, effects, GEOMETRY, PATH, TIMES, pressure, cycle=cycle, discretisation=discretisation
    )
    assert found.stopped == ""
    assert found.holds_to_mbar == 60.0
    assert np.isfinite(found.deflection_mm).all()
    return found.deflection_mm


def between(effect, share):
    """Values this share of the way from the effect's zero to its typical size."""
    zero, typical = effect.zero, effect.typical
    return {name: (1 - share) * zero[name] + share * typical[name] for name in zero}


def test_all_thirteen_are_there():
    assert set(NAMES) == {
        "viscoelasticity", "natural_tension", "hypodermis", "contact_preload", "tape_slip",
        "thickness_error", "surface_layer", "strain_stiffening", "preconditioning", "pressure_lag",
        "deflection_offset", "deflection_gain", "baseline_drift",
    }  # fmt: skip


@pytest.mark.parametrize("effect", EFFECTS, ids=NAMES)
def test_it_says_what_it_is(effect):
    assert get_effect(effect.name) is effect
    assert type(effect).__module__ == f"skinlab.mechanics.effects.{effect.name}"
    for text in (effect.meaning, effect.formula, effect.source):
        assert text.strip() == text != ""
        assert "\n" not in text
    assert any(p.zero is not None for p in effect.parameters)
    for p in effect.parameters:
        assert p.meaning
        assert p.source
        assert np.isfinite([p.low, p.high]).all()
        assert p.low < p.high
        assert p.low <= p.typical <= p.high
        for value in (p.zero, p.default):
            assert value is None or p.low <= value <= p.high
        assert p.spacing == "linear" or p.low > 0
        unit = {"µm": "um", "µm/s": "um_per_s"}.get(p.unit, p.unit)
        assert p.name.endswith(f"_{unit}") if unit else "_" not in p.name


@pytest.mark.parametrize("effect", EFFECTS, ids=NAMES)
def test_at_its_zero_it_is_the_base_model(effect):
    for cycle in (1, 2):
        np.testing.assert_allclose(
            curve({effect.name: effect.zero}, cycle), curve({}, cycle), rtol=1e-13, atol=1e-15
        )
    others = [p.name for p in effect.parameters if p.zero is None]
    for extreme in ("low", "high"):  # whatever its other parameters are
        values = {p.name: getattr(p, extreme) for p in effect.parameters if p.name in others}
        np.testing.assert_array_equal(curve({effect.name: effect.zero | values}), curve({}))


@pytest.mark.parametrize("effect", EFFECTS, ids=NAMES)
def test_a_larger_effect_changes_the_curve_more(effect):
    base = curve({})
    off = [
        np.sqrt(np.mean((curve({effect.name: between(effect, s)}) - base) ** 2))
        for s in (0.05, 0.5, 1.0)
    ]
    assert off[0] < off[1] < off[2]
    assert off[2] > 2e-3  # mm: a typical size is seen


@pytest.mark.parametrize("effect", EFFECTS, ids=NAMES)
def test_what_it_cannot_be_is_refused_with_the_field(effect):
    good = effect.typical
    assert effect.full(good) == good
    for p in effect.parameters:
        field = rf"effects\.{effect.name}\.{p.name} "
        for value in (p.low - 1, p.high * 1.01 + 1, np.nan, np.inf):
            with pytest.raises(InputError, match=field + "is .*: expected"):
                effect.full(good | {p.name: value})
        if p.default is None:
            with pytest.raises(InputError, match=field + "is missing"):
                effect.full({k: v for k, v in good.items() if k != p.name})
    with pytest.raises(InputError, match=rf"effects\.{effect.name}\.size is not known"):
        effect.full(good | {"size": 1.0})


@pytest.mark.parametrize("effect", EFFECTS, ids=NAMES)
def test_it_is_recovered_from_another_mesh(effect):
    """Its size, from noisy data of a 9-node mesh, with the base known; the mesh of record fits."""
    values = effect.typical
    rng = np.random.default_rng(11)
    data = curve({effect.name: values}, discretisation=OTHER_MESH)
    data = data + 3e-3 * rng.standard_normal(len(data))
    size = next(p for p in effect.parameters if p.zero is not None)
    span = size.typical - size.zero

    def residual(x):
        tried = values | {size.name: size.zero + float(x[0]) * span}
        from_fit = response(SKIN, {effect.name: tried}, GEOMETRY, PATH, TIMES, cycle=2)
        return (data - from_fit.deflection_mm) / 3e-3

    fit = least_squares(residual, [0.7], diff_step=0.02, xtol=1e-3, max_nfev=6)
    spread = 1 / np.linalg.norm(fit.jac)  # one standard deviation
    assert spread < 0.15
    assert abs(fit.x[0] - 1.0) < 4 * spread + 0.05  # the meshes differ by a thousandth of the dome


def test_the_documentation_shows_what_they_declare():
    assert markdown() in (Path(__file__).parents[2] / "docs" / "effects.md").read_text("utf-8")


EVERYTHING = {effect.name: effect.typical for effect in EFFECTS}


@pytest.mark.parametrize("effect", EFFECTS, ids=NAMES)
def test_the_screening_mesh_sees_what_it_does(effect):
    def change(mesh):
        return curve({effect.name: effect.typical}, discretisation=mesh) - curve(
            {}, discretisation=mesh
        )

    exact = change(MESH_OF_RECORD)
    off = np.sqrt(np.mean((change(SCREENING_MESH) - exact) ** 2) / np.mean(exact**2))
    assert off < 0.01


def test_all_of_them_together():
    together = curve(EVERYTHING)
    np.testing.assert_array_equal(curve(dict(reversed(EVERYTHING.items()))), together)
    for effect in EFFECTS:
        without = {k: v for k, v in EVERYTHING.items() if k != effect.name}
        zero = curve(EVERYTHING | {effect.name: effect.zero})
        np.testing.assert_allclose(zero, curve(without), rtol=1e-13, atol=1e-15)
        assert np.abs(together - zero).max() > 5e-4  # mm


@pytest.mark.parametrize(
    "effects",
    [*({e.name: e.typical} for e in EFFECTS if e.physical), EVERYTHING],
    ids=[*(e.name for e in EFFECTS if e.physical), "everything"],
)
def test_the_tangent_is_the_derivative_of_the_forces(effects):
    problem = problem_of(SKIN, effects, GEOMETRY, cycle=2)
    prepared = prepare(problem, COARSE)
    assembly, pressure = prepared.assembly, 100 * MBAR
    rng = np.random.default_rng(3)
    small = 0.02 * np.diff(np.unique(assembly.mesh.nodes[:, 1])).min()  # of the thinnest row
    r, z = assembly.mesh.nodes.T
    smooth = np.column_stack([0.03 * r * z, 0.1 * z]).ravel()  # none at the tape
    u = np.zeros(assembly.n)
    u[assembly.equation[assembly.equation < assembly.n]] = smooth[assembly.equation < assembly.n]
    u, v = u + small * rng.normal(size=assembly.n), small * rng.normal(size=assembly.n)
    f = assembly.deformation_gradients(assembly.full(u))
    stress = 0.01 * rng.normal(size=(4, *f.shape[1:]))  # what relaxation may have left

    def forces(at):
        return assembly.evaluate(at, pressure, prepared.parameters(0.8), stress)

    state = forces(u)
    exact = state.tangent[:, 0] * v
    for k in range(1, state.tangent.shape[1]):
        exact[k:] += state.tangent[: assembly.n - k, k] * v[: assembly.n - k]
        exact[: assembly.n - k] += state.tangent[: assembly.n - k, k] * v[k:]
    if state.skew is not None:
        e_r, e_z, size = state.skew
        exact -= pressure * size * (e_z * (e_r @ v) - e_r * (e_z @ v))
    steps = np.array([0.2, 0.1, 0.05])
    errors = []
    for h in steps:
        up, down = forces(u + h * v), forces(u - h * v)
        errors.append(np.abs((up.residual - down.residual) / (2 * h) - exact).max())
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2, abs=0.1)
    assert errors[-1] < 1e-3 * np.abs(exact).max()


def test_solutions_are_shared():
    """Curves that differ in sensor effects alone are one solution; so is a second call."""
    problem = problem_of(SKIN, EVERYTHING, GEOMETRY, cycle=2)
    sensors = {e.name: e.typical for e in EFFECTS if not e.physical}
    physical = {k: v for k, v in EVERYTHING.items() if k not in sensors}
    assert problem == problem_of(SKIN, physical, GEOMETRY, cycle=2)
    assert hash(problem) == hash(replace(problem))
