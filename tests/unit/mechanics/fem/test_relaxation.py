"""Relaxation against closed forms, and what no viscoelastic body may do."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from skinlab.errors import InputError
from skinlab.mechanics.fem.element import QUAD8_FULL, QUAD9_LINEAR_DILATATION
from skinlab.mechanics.fem.relaxation import SETTINGS, isochoric_stress, relax, step_factors
from skinlab.mechanics.fem.skin import Prony, Skin, SkinProblem, prepare
from skinlab.mechanics.fem.suction import Discretisation, Geometry, trace
from skinlab.mechanics.materials.compressibility import nu_from_ratio

COARSE = Discretisation("coarse", QUAD8_FULL, 0.05, 2.0, 0.3, 0.5, 0.5, True, (5, 4, 3))
SKIN = SkinProblem(Geometry(6.0, 1.0), Skin((0.04, 1.5, 0.32)))


def course(problem, times, pressures, preload=0.0, **settings):
    found = relax(
        prepare(problem, COARSE), problem.prony, np.array(times), np.array(pressures), 3.0,
        replace(SETTINGS, **settings), preload,
    )  # fmt: skip
    assert found.stopped == ""
    return found


def elastic(problem, top):
    prepared = prepare(replace(problem, prony=()), COARSE)
    return trace(prepared.assembly, prepared.apex, prepared.parameters(), top, 3.0)


def long_term(problem):
    """The elastic skin with W_vol + (1 − g) W_iso: the same κ, all else less."""
    left = 1 - sum(term.g for term in problem.prony)
    x1, x2, _ = problem.skin.values
    nu = float(nu_from_ratio(problem.skin.dilatation_ratio / left, problem.skin.kappa))
    return replace(problem, skin=Skin((left * x1, left * x2, nu)), prony=())


@pytest.mark.parametrize("x", [0.0, 1e-9, 1e-3, 0.0999, 0.1, 1.0, 30.0])
def test_the_step_is_exact_for_parabolas(x):
    """S(s) = s and s² over a unit step: H = ∫ e^(−x (1−s)) dS/ds ds, by quadrature."""
    s, w = np.polynomial.legendre.leggauss(60)
    s, w = (s + 1) / 2, w / 2
    e, phi, psi = step_factors(x)
    assert e == pytest.approx(np.exp(-x), rel=1e-15)
    decay = w * np.exp(-x * (1 - s))
    assert phi == pytest.approx(decay.sum(), rel=1e-13)
    assert psi == pytest.approx((decay * (2 * s - 1)).sum(), rel=1e-12, abs=1e-14)


def test_a_sudden_load_meets_the_instantaneous_skin_and_a_slow_one_the_relaxed():
    skin = replace(SKIN, prony=(Prony(0.3, 1.0),))
    sudden = course(skin, [0.0, 1e-4], [0.0, 60.0])(1e-4)
    slow = course(skin, [0.0, 1e4], [0.0, 60.0])(1e4)
    assert sudden == pytest.approx(elastic(SKIN, 60.0)([60.0])[0], rel=1e-4)
    assert slow == pytest.approx(elastic(long_term(skin), 60.0)([60.0])[0], rel=1e-4)
    jump = course(skin, [0.0, 0.0, 1e-6], [0.0, 60.0, 60.0])(1e-6)
    assert jump == pytest.approx(elastic(SKIN, 60.0)([60.0])[0], rel=1e-4)
    hold = course(skin, [0.0, 1.0, 40.0], [0.0, 60.0, 60.0])(40.0)
    assert hold == pytest.approx(slow, rel=1e-4)


def creep_compliance(prony, times):
    """J(t) G(0) of G(t) = G(0) (1 − Σg + Σ g e^(−t/τ)), from the poles of its Laplace transform.

    s G(s) = N(s)/D(s) with D = Π (1 + s τ); J(s) = D/(s N): a constant and a decay for each root.
    """
    factors = [Polynomial([1.0, term.tau_s]) for term in prony]
    whole = np.prod(factors)
    n = (1 - sum(term.g for term in prony)) * whole
    for k, term in enumerate(prony):
        others = np.prod([Polynomial([1.0]), *factors[:k], *factors[k + 1 :]])
        n = n + term.g * Polynomial([0.0, term.tau_s]) * others
    roots = n.roots()
    decays = [whole(r) / (r * n.deriv()(r)) * np.exp(r * times) for r in roots]
    return 1 / n(0.0) + sum(decays)


@pytest.mark.parametrize("prony", [(Prony(0.3, 1.0),), (Prony(0.2, 0.3), Prony(0.3, 5.0))])
def test_creep_of_a_small_dome_is_that_of_linear_theory(prony):
    """Incompressible, little suction: w(t)/w(0) is the creep compliance of the shear alone."""
    mesh = replace(COARSE, element=QUAD9_LINEAR_DILATATION)
    skin = replace(SKIN, skin=Skin((0.04, 1.5, 0.49999)), prony=prony)
    times = np.array([0.0, 0.1, 0.3, 1.0, 3.0, 10.0])
    curve = relax(
        prepare(skin, mesh), prony, np.array([0.0, 0.0, 10.0]), np.array([0.0, 1e-3, 1e-3]), 3.0,
        replace(SETTINGS, extrapolation_error=1e-10, correction=1e-12),
    )  # fmt: skip
    found = curve(times) / curve(0.0)
    np.testing.assert_allclose(found, creep_compliance(prony, times), rtol=2e-4)
    if len(prony) == 1:
        g, tau = prony[0].g, prony[0].tau_s
        closed = (1 - g * np.exp(-(1 - g) * times / tau)) / (1 - g)
        np.testing.assert_allclose(creep_compliance(prony, times), closed, rtol=1e-12)


@pytest.mark.parametrize(("g", "tau"), [(0.1, 0.1), (0.3, 1.0), (0.3, 20.0), (0.6, 3.0)])
def test_a_loop_loses_energy_and_goes_down_higher_than_up(g, tau):
    skin = replace(SKIN, prony=(Prony(g, tau),))
    curve = course(skin, [0.0, 2.0, 4.0], [0.0, 40.0, 0.0])
    up = curve(np.linspace(0, 2, 200))
    down = curve(np.linspace(4, 2, 200))
    assert (down[1:-1] > up[1:-1]).all()
    p = np.linspace(0, 40, 200)
    lost = np.trapezoid(down, p) - np.trapezoid(up, p)  # ∮ p dw = ∮ −w dp
    assert 0 < lost < np.trapezoid(40 - p, up)
    assert down[0] > 0  # it has not come back yet


def test_no_relaxation_no_memory():
    skin = replace(SKIN, prony=(Prony(0.0, 1.0),))
    curve = course(skin, [0.0, 1.0, 3.0, 4.0], [0.0, 50.0, 50.0, 0.0])
    at = np.array([0.5, 0.9, 2.0, 3.3])
    pressure = np.interp(at, [0.0, 1.0, 3.0, 4.0], [0.0, 50.0, 50.0, 0.0])
    np.testing.assert_allclose(curve(at), elastic(SKIN, 50.0)(pressure), atol=1e-4)


def test_the_course_does_not_depend_on_the_steps():
    skin = replace(SKIN, prony=(Prony(0.3, 1.0),))
    knots = [0.0, 0.75, 4.0, 4.75, 6.0], [0.0, 60.0, 60.0, 0.0, 0.0]
    usual, tight = course(skin, *knots), course(
        skin, *knots, extrapolation_error=1e-6, first_step=1e-3, correction=1e-8
    )  # fmt: skip
    assert tight.steps > 2 * usual.steps
    t = np.linspace(0, 6, 300)
    np.testing.assert_allclose(usual(t), tight(t), atol=3e-4)  # mm
    assert usual.iterations < 2 * usual.steps  # one Newton step is mostly enough


def test_what_was_there_long_before_has_relaxed():
    skin = replace(SKIN, prony=(Prony(0.4, 1.0),))
    rested = course(skin, [0.0, 5.0], [0.0, 0.0], preload=20.0)
    np.testing.assert_allclose(rested([0.0, 2.0, 5.0]), 0.0, atol=2e-6)
    # the same by waiting: a slow rise, then the load
    waited = course(skin, [0.0, 50.0, 100.0, 101.0], [0.0, 20.0, 20.0, 50.0])
    after = course(skin, [0.0, 1.0], [0.0, 30.0], preload=20.0)
    assert after(1.0) == pytest.approx(waited(101.0) - waited(100.0), rel=1e-3)


def test_the_isochoric_stress_does_no_work_on_a_change_of_volume():
    prepared = prepare(SKIN, COARSE)
    u = 0.005 * np.random.default_rng(1).normal(size=prepared.assembly.n)
    s = isochoric_stress(prepared, u)
    f = prepared.assembly.deformation_gradients(prepared.assembly.full(u))
    c = [f[0] ** 2 + f[2] ** 2, f[0] * f[1] + f[2] * f[3], f[1] ** 2 + f[3] ** 2, f[4] ** 2]
    work = s[0] * c[0] + 2 * s[1] * c[1] + s[2] * c[2] + s[3] * c[3]
    np.testing.assert_allclose(work, 0.0, atol=1e-12 * np.abs(s).max())


def test_where_it_does_not_hold_there_is_no_number():
    soft = replace(SKIN, skin=Skin((0.004, 0.0, 0.2)), prony=(Prony(0.3, 1.0),))
    times, pressures = np.array([0.0, 1.0, 2.0]), np.array([0.0, 100.0, 0.0])
    found = relax(prepare(soft, COARSE), soft.prony, times, pressures, 3.0)
    assert "beyond" in found.stopped
    assert 0 < found.holds_to_mbar < 100
    assert 0 < found.end_s < 1
    assert np.isfinite(found([0.0, 0.9 * found.end_s])).all()
    assert np.isnan(found([1.01 * found.end_s, 2.0])).all()


@pytest.mark.parametrize("times", [[0.0], [0.0, 2.0, 1.0]])
def test_a_path_runs_forward(times):
    with pytest.raises(InputError, match="in the order of time"):
        relax(prepare(SKIN, COARSE), (Prony(0.3, 1.0),), np.array(times), np.zeros(3), 3.0)


def test_there_is_no_stress_of_an_element_that_is_turned_inside_out():
    """The last correction may do that at a crease: the step is taken again, shorter."""
    prepared = prepare(SKIN, COARSE)
    nothing = np.zeros(prepared.assembly.n)
    assert isochoric_stress(prepared, nothing) is not None
    nothing[prepared.apex] = 5.0  # one node, through the element above it
    assert isochoric_stress(prepared, nothing) is None
