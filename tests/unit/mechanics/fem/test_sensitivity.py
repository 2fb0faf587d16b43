"""Slopes by direct differentiation are those of solutions side by side."""

from dataclasses import replace

import numpy as np
import pytest

from skinlab.errors import InputError
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.effects.model import problem_of
from skinlab.mechanics.fem import kernel
from skinlab.mechanics.fem.newton import StepSettings
from skinlab.mechanics.fem.sensitivity import solve_with_slopes
from skinlab.mechanics.fem.skin import Skin, edge_of
from skinlab.mechanics.fem.suction import SCREENING_MESH, Geometry

GEOMETRY = Geometry(6.0, 1.0)
SKIN = (0.03, 1.0, 0.32)
TIGHT = StepSettings(correction=1e-10, extrapolation_error=2e-5)
TOP = 80.0
EFFECTS = {  # parameter, value, half a difference
    "natural_tension": ("stretch", 1.05, 1e-4),
    "hypodermis": ("X1_kPa", 1.0, 1e-3),
    "preconditioning": ("softening", 0.2, 1e-4),
    "tape_slip": ("slip_mm", 0.2, 1e-4),
    "thickness_error": ("ratio", 1.1, 1e-4),
    "surface_layer": ("thickness_um", 20.0, 0.001),
    "strain_stiffening": ("X3_MPa", 100.0, 0.1),
    "learned_law": ("c3", 0.3, 1e-3),
}


def of_skin(values, effects=None, law="extended_neo_hookean"):
    return problem_of(Skin(tuple(values), law=law), effects or {}, GEOMETRY, cycle=2)


def assert_slopes_are_differences(problem_at, value, half, mesh=SCREENING_MESH):
    up, down = problem_at(value + half), problem_at(value - half)
    curve, slopes = solve_with_slopes(problem_at(value), [(up, down, 2 * half)], TOP, mesh, TIGHT)
    above, below = (solve_with_slopes(x, [], TOP, mesh, TIGHT)[0] for x in (up, down))
    p = np.array([10.0, 30.0, 55.0, TOP])
    expected = (above(p) - below(p)) / (2 * half)
    np.testing.assert_allclose(slopes(p)[0, -1], expected[-1], rtol=2e-5)
    np.testing.assert_allclose(slopes(p)[0], expected, rtol=2e-3)
    assert curve.stopped == ""


@pytest.mark.parametrize("law", ["extended_neo_hookean", "mooney_rivlin"])
@pytest.mark.parametrize("j", [0, 1, 2])
def test_by_the_laws_parameters(j, law):
    def problem_at(x):
        return of_skin([*SKIN[:j], x, *SKIN[j + 1 :]], law=law)

    assert_slopes_are_differences(problem_at, SKIN[j], 1e-4 * SKIN[j])


@pytest.mark.parametrize("name", EFFECTS)
def test_by_an_effects_parameter(name):
    parameter, value, half = EFFECTS[name]

    def problem_at(x):
        return of_skin(SKIN, {name: {**get_effect(name).typical, parameter: x}})

    assert_slopes_are_differences(problem_at, value, half)


def test_a_skin_parameter_beside_layers_and_stretch():
    effects = {name: get_effect(name).typical for name in ("natural_tension", "hypodermis")}
    assert_slopes_are_differences(lambda x: of_skin([x, *SKIN[1:]], effects), 0.03, 1e-6)


@pytest.mark.parametrize("parameter", ["X1 of the skin", "X1_MPa"])
def test_what_moves_the_edge_under_a_layer_alone(parameter):
    """How sharp the edge is depends on what the layer carries, and so on every stiffness."""
    typical = get_effect("surface_layer").typical

    def problem_at(x):
        if parameter == "X1_MPa":
            return of_skin(SKIN, {"surface_layer": {**typical, "X1_MPa": x}})
        return of_skin([x, *SKIN[1:]], {"surface_layer": typical})

    value = typical["X1_MPa"] if parameter == "X1_MPa" else SKIN[0]
    ends = [edge_of(problem_at(x), SCREENING_MESH) for x in (value, 1.01 * value)]
    assert ends[0] != ends[1]
    assert_slopes_are_differences(problem_at, value, 5e-5 * value)


def test_without_the_compiled_loops(monkeypatch):
    monkeypatch.setattr(kernel, "library", lambda: None)
    mesh = replace(SCREENING_MESH, name="screening, plain numpy")
    assert_slopes_are_differences(lambda x: of_skin([0.03, x, 0.32]), 1.0, 1e-4, mesh)
    parameter, value, half = EFFECTS["thickness_error"]
    assert_slopes_are_differences(
        lambda x: of_skin(SKIN, {"thickness_error": {parameter: x}}), value, half, mesh
    )


@pytest.mark.parametrize("effect", ["strain_stiffening", "hypodermis", "learned_law"])
def test_several_slopes_in_one_go_are_those_of_each(effect):
    """Where the compiled loops know the energy, and where they do not."""
    effects = {effect: get_effect(effect).typical}
    changes = []
    for j, x in enumerate(SKIN):
        ends = [of_skin([*SKIN[:j], x * (1 + s), *SKIN[j + 1 :]], effects) for s in (1e-4, -1e-4)]
        changes.append((*ends, 2e-4 * x))
    here = of_skin(SKIN, effects)
    _, together = solve_with_slopes(here, changes, TOP, SCREENING_MESH)
    for k, change in enumerate(changes):
        _, alone = solve_with_slopes(here, [change], TOP, SCREENING_MESH)
        np.testing.assert_allclose(together.by_parameter[k], alone.by_parameter[0], rtol=1e-9)


def test_beyond_a_crease_there_is_no_slope():
    soft = [0.005, 0.05, 0.2]
    change = (of_skin([0.00501, *soft[1:]]), of_skin([0.00499, *soft[1:]]), 2e-5)
    curve, slopes = solve_with_slopes(of_skin(soft), [change], 100.0, SCREENING_MESH)
    assert curve.stopped
    found = slopes(np.array([0.5 * curve.holds_to_mbar, 100.0]))[0]
    assert np.isfinite(found[0])
    assert np.isnan(found[1])


def test_another_topology_is_refused():
    layered = of_skin(SKIN, {"hypodermis": get_effect("hypodermis").typical})
    with pytest.raises(InputError, match="topology"):
        solve_with_slopes(of_skin(SKIN), [(layered, of_skin(SKIN), 1.0)], TOP, SCREENING_MESH)
