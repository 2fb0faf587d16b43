"""Residual and tangent against central differences: right, and of second order in the step."""

import numpy as np
import pytest

from skinlab.mechanics.fem.assembly import Assembly, dilatation, stress_and_tangent
from skinlab.mechanics.fem.element import ELEMENTS
from skinlab.mechanics.fem.mesh import Grading, suction_mesh
from skinlab.mechanics.materials import get_law, law_names

SKIN = {"X1_MPa": 0.03, "X2_MPa": 1.0, "kappa_MPa": 0.18}
ANY = {**SKIN, "X3_MPa": 50.0, "C10_MPa": 0.5, "C01_MPa": 0.1}
STEPS = np.array([4e-3, 2e-3, 1e-3, 5e-4])


def order(steps, errors):
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


def product(state, v):
    """K v, from the lower band."""
    band = state.tangent
    n, width = band.shape
    out = band[:, 0] * v
    for k in range(1, width):
        out[k:] += band[: n - k, k] * v[: n - k]
        out[: n - k] += band[: n - k, k] * v[k:]
    return out


def suction_problem(element):
    mesh = suction_mesh(3.0, 1.0, 9.0, Grading(0.4, 2.0, 1.0, 2.0, 0.5), element.nodes)
    fixed = np.unique(
        np.concatenate([2 * mesh.axis, 2 * mesh.tape, 2 * mesh.tape + 1, 2 * mesh.outer])
    )
    return Assembly(mesh, element, get_law("extended_neo_hookean"), fixed)


@pytest.mark.parametrize("pressure", [0.0, 0.01])
@pytest.mark.parametrize("element", ELEMENTS.values(), ids=ELEMENTS)
def test_tangent_and_residual_with_second_order(element, pressure):
    assembly = suction_problem(element)
    rng = np.random.default_rng(2)
    u = 0.01 * rng.normal(size=assembly.n)
    v = rng.normal(size=assembly.n)
    here = assembly.evaluate(u, pressure, SKIN)
    exact = product(here, v)
    slope = (here.residual + pressure * here.load) @ v
    by_tangent, by_energy, by_volume = [], [], []
    for h in 0.2 * STEPS:
        up, down = (assembly.evaluate(u + s * h * v, pressure, SKIN) for s in (1, -1))
        by_tangent.append(np.abs((up.residual - down.residual) / (2 * h) - exact).max())
        by_energy.append(abs((up.energy - down.energy) / (2 * h) - slope))
        by_volume.append(abs((up.volume - down.volume) / (2 * h) - here.load @ v))
    assert by_tangent[-1] < 3e-4 * np.abs(exact).max()
    assert order(STEPS, by_tangent) == pytest.approx(2, abs=0.05)
    assert order(STEPS, by_energy) == pytest.approx(2, abs=0.05)
    # the load does the pressure's work: its power is p dV
    assert order(STEPS, by_volume) == pytest.approx(2, abs=0.05)


def random_f(n=50):
    rng = np.random.default_rng(4)
    f = np.array([1.0, 0.0, 0.0, 1.0, 1.0])[:, None] + 0.3 * rng.uniform(-1, 1, (5, n))
    return f, rng.normal(size=(5, n))


@pytest.mark.parametrize("name", law_names())
@pytest.mark.parametrize("factor", [1.0, 0.7])
def test_the_short_way_to_first_derivatives_is_the_same(name, factor):
    law = get_law(name)
    rng = np.random.default_rng(1)
    i1, i2, j = (least + rng.random((8, 4)) for least in (3.0, 3.0, 1.0))
    whole = law.potential(i1, i2, j, ANY, factor)
    first = law.first_derivatives(i1, i2, j, ANY, factor)
    for found, exact in zip(first, (whole.d_i1, whole.d_i2, whole.d_j), strict=True):
        np.testing.assert_allclose(found, exact, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("name", law_names())
def test_stress_and_moduli_are_the_derivatives_of_the_energy(name):
    law = get_law(name)
    f, v = random_f()
    _, stress, moduli, det = stress_and_tangent(f, law, ANY)
    np.testing.assert_allclose(det, (f[0] * f[3] - f[1] * f[2]) * f[4], rtol=1e-14)
    np.testing.assert_allclose(moduli, moduli.transpose(1, 0, 2), rtol=1e-12, atol=1e-12)
    first, second = [], []
    for h in STEPS:
        e1, s1, _, _ = stress_and_tangent(f + h * v, law, ANY)
        e0, s0, _, _ = stress_and_tangent(f - h * v, law, ANY)
        first.append(np.abs((e1 - e0) / (2 * h) - (stress * v).sum(axis=0)).max())
        second.append(np.abs((s1 - s0) / (2 * h) - np.einsum("ijn,jn->in", moduli, v)).max())
    assert order(STEPS, first) == pytest.approx(2, abs=0.05)
    assert order(STEPS, second) == pytest.approx(2, abs=0.05)


@pytest.mark.parametrize("name", law_names())
def test_pure_dilatation(name):
    law = get_law(name)
    j = np.linspace(0.6, 1.6, 11)
    energy, first, second = dilatation(law, j, ANY)
    third = np.cbrt(j)
    f = np.stack([third, 0 * j, 0 * j, third, third])
    full, _, _, _ = stress_and_tangent(f, law, ANY)
    np.testing.assert_allclose(energy, full, atol=1e-15)
    errors = []
    for h in STEPS:
        up, down = dilatation(law, j + h, ANY), dilatation(law, j - h, ANY)
        np.testing.assert_allclose((up[0] - down[0]) / (2 * h), first, atol=20 * h * h)
        errors.append(np.abs((up[1] - down[1]) / (2 * h) - second).max())
    assert errors[-1] < 1e-4 * np.abs(second).max()
